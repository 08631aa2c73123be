"""Scores on surveyed relations: how the vehicle lay at one time as seen from where it was before.

They need no frame and no alignment, and what lies far apart in time tells of the map: Kuemmerle et
al., *On measuring the accuracy of SLAM algorithms*, Autonomous Robots 2009.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.mission import Relations
from gtsam_nav.trajectory import Trajectory

LOOP_S = 30.0
"""Relations over a longer time are loops."""


@dataclass(frozen=True, kw_only=True)
class RelationErrors:
    """Of n relative poses: medians and 95 % points of their errors, m and deg."""

    n: int
    median_m: float
    median_deg: float
    p95_m: float
    p95_deg: float

    @classmethod
    def of(cls, error: Array) -> RelationErrors | None:
        """Statistics of errors in x, y and yaw, shape (n, 3); None without any."""
        if not len(error):
            return None
        m, deg = np.hypot(error[:, 0], error[:, 1]), np.abs(np.degrees(wrap_angle(error[:, 2])))
        (median_m, p95_m), (median_deg, p95_deg) = (
            (float(np.median(e)), float(np.percentile(e, 95))) for e in (m, deg)
        )
        return cls(
            n=len(error), median_m=median_m, median_deg=median_deg, p95_m=p95_m, p95_deg=p95_deg
        )


@dataclass(frozen=True, kw_only=True)
class RelationScores:
    """Errors of the relations over short times, and of the loops."""

    near: RelationErrors | None
    loops: RelationErrors | None


def relation_scores(
    trajectory: Trajectory, relations: Relations, offset_s: float = 0.0
) -> RelationScores:
    """Compare a trajectory with surveyed relations; those beyond its ends are left out.

    Parameters
    ----------
    trajectory : Trajectory
    relations : Relations
    offset_s : float
        What was found to be missing in the stamps that the relations name.
    """
    times = relations.t + offset_s
    # the first and last scan may lie just outside, by what their stamps are off
    held = np.clip(times, trajectory.t[0], trajectory.t[-1])
    inside = np.all(np.abs(times - held) <= np.abs(offset_s), axis=1)
    held, elapsed_s = held[inside], np.diff(held[inside], axis=1)[:, 0]
    error = between(*(planar_poses(trajectory, t) for t in held.T)) - relations.q[inside]
    return RelationScores(
        near=RelationErrors.of(error[elapsed_s < LOOP_S]),
        loops=RelationErrors.of(error[elapsed_s >= LOOP_S]),
    )


def planar_poses(trajectory: Trajectory, t: Array) -> Array:
    """North, east and yaw at given times within a trajectory, shape (n, 3)."""
    ne = [np.interp(t, trajectory.t, axis) for axis in trajectory.p_n[:, :2].T]
    yaw = np.interp(t, trajectory.t, np.unwrap(trajectory.yaw))
    return np.column_stack([*ne, yaw])


def between(a: Array, b: Array) -> Array:
    """Poses b in poses a: x, y, yaw, shape (n, 3)."""
    c, s = np.cos(a[:, 2]), np.sin(a[:, 2])
    north, east = (b[:, :2] - a[:, :2]).T
    return np.column_stack(
        [c * north + s * east, c * east - s * north, wrap_angle(b[:, 2] - a[:, 2])]
    )
