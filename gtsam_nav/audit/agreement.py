"""Two sensors that see the same motion: how much of it, and how much later, one sees."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from gtsam_nav.audit.significance import losses, prefers, quantile
from gtsam_nav.frames import Array
from gtsam_nav.series import BoolArray

WINDOWS_S = (10.0, 30.0, 60.0)
"""Within so long neither sensor is taken to drift away from a straight line: slow errors call for
the shorter, slow vehicles for the longer."""
LONGEST_LAG_S = 5.0
"""Of the search at full resolution, which begins where one in coarse steps has led."""
FARTHEST_LAG_S, COARSE_STEP_S = 40.0, 0.2
"""GPS time is 18 s ahead of UTC."""
MOST_LAGS = 100
FEWEST_WINDOWS, FEWEST_IN_WINDOW = 6, 8
MOST_WINDOWS = 500
"""Of a long mission some will do."""
GAP_STEPS, GAP_SHARE = 10.0, 0.1
"""A silence of more steps, and of a larger share of the window, is not interpolated over."""


@dataclass(frozen=True)
class Signal:
    """Times (n,), s, and values (n,) of what a sensor measures."""

    t: Array
    values: Array


@dataclass(frozen=True)
class Lag:
    """What is to be added to one sensor's stamps for another's clock.

    ``step_s`` is the sample interval below which clocks are not told apart, ``n_windows`` how many
    windows ``sigma_s`` rests on.
    """

    lag_s: float
    sigma_s: float
    step_s: float
    n_windows: int


@dataclass(frozen=True)
class Agreement:
    """``y(t) = gain * x(t + lag)``, but for a straight line in each window.

    Attributes
    ----------
    gain, gain_sigma : float
    lag_s, lag_sigma_s : float
        To be added to the stamps of y for the clock of x. Sigmas are those of the jackknife over
        windows, so that errors may be correlated within one.
    correlation : float
        Of the two signals, at that lag.
    step_s : float
        The longer of the two sensors' sample intervals.
    n_windows : int
    """

    gain: float
    gain_sigma: float
    lag_s: float
    lag_sigma_s: float
    correlation: float
    step_s: float
    n_windows: int

    @property
    def lag(self) -> Lag:
        """The lag by itself."""
        return Lag(self.lag_s, self.lag_sigma_s, self.step_s, self.n_windows)

    @property
    def significant(self) -> bool:
        """Whether the two have anything in common."""
        return abs(self.gain) > quantile(self.n_windows - 1) * self.gain_sigma


def integrated(t: Array, rate: Array) -> Signal:
    """The integral of a rate by the trapezoidal rule."""
    steps = 0.5 * (rate[1:] + rate[:-1]) * np.diff(t)
    return Signal(t, np.concatenate([[0.0], np.cumsum(steps)]))


def agreement(y: Signal, x: Signal) -> Agreement | None:
    """Compare two signals of the same quantity, in whatever units.

    The lag is where one explains most of the other, over the windows of the length that tells it
    best.

    Parameters
    ----------
    y, x : Signal
        The gain is that of y, of which x should be the less noisy one: its noise lessens the gain.

    Returns
    -------
    Agreement or None
        None where they overlap too little, one of them never changes, or they have nothing in
        common within `FARTHEST_LAG_S`.
    """
    if len(y.t) < 2 or len(x.t) < 2:
        return None
    step_s = max(float(np.median(np.diff(s.t))) for s in (y, x))
    n_lags = min(max(int(LONGEST_LAG_S / step_s), 2), MOST_LAGS)
    far_s = _far_lag(y, x, max(step_s, COARSE_STEP_S), n_lags * step_s)
    if far_s is None:
        return None
    moved = Signal(x.t - far_s, x.values)
    told = _fastest(list(_told(_windows(y, moved, step_s, n_lags), step_s)))
    return None if told is None else replace(told, lag_s=far_s + told.lag_s)


def _far_lag(y: Signal, x: Signal, step_s: float, reach_s: float) -> float | None:
    """The lag in coarse steps: zero if within reach; None where the best beyond is not decided."""
    n_lags = int(FARTHEST_LAG_S / step_s)
    windows = list(_windows(y, x, step_s, n_lags))
    told = _fastest(list(_told(windows, step_s)))
    if told is not None:
        return told.lag_s if abs(told.lag_s) > reach_s else 0.0
    best = [_best_lag(products.sum(axis=0)) - n_lags for products in windows]
    return None if any(abs(k) * step_s > reach_s for k in best) else 0.0


def _told(windows: Iterable[Array], step_s: float) -> Iterator[Agreement]:
    """The significant agreements of the products of windows of each length."""
    for products in windows:
        told = _over_windows(products, step_s)
        if told is not None and told.significant:
            yield told


def _windows(y: Signal, x: Signal, step_s: float, n_lags: int) -> Iterator[Array]:
    """Of each length of windows that are enough, their products, shape (windows, 3, lags)."""
    grid = np.arange(max(y.t[0], x.t[0]) + step_s, min(y.t[-1], x.t[-1]) - step_s, step_s)
    if len(grid) < FEWEST_WINDOWS * FEWEST_IN_WINDOW:
        return
    means_y, means_x = (_means(s, grid, step_s) for s in (y, x))
    silence_s = np.maximum(_silence_s(y.t, grid), _silence_s(x.t, grid))
    for window_s in WINDOWS_S:
        length = max(round(window_s / step_s), 2)
        known = silence_s < max(GAP_STEPS * step_s, GAP_SHARE * window_s)
        products = np.array(list(_products(means_y, means_x, known, length, n_lags)))
        if len(products) >= FEWEST_WINDOWS and length >= FEWEST_IN_WINDOW:
            yield products


def _fastest(told: list[Agreement]) -> Agreement | None:
    """The most precise of several, unless one of faster motion contradicts its lag.

    A clock is off for all motion alike; a filter, or a drift, delays what is slow.
    """
    if not told:
        return None
    chosen = min(told, key=lambda a: a.lag_sigma_s)
    for faster in reversed(told[: told.index(chosen)]):
        sigma_s = float(np.hypot(chosen.lag_sigma_s, faster.lag_sigma_s))
        dof = min(chosen.n_windows, faster.n_windows) - 1
        if abs(chosen.lag_s - faster.lag_s) > quantile(dof) * sigma_s:
            chosen = faster
    return chosen


def _means(signal: Signal, grid: Array, step_s: float) -> Array:
    """Means of a signal over steps about the grid, the same smoothing for any rate."""
    area = integrated(signal.t, signal.values - signal.values[0])
    ends = (np.interp(grid + side * step_s, area.t, area.values) for side in (0.5, -0.5))
    return np.asarray((next(ends) - next(ends)) / step_s)


def _silence_s(t: Array, grid: Array) -> Array:
    """Length of the interval between samples that each of the grid's times lies in."""
    after = np.clip(np.searchsorted(t, grid), 1, len(t) - 1)
    return np.asarray(t[after] - t[after - 1])


