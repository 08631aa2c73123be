"""What is drawn against time: errors, headings and slow states, as numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gtsam_nav.evaluation.alignment import align
from gtsam_nav.evaluation.consistency import total_covariance_ne
from gtsam_nav.evaluation.matching import match
from gtsam_nav.evaluation.metrics import reference_series
from gtsam_nav.frames import Array, rpy_from_rotation, wrap_angle
from gtsam_nav.mission import Mission
from gtsam_nav.series import HeadingSeries, IntArray
from gtsam_nav.solution import Solution

MOST_SAMPLES = 6000
"""Of a reference that are drawn; every k-th of a longer one."""
BREAK_S = 5.0
BREAK_PERIODS = 3.0
"""Lines are not drawn over silences that are longer than both."""
COMPASS_PREFIX = "heading"
"""Slow states whose names begin so are the compass's."""

_FOREMOST = ("graph", "pose-ekf", "landmark-ekf", "ins-ekf")


def foremost(solutions: Sequence[Solution]) -> Solution:
    """The solution that the others are held against: the graph's, else a SLAM filter's."""
    return ranked(solutions)[0]


def ranked(solutions: Sequence[Solution]) -> list[Solution]:
    """The solutions with the foremost first."""
    rank = {method: k for k, method in enumerate(_FOREMOST)}
    return sorted(solutions, key=lambda s: rank.get(s.method, len(rank)))


def line_starts(t: Array) -> IntArray:
    """Indices of the samples that follow a silence: a line does not run on to them."""
    steps = np.diff(t)
    longest = max(BREAK_S, BREAK_PERIODS * float(np.median(steps))) if len(steps) else BREAK_S
    return np.flatnonzero(steps > longest) + 1


@dataclass(frozen=True)
class ErrorHistory:
    """Errors of a solution against time.

    Attributes
    ----------
    t : ndarray, shape (m,)
    error_m : ndarray, shape (m, 3)
        North, east and horizontal.
    sigma_m : ndarray, shape (m, 3), or None
        Of estimate and reference together; None without a covariance, or after an alignment.
    note : str
        Says where the errors are those after an alignment.
    """

    t: Array
    error_m: Array
    sigma_m: Array | None
    note: str


def error_history(solution: Solution) -> ErrorHistory | None:
    """Errors without alignment, or after SE(2) where there are no absolute positions."""
    if solution.reference is None:
        return None
    series = reference_series(solution.reference)
    series = series.select(slice(None, None, 1 + len(series) // MOST_SAMPLES))
    matched = match(solution.trajectory, series, solution.reference.xyz_b)
    aligned = align(matched, "none" if solution.georeferenced else "se2") if matched else None
    if matched is None or aligned is None:
        return None
    sigma = None
    if matched.cov_ne is not None and solution.georeferenced:
        cov = total_covariance_ne(matched)
        sigma = np.sqrt(np.column_stack([cov[:, 0, 0], cov[:, 1, 1], cov[:, 0, 0] + cov[:, 1, 1]]))
    error = np.column_stack([aligned.error_n[:, :2], aligned.horizontal_m])
    note = "" if solution.georeferenced else " (SE(2)-aligned)"
    return ErrorHistory(matched.t, error, sigma, note)


@dataclass(frozen=True)
class HeadingBaseline:
    """The heading that the others are held against."""

    name: str
    t: Array
    yaw: Array

    def less(self, t: Array, yaw: Array) -> tuple[Array, Array]:
        """Times inside the baseline's span, and there the heading less the baseline's, deg."""
        inside = (t >= self.t[0]) & (t <= self.t[-1])
        own = np.interp(t[inside], self.t, np.unwrap(self.yaw))
        return t[inside], np.degrees(wrap_angle(yaw[inside] - own))


def heading_baseline(solutions: Sequence[Solution]) -> tuple[HeadingBaseline, list[Solution]]:
    """The reference's heading, or where it has none the foremost solution's; and the others."""
    baseline = reference_heading(solutions[0])
    if baseline is not None:
        return baseline, list(solutions)
    chosen = foremost(solutions)
    yaw = chosen.trajectory.yaw
    others = [s for s in solutions if s is not chosen]
    return HeadingBaseline(chosen.method, chosen.trajectory.t, yaw), others


def reference_heading(solution: Solution) -> HeadingBaseline | None:
    """The heading that the reference tells; None where it tells none."""
    if solution.reference is None:
        return None
    series = reference_series(solution.reference)
    if series.rpy is None:
        return None
    return HeadingBaseline("reference", series.t, series.rpy[:, 2])


def compass_readings(mission: Mission) -> tuple[Array, Array] | None:
    """Times and readings of the first compass as headings of the body, rad."""
    sensor = mission.first("heading")
    if sensor is None or not isinstance(sensor.series, HeadingSeries):
        return None
    return sensor.series.t, sensor.series.heading - rpy_from_rotation(sensor.R_bs)[2]


def slow_names(solution: Solution) -> list[str]:
    """Columns of the slow states in the order in which they are drawn.

    One that is zero with certainty, as a planar mission has them, shows nothing.
    """
    slow = solution.slow_states
    if slow is None or not len(slow.t):
        return []
    shown = (name for name, column in slow.columns.items() if np.any(np.abs(column) > 1e-9))
    return sorted(shown)


def for_people(name: str) -> tuple[str, str, float]:
    """A slow state's column as words, the unit it is drawn in, and the factor to that unit."""
    for ending, unit, factor in (
        ("_rad_s", "deg/s", 180.0 / np.pi),
        ("_rad", "deg", 180.0 / np.pi),
        ("_m_s2", "m/s²", 1.0),
        ("_m_s", "m/s", 1.0),
        ("_m", "m", 1.0),
        ("_s", "s", 1.0),
    ):
        if name.endswith(ending):
            return name.removesuffix(ending).replace("_", " "), unit, factor
    return name.replace("_", " "), "", 1.0
