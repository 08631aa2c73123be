"""The edges of a pose graph: relative poses that somebody made of other measurements."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gtsam_nav.frames import Array, rotation_from_rpy, rpy_from_rotation
from gtsam_nav.series import BoolArray

EDGES = "edges"
"""What rejections of edges call their sensor."""
PLANAR = (3, 4, 2)
"""Shift forward and to starboard, and turn about down, among turn and shift."""


@dataclass(frozen=True)
class PoseEdges:
    """Relative poses of a mission's body at two times each, all in the plane or all in space.

    Attributes
    ----------
    t : ndarray, shape (n, 2)
        When the vehicle was where its axes are the frame, and when it was at the pose, s.
    R_ab : ndarray, shape (n, 3, 3)
        Turns vectors at the pose into the frame.
    p_a : ndarray, shape (n, 3)
        The pose's place in the frame: forward, starboard, down, m.
    information : ndarray, shape (n, 6, 6)
        Of a small turn (rad) and shift (m) of the pose, in this order, both along its own axes;
        zero where an edge in the plane tells nothing.
    """

    t: Array
    R_ab: Array
    p_a: Array
    information: Array

    @classmethod
    def in_plane(cls, t: Array, q: Array, cov: Array) -> PoseEdges:
        """Edges that tell nothing of roll, pitch and depth.

        Parameters
        ----------
        q : ndarray, shape (n, 3)
            Forward, starboard (m) and yaw (rad, clockwise).
        cov : ndarray, shape (n, 3, 3)
            Of ``q``.
        """
        level = np.zeros(len(t))
        R_ab = rotation_from_rpy(np.column_stack([level, level, q[:, 2]]))
        information = np.zeros((len(t), 6, 6))
        into_b = np.swapaxes(R_ab, 1, 2)
        information[np.ix_(range(len(t)), PLANAR, PLANAR)] = into_b @ np.linalg.inv(cov) @ R_ab
        return cls(t, R_ab, np.column_stack([q[:, :2], level]), information)

    def __len__(self) -> int:
        return len(self.t)

    @property
    def in_space(self) -> bool:
        """Whether they tell roll, pitch and depth too."""
        return bool(np.any(self.information[:, 0, 0] > 0))

    @property
    def q(self) -> Array:
        """What of the poses lies in the plane: forward, starboard (m) and yaw (rad), (n, 3)."""
        return np.column_stack([self.p_a[:, :2], rpy_from_rotation(self.R_ab)[:, 2]])

    @property
    def cov(self) -> Array:
        """Covariance of shift forward and to starboard and of turn about down, along the frame's
        axes, shape (n, 3, 3)."""
        tells = np.diagonal(self.information, axis1=1, axis2=2) > 0
        whole = np.linalg.inv(self.information + np.eye(6) * ~tells[:, None])
        to_a = np.zeros((len(self), 3, 6))
        to_a[:, :2, 3:] = self.R_ab[:, :2]
        to_a[:, 2, :3] = self.R_ab[:, 2]
        return np.asarray(to_a @ whole @ np.swapaxes(to_a, 1, 2))

    @property
    def span_s(self) -> tuple[float, float]:
        """First and last pose."""
        return float(self.t.min()), float(self.t.max())

    def select(self, mask: BoolArray) -> PoseEdges | None:
        """Some of the edges; None without any."""
        if not np.any(mask):
            return None
        return PoseEdges(self.t[mask], self.R_ab[mask], self.p_a[mask], self.information[mask])

    def crop(self, start_s: float, stop_s: float) -> PoseEdges | None:
        """The edges of which both poses lie in start <= t < stop; None without any."""
        return self.select(np.all((self.t >= start_s) & (self.t < stop_s), axis=1))

    def shift(self, offset_s: float) -> PoseEdges:
        """The same edges with an offset added to their times."""
        return replace(self, t=self.t + offset_s)
