"""What measures the vehicle's own velocity, and the constant errors of that and of its turns."""

from __future__ import annotations

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.sensors.noise import DvlNoise, OdometryNoise
from gtsam_nav.series import DvlSeries


def velocity_sensor(mission: Mission) -> Sensor | None:
    """The sensor that the speed is taken from: the first DVL that has two valid readings, else
    odometry."""
    for sensor in (*mission.of_type("dvl"), *mission.of_type("odometry")):
        series = sensor.series
        n = np.count_nonzero(series.valid) if isinstance(series, DvlSeries) else len(series)
        if n >= 2:
            return sensor
    return None


def velocity_calibration_sigma(mission: Mission) -> Array:
    """Spread of scale and misalignment (rad) of the sensor that the speed is taken from; shape
    (2,)."""
    sensor = velocity_sensor(mission)
    noise: DvlNoise | OdometryNoise
    if sensor is not None and sensor.type == "dvl":
        noise = DvlNoise.model_validate(sensor.noise)
    else:
        noise = OdometryNoise.model_validate(sensor.noise if sensor else {})
    return np.array([noise.scale_sigma, np.radians(noise.misalignment_sigma_deg)])


def curvature_sigma(mission: Mission) -> float:
    """Spread of the turn that odometry does not notice, rad a metre; zero without it."""
    odometry = mission.first("odometry")
    if odometry is None:
        return 0.0
    noise = OdometryNoise.model_validate(odometry.noise)
    return float(np.radians(noise.curvature_sigma_deg_m))
