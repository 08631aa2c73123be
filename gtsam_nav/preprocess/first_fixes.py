"""Where the fixes begin: the first one that those after it bear out, and how fast it moves."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.series import BoolArray, GnssSeries, IntArray

COMPARED, SPACING_S, WITHIN_S = 7, 0.5, 15.0
"""So many fixes are compared, so far apart at least and in all at most."""
MANOEUVRE_M_S2 = 1.0
"""Acceleration by which a track may leave a straight line."""
TOLERANCE_SIGMAS = 4.0
ANY_SPEED_M_S = 20.0
"""Spread of a velocity that the fixes do not tell."""
OFF_THE_NEXT = "first fix off the next"
USELESS_SIGMA_M = 1e4
"""A receiver that gives velocities alone states its positions to be as uncertain as this."""


@dataclass(frozen=True)
class FirstFixes:
    """How a receiver's fixes begin.

    Attributes
    ----------
    first : int
        The first fix that agrees with most of those after it; those before it that tell a position
        are outliers.
    v_n : ndarray, shape (3,)
        Mean velocity over the first fixes, m/s.
    sigma_v : float
    """

    first: int
    v_n: Array
    sigma_v: float


def first_fixes(series: GnssSeries) -> FirstFixes:
    """Look at the first fixes together: steady motion explains most of them, outliers none.

    Of two fixes, or where no straight track explains more than half, nothing can be told: the
    first is taken as it is.
    """
    some = spaced(series, WITHIN_S)[:COMPARED]
    t, p_n, sigma = series.t[some], series.p_n[some], series.sigma[some, :2].max(axis=1)
    best, fewest_m = np.zeros(len(some), dtype=bool), np.inf
    for i, j in combinations(range(len(some)), 2):
        velocity = (p_n[j] - p_n[i]) / (t[j] - t[i])
        off_m = np.linalg.norm((p_n[i] + np.outer(t - t[i], velocity) - p_n)[:, :2], axis=1)
        away_s = np.minimum(np.abs(t - t[i]), np.abs(t - t[j]))
        agree = off_m <= TOLERANCE_SIGMAS * sigma + MANOEUVRE_M_S2 * away_s**2 / 2
        total_m = float(off_m[agree].sum())
        if (-agree.sum(), total_m) < (-best.sum(), fewest_m):
            best, fewest_m = agree, total_m
    if best.sum() < 3 or best.sum() <= len(some) / 2:
        return FirstFixes(0, np.zeros(3), ANY_SPEED_M_S)
    t, p_n, sigma = t[best], p_n[best], sigma[best]
    line = np.vander(t - t.mean(), 2)
    (v_n, _), *_ = np.linalg.lstsq(line, p_n, rcond=None)
    noise = float(np.mean(sigma)) / np.sqrt(np.sum((t - t.mean()) ** 2))
    spread = min(float(np.hypot(noise, MANOEUVRE_M_S2 * (t[-1] - t[0]) / 2)), ANY_SPEED_M_S)
    return FirstFixes(int(some[best][0]), v_n, spread)


def located(series: GnssSeries) -> BoolArray:
    """Which fixes tell a position, shape (n,)."""
    return np.asarray(np.all(series.sigma[:, :2] < USELESS_SIGMA_M, axis=1))


def locating_receiver(mission: Mission) -> Sensor | None:
    """The first receiver whose fixes tell a position, with these alone; None without any."""
    for receiver in mission.of_type("gnss"):
        series = receiver.series
        assert isinstance(series, GnssSeries)
        if np.any(located(series)):
            return replace(receiver, series=series.select(located(series)))
    return None


def spaced(series: GnssSeries, within_s: float) -> IntArray:
    """Fixes that tell a position, from the first such one on, some time apart."""
    at = np.flatnonzero(located(series))
    chosen: list[int] = []
    for k in at[series.t[at] < series.t[at[:1]] + within_s].tolist():
        if not chosen or series.t[k] >= series.t[chosen[-1]] + SPACING_S:
            chosen.append(k)
    return np.array(chosen, dtype=np.int64)