def _over_windows(products: Array, step_s: float) -> Agreement | None:
    """The agreement over windows of one length."""
    n = len(products)
    total = products.sum(axis=0)
    k = _decided_lag(products)
    if k is None:
        return None
    estimates = [_peak(p, k) for p in (total, *(total - products))]
    figures = np.array(estimates) * [1.0, step_s]
    spread = np.sqrt((n - 1) / n * np.sum((figures[1:] - figures[1:].mean(axis=0)) ** 2, axis=0))
    return Agreement(
        gain=float(figures[0, 0]),
        gain_sigma=float(spread[0]),
        lag_s=float(figures[0, 1]),
        lag_sigma_s=float(spread[1]),
        correlation=float(total[0, k] / np.sqrt(total[1, k] * total[2, k])),
        step_s=step_s,
        n_windows=n,
    )


def _products(y: Array, x: Array, known: BoolArray, length: int, n_lags: int) -> Iterator[Array]:
    """Of each window, at each lag: the sums of x y, x x and y y, shape (3, lags)."""
    one = np.full(length, length**-0.5)
    ramp = np.arange(length) - 0.5 * (length - 1)
    ramp = ramp / np.linalg.norm(ramp)
    begins = np.arange(n_lags, len(y) - length - n_lags + 1, length)
    for begin in begins[:: max(1, -(-len(begins) // MOST_WINDOWS))]:
        reach = slice(begin - n_lags, begin + length + n_lags)
        if not np.all(known[reach]):
            continue
        wanted, seen = y[begin : begin + length], x[reach] - np.mean(x[reach])
        wanted = wanted - np.mean(wanted)
        wanted = wanted - (wanted @ ramp) * ramp
        line = [np.correlate(seen, part) ** 2 for part in (one, ramp)]
        xx = np.correlate(seen**2, np.ones(length)) - line[0] - line[1]
        yy = np.full(len(xx), wanted @ wanted)
        yield np.array([np.correlate(seen, wanted), np.maximum(xx, 0.0), yy])


def _best_lag(products: Array) -> int:
    """Index of the lag at which one signal explains most of the other; products (3, lags)."""
    xy, xx, _ = products
    return int(np.argmax(xy**2 / np.where(xx > 0, xx, np.inf)))


def _decided_lag(products: Array) -> int | None:
    """Index of the lag at which the signals agree best; None where waves leave it open.

    What goes up and down by waves agrees a wave later too, and reversed half a wave later: a longer
    lag has to be significantly better than any shorter one.
    """
    xy, xx, yy = products.sum(axis=0)
    if not (np.all(xx > 0) and np.all(yy > 0)):
        return None
    explained = xy**2 / xx
    edged = np.concatenate([[-np.inf], explained, [-np.inf]])
    peaks = np.flatnonzero((edged[1:-1] >= edged[:-2]) & (edged[1:-1] >= edged[2:]))
    best = _best_lag(products.sum(axis=0))
    middle = len(xy) // 2
    nearer = [int(k) for k in peaks if abs(k - middle) < abs(best - middle)]

    def misfit(k: int) -> Array:
        gain = xy[k] / xx[k]
        of_x, of_xx, of_yy = products[:, :, k].T
        return np.asarray(np.sqrt(np.maximum(of_yy - 2 * gain * of_x + gain**2 * of_xx, 0.0)))

    loss = losses(np.array([misfit(k) for k in (best, *nearer)]))
    decided = all(prefers(row, loss[0], len(peaks)) for row in loss[1:])
    return best if decided else None


def _peak(products: Array, k: int) -> tuple[float, float]:
    """Gain and lag, in steps, where the explained sum of squares peaks next to lag k."""
    xy, xx, _ = products
    explained = xy**2 / xx
    near = slice(max(k - 1, 0), k + 2)
    k = near.start + int(np.argmax(explained[near]))
    offset = 0.0
    if 0 < k < len(explained) - 1:
        before, here, after = explained[k - 1 : k + 2]
        bend = before - 2 * here + after
        offset = float(np.clip(0.5 * (before - after) / bend, -1.0, 1.0)) if bend < 0 else 0.0
    return float(xy[k] / xx[k]), k - len(explained) // 2 + offset
