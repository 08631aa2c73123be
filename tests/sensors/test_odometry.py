"""Odometry: a velocity without a vertical part, and how well it is calibrated."""

from __future__ import annotations

import numpy as np
import pytest

from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.sensors.odometry import velocity_calibration_sigma
from gtsam_nav.series import DvlSeries, OdometrySeries

DVL = Sensor(
    "dvl",
    "dvl",
    DvlSeries(
        t=np.zeros(1),
        v_d=np.zeros((1, 3)),
        sigma=np.ones(1),
        valid=np.ones(1, dtype=bool),
        bottom_lock=np.ones(1, dtype=bool),
    ),
    noise={"scale_sigma": 0.002, "misalignment_sigma_deg": 2.0},
)
ODOMETRY = Sensor(
    "odometry",
    "odometry",
    OdometrySeries(
        t=np.zeros(1),
        v_b=np.zeros((1, 2)),
        yaw_rate=np.zeros(1),
        sigma_v=np.ones(1),
        sigma_yaw_rate=np.ones(1),
    ),
    noise={"scale_sigma": 0.05, "misalignment_sigma_deg": 3.0},
)


@pytest.mark.parametrize(
    ("sensors", "scale", "misalignment_deg"),
    [
        ([DVL, ODOMETRY], 0.002, 2.0),
        ([ODOMETRY], 0.05, 3.0),
        ([], 0.03, 0.5),
    ],
    ids=["the DVL goes before", "odometry alone", "neither"],
)
def test_the_calibration_is_that_of_what_tells_the_velocity(
    sensors: list[Sensor], scale: float, misalignment_deg: float
) -> None:
    mission = Mission("m", {sensor.name: sensor for sensor in sensors})
    sigma = velocity_calibration_sigma(mission)
    np.testing.assert_allclose(sigma, [scale, np.radians(misalignment_deg)])
