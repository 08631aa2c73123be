"""The constant errors of what measures the vehicle's own velocity and turns."""

from __future__ import annotations

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission
from gtsam_nav.sensors.noise import DvlNoise, OdometryNoise


def velocity_calibration_sigma(mission: Mission) -> Array:
    """Spread of scale and misalignment (rad) of the DVL, else of the odometry; shape (2,)."""
    dvl_sensor, odometry = mission.first("dvl"), mission.first("odometry")
    noise: DvlNoise | OdometryNoise
    if dvl_sensor is not None:
        noise = DvlNoise.model_validate(dvl_sensor.noise)
    else:
        noise = OdometryNoise.model_validate(odometry.noise if odometry else {})
    return np.array([noise.scale_sigma, np.radians(noise.misalignment_sigma_deg)])


def curvature_sigma(mission: Mission) -> float:
    """Spread of the turn that odometry does not notice, rad a metre; zero without it."""
    odometry = mission.first("odometry")
    if odometry is None:
        return 0.0
    noise = OdometryNoise.model_validate(odometry.noise)
    return float(np.radians(noise.curvature_sigma_deg_m))
