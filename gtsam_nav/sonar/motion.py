"""The planar motion that places echoes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.trajectory import Trajectory


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
        yaw = np.unwrap(trajectory.rpy[:, 2])
        return cls(
            trajectory.t, trajectory.p_n[:, :2], yaw, position_variance_m2_s, yaw_variance_rad2_s
        )

    def at(self, t: Array) -> tuple[Array, Array]:
        """Position (k, 2) and yaw (k,) at given times; held constant beyond the ends."""
        ne = np.stack([np.interp(t, self.t, axis) for axis in self.ne.T], axis=1)
        return ne, np.interp(t, self.t, self.yaw)
