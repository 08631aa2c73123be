"""The planar motion that places echoes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.series import BoolArray
from gtsam_nav.trajectory import Trajectory


def lies_inverted(trajectory: Trajectory, t: Array) -> BoolArray:
    """Whether the vehicle lies upside down at given times, shape (k,): starboard is to port."""
    return np.asarray(np.interp(t, trajectory.t, np.cos(trajectory.rpy[:, 0])) < 0.0)


def placed_in_plane(trajectory: Trajectory, t: Array, xy_b: Array) -> Array:
    """Points (k, 2) of the level vehicle at times (k,) in local NED, shape (k, 3).

    A scanning sonar's beam has no vertical resolution: what it saw is placed by position and yaw.
    """
    p_n = np.stack([np.interp(t, trajectory.t, c) for c in trajectory.p_n.T], axis=1)
    yaw = np.interp(t, trajectory.t, np.unwrap(trajectory.yaw))
    x, y = xy_b.T
    p_n[:, 0] += np.cos(yaw) * x - np.sin(yaw) * y
    p_n[:, 1] += np.sin(yaw) * x + np.cos(yaw) * y
    return p_n


@dataclass(frozen=True)
class PlanarMotion:
    """North, east and unwrapped yaw over time, and how fast they lose certainty.

    Attributes
    ----------
    t : ndarray, shape (n,)
    ne : ndarray, shape (n, 2)
        Position, m.
    yaw : ndarray, shape (n,)
        Unwrapped, rad.
    position_variance_m2_s, yaw_variance_rad2_s : float
        Growth of the variance of a displacement (each axis) and of a turn with time.
    """

    t: Array
    ne: Array
    yaw: Array
    position_variance_m2_s: float
    yaw_variance_rad2_s: float

    @classmethod
    def of(
        cls, trajectory: Trajectory, position_variance_m2_s: float, yaw_variance_rad2_s: float
    ) -> PlanarMotion:
        """The planar part of a trajectory."""
        yaw = np.unwrap(trajectory.yaw)
        return cls(
            trajectory.t, trajectory.p_n[:, :2], yaw, position_variance_m2_s, yaw_variance_rad2_s
        )

    def at(self, t: Array) -> tuple[Array, Array]:
        """Position (k, 2) and yaw (k,) at given times; held constant beyond the ends."""
        ne = np.stack([np.interp(t, self.t, axis) for axis in self.ne.T], axis=1)
        return ne, np.interp(t, self.t, self.yaw)
