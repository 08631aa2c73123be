"""Vehicles whose turns a compass alone tells: its disturbance walks, its noise stays in them."""

from __future__ import annotations

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission
from gtsam_nav.sensors.noise import HeadingNoise
from gtsam_nav.series import HeadingSeries

YAW_RATE_SIGMA_RAD_S = np.sqrt(0.1)
"""Of the rate of turn before the first reading."""


def turned_by_compass(mission: Mission) -> bool:
    """Whether a compass, and no gyro, tells how the vehicle turns."""
    compass = mission.first("heading")
    return mission.first("imu") is None and compass is not None and len(compass.series) >= 2


def disturbance_walk_rad2_s(mission: Mission) -> float:
    """Growth of the variance of the compass's disturbance from any one time on.

    Over times that are short against its own it is a random walk of density ``2 sigma^2 / time``.
    """
    compass = mission.first("heading")
    assert compass is not None
    noise = HeadingNoise.model_validate(compass.noise)
    return float(2.0 * np.radians(noise.disturbance_sigma_deg) ** 2 / noise.disturbance_time_s)


def smoothed_heading(
    headings: HeadingSeries, walk_rad2_s: float, yaw_accel_rad_s2: float
) -> tuple[Array, float]:
    """Readings (n,), unwrapped and smoothed as the vehicle turns and the disturbance walks.

    Returns
    -------
    level : ndarray, shape (n,)
        Heading and disturbance together, rad.
    sigma : float
        What is left in it of the white noise, rad.
    """
    from gtsam_nav.preprocess._trend import smooth_trend

    level, _, variance, _ = smooth_trend(
        headings.t,
        np.unwrap(headings.heading),
        headings.sigma**2,
        walk_rad2_s,
        yaw_accel_rad_s2**2,
        YAW_RATE_SIGMA_RAD_S**2,
        np.inf,
    )
    return level, float(np.sqrt(np.median(variance)))
