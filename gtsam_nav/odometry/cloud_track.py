"""Where the clouds of a mission were taken, as an odometry has it, and the clouds that it keeps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtsam_nav.frames import Array, skew
from gtsam_nav.mission import Rejection
from gtsam_nav.registration.result import RelativePose

SUBMAP_REACH = 2
"""Kept clouds on either side of one that make a submap with it."""
UNMATCHED_RATE = np.array([0.1] * 3 + [1.0] * 3)
"""How far a motion may stray from a steady one over a gap that nothing matches: rad/s and m/s."""


@dataclass(frozen=True)
class KeyCloud:
    """A cloud that the odometry placed, and that it keeps.

    Attributes
    ----------
    t : float
        When its last point was taken, s: the time of its pose.
    pose : RelativePose
        Of the body in the odometry's frame, the covariance being that of its match to the map.
    points_b : ndarray, shape (k, 3)
        Deskewed and thinned, in body axes at that time, m.
    index : int
        Of the cloud in its series.
    map : int
        Of the local maps, the one that it was matched to.
    """

    t: float
    pose: RelativePose
    points_b: Array
    index: int
    map: int = 0


@dataclass(frozen=True)
class CloudTrack:
    """The odometry of a mission.

    Attributes
    ----------
    sensor : str
    t, R_ob, p_o : ndarray, shapes (n,), (n, 3, 3) and (n, 3)
        Poses of the body in the odometry's frame, one a cloud.
    key : list of KeyCloud
    rejections : tuple of Rejection
        Clouds that were too small.
    warnings : tuple of str
        What else there is to say of the clouds.
    """

    sensor: str
    t: Array
    R_ob: Array
    p_o: Array
    key: list[KeyCloud]
    rejections: tuple[Rejection, ...]
    warnings: tuple[str, ...] = ()

    def increment(self, i: int, j: int) -> RelativePose:
        """Pose of kept cloud j in kept cloud i.

        Both are placed in a map that changes little in between: each has its own error. From one
        map to the next it is a guess.
        """
        a, b = self.key[i].pose, self.key[j].pose
        R_ab, p_a = a.R_ab.T @ b.R_ab, a.R_ab.T @ (b.p_a - a.p_a)
        from_a = adjoint(R_ab.T, -R_ab.T @ p_a)
        cov = from_a @ a.cov @ from_a.T + b.cov
        if self.key[i].map != self.key[j].map:
            cov += np.diag((UNMATCHED_RATE * (self.key[j].t - self.key[i].t)) ** 2)
        return RelativePose(R_ab, p_a, cov)

    def submap(self, j: int) -> Array:
        """Points of kept cloud j and its neighbours, as the odometry has them, around j; (k, 3)."""
        middle = self.key[j]
        around = self.key[max(j - SUBMAP_REACH, 0) : j + SUBMAP_REACH + 1]
        placed = [
            cloud.points_b @ cloud.pose.R_ab.T + cloud.pose.p_a
            for cloud in around
            if cloud.map == middle.map
        ]
        return np.asarray((np.concatenate(placed) - middle.pose.p_a) @ middle.pose.R_ab)


def adjoint(R_ab: Array, p_a: Array) -> Array:
    """Maps a small turn and shift along the axes of b to those along the axes of a, (6, 6)."""
    return np.block([[R_ab, np.zeros((3, 3))], [skew(p_a) @ R_ab, R_ab]])
