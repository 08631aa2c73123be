"""Random processes that sensor errors are made of."""

from __future__ import annotations

from itertools import accumulate

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.series import BoolArray


def random_walk(
    rng: np.random.Generator, n: int, step_s: float, density: float, axes: int
) -> Array:
    """Integrated white noise of a density (unit per square root of s), shape (n, axes)."""
    steps = rng.normal(scale=density * np.sqrt(step_s), size=(n, axes))
    steps[:1] = 0.0
    return np.cumsum(steps, axis=0)


def gauss_markov(
    rng: np.random.Generator, n: int, step_s: float, sigma: float, time_s: float, axes: int
) -> Array:
    """Stationary first-order Gauss-Markov noise, shape (n, axes).

    ``sigma`` is its standard deviation, ``time_s`` the time over which it forgets all but 1/e.
    """
    kept = np.exp(-step_s / time_s)
    drive = rng.normal(scale=sigma * np.sqrt(1 - kept**2), size=(n, axes))
    drive[:1] /= np.sqrt(1 - kept**2)  # starts at its stationary spread
    # scipy.signal could do this, but takes longer to import than the whole simulation's sensors
    filtered = [list(accumulate(axis, lambda x, w: kept * x + w)) for axis in drive.T.tolist()]
    return np.array(filtered).T


def bursts(
    rng: np.random.Generator, t: Array, per_min: float, mean_s: float
) -> tuple[BoolArray, Array]:
    """Samples inside bursts that begin at random and last exponentially distributed times.

    Returns
    -------
    inside : ndarray of bool, shape (n,)
    mark : ndarray, shape (n,)
        A number in [0, 1) that is one burst's own, the same for all of its samples.
    """
    span = float(t[-1] - t[0]) if len(t) else 0.0
    count = rng.poisson(per_min * span / 60)
    starts = np.sort(rng.uniform(0, span, count)) + (t[0] if len(t) else 0.0)
    stops = starts + rng.exponential(mean_s, count)
    marks = rng.uniform(size=count)
    inside, mark = np.zeros(len(t), dtype=bool), np.zeros(len(t))
    for start, stop, own in zip(starts, stops, marks, strict=True):
        hit = (t >= start) & (t < stop)
        inside |= hit
        mark[hit] = own
    return inside, mark


def correlation_time_s(samples: Array, step_s: float) -> float:
    """First lag at which the autocorrelation of samples (n,) falls to 1/e, s."""
    centred = samples - samples.mean()
    power = np.abs(np.fft.rfft(centred, 2 * len(centred))) ** 2
    correlation = np.fft.irfft(power)[: len(centred)]
    below = np.flatnonzero(correlation < correlation[0] / np.e)
    return float(below[0] * step_s) if len(below) else len(centred) * step_s
