"""Where a mission was weakly constrained: how far the position is unsure, for how long, and why."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.series import DvlSeries
from gtsam_nav.solution import Solution
from gtsam_nav.trajectory import Trajectory

WEAK = 2.0
"""A position is weak where it is so many times as unsure as the mission's median."""
LEAST_WEAK_M = 0.5
"""And no less than this."""
JOINED_S = 5.0
"""Weak stretches that are no further apart are one."""
ONE_SIDED_M = 5.0
"""A closure whose sigma exceeds this in some direction does not tell the way along it."""


@dataclass(frozen=True)
class MajorAxis:
    """Longest axis of the horizontal error ellipse: sigma (n,), m, and azimuth (n,), rad."""

    sigma_m: Array
    azimuth: Array

    @classmethod
    def of(cls, trajectory: Trajectory) -> MajorAxis | None:
        """None for a trajectory without covariances."""
        if trajectory.cov_pose_n is None:
            return None
        cov = trajectory.cov_pose_n
        half = 0.5 * (cov[:, 0, 0] + cov[:, 1, 1])
        difference = 0.5 * (cov[:, 0, 0] - cov[:, 1, 1])
        root = np.hypot(difference, cov[:, 0, 1])
        azimuth = 0.5 * np.arctan2(cov[:, 0, 1], difference)
        return cls(np.sqrt(np.maximum(half + root, 0.0)), np.mod(azimuth, np.pi))

    @property
    def limit_m(self) -> float:
        """Sigma above which a position is weak."""
        return max(LEAST_WEAK_M, WEAK * float(np.median(self.sigma_m)))


@dataclass(frozen=True)
class WeakStretch:
    """A stretch of a mission whose position is unsure.

    Attributes
    ----------
    begin_s, end_s : float
    sigma_m, azimuth_deg : float
        Largest sigma of the stretch, and along which direction.
    causes : tuple of str
        What was missing there.
    """

    begin_s: float
    end_s: float
    sigma_m: float
    azimuth_deg: float
    causes: tuple[str, ...]


def weak_stretches(solution: Solution) -> tuple[WeakStretch, ...]:
    """The stretches in the order of time; none where the trajectory has no covariances."""
    trajectory, axis = solution.trajectory, MajorAxis.of(solution.trajectory)
    if axis is None:
        return ()
    weak = np.flatnonzero(axis.sigma_m > axis.limit_m)
    if not len(weak):
        return ()
    breaks = np.flatnonzero(np.diff(trajectory.t[weak]) > JOINED_S) + 1
    return tuple(
        _stretch(solution, trajectory.t[part], axis.sigma_m[part], axis.azimuth[part])
        for part in np.split(weak, breaks)
    )


def _stretch(solution: Solution, t: Array, sigma_m: Array, azimuth: Array) -> WeakStretch:
    worst, begin, end = int(np.argmax(sigma_m)), float(t[0]), float(t[-1])
    causes = (
        *_without_fixes(solution.mission, begin, end),
        *_without_closures(solution, begin, end),
        *_without_velocities(solution.mission, begin, end),
    )
    return WeakStretch(begin, end, float(sigma_m[worst]), float(np.degrees(azimuth[worst])), causes)


def _count(t: Array, begin: float, end: float) -> int:
    return int(np.count_nonzero((t >= begin) & (t <= end)))


def _without_fixes(mission: Mission, begin: float, end: float) -> tuple[str, ...]:
    fixes = sum(_count(s.series.t, begin, end) for s in mission.of_type("gnss"))
    return () if fixes else ("no GNSS fix",)


def _without_closures(solution: Solution, begin: float, end: float) -> tuple[str, ...]:
    """Only of methods that look for any."""
    here = [
        loop
        for loop in solution.loops
        if loop.verdict == "accepted" and (begin <= loop.t_a <= end or begin <= loop.t_b <= end)
    ]
    if not solution.loops:
        return ()
    if not here:
        return ("no loop closure",)
    one_sided = sum(max(loop.sigma_x_m, loop.sigma_y_m) > ONE_SIDED_M for loop in here)
    if 2 * one_sided < len(here):
        return ()
    return (f"{one_sided} of {len(here)} loop closures do not tell the way along them",)


def _without_velocities(mission: Mission, begin: float, end: float) -> tuple[str, ...]:
    """Where all that tells velocities, if anything does, is silent or reads the water."""
    if any(_count(s.series.t, begin, end) for s in mission.of_type("odometry")):
        return ()
    dvls = mission.of_type("dvl")
    locks = [lock for dvl in dvls if (lock := _bottom_lock(dvl, begin, end)) is not None]
    if not locks:
        return ("no velocity",) if dvls or mission.of_type("odometry") else ()
    # what only ever reads the water had none to lose
    lost = max(locks) < 0.5 and any(_ever_locked(dvl) for dvl in dvls)
    return ("bottom lock lost",) if lost else ()


def _ever_locked(dvl: Sensor) -> bool:
    series = dvl.series
    assert isinstance(series, DvlSeries)
    return bool(np.any(series.valid & series.bottom_lock))


def _bottom_lock(dvl: Sensor, begin: float, end: float) -> float | None:
    """Share of its samples with bottom lock; None where none is valid."""
    series = dvl.series
    assert isinstance(series, DvlSeries)
    inside = (series.t >= begin) & (series.t <= end)
    if not np.any(inside & series.valid):
        return None
    return float(np.mean(series.valid[inside] & series.bottom_lock[inside]))
