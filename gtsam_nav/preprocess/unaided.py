"""What is said where nothing but an IMU tells the way."""

from __future__ import annotations

import numpy as np

from gtsam_nav.trajectory import Trajectory


def said_of_drift(trajectory: Trajectory, from_s: float) -> str:
    """Of a trajectory whose IMU is alone from a time until the end."""
    sigma_m = trajectory.sigma_p_n
    assert sigma_m is not None
    return (
        f"from {from_s:.1f} s on nothing but the IMU tells the way: the position drifts freely, at"
        f" the end to a standard deviation of {float(np.hypot(*sigma_m[-1, :2])):.3g} m; GNSS, a"
        " DVL or odometry would hold it"
    )
