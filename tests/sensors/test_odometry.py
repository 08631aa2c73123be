"""Which sensor tells the velocity, and how well it is calibrated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.sensors.odometry import curvature_sigma, velocity_calibration_sigma
from gtsam_nav.series import DvlSeries, OdometrySeries

DVL = Sensor(
    "dvl",
    "dvl",
    DvlSeries(
        t=np.arange(3.0),
        v_d=np.zeros((3, 3)),
        sigma=np.ones(3),
        valid=np.ones(3, dtype=bool),
        bottom_lock=np.ones(3, dtype=bool),
    ),
    noise={"scale_sigma": 0.002, "misalignment_sigma_deg": 2.0},
)
ODOMETRY = Sensor(
    "odometry",
    "odometry",
    OdometrySeries(
        t=np.arange(2.0),
        v_b=np.zeros((2, 2)),
        yaw_rate=np.zeros(2),
        sigma_v=np.ones(2),
        sigma_yaw_rate=np.ones(2),
    ),
    noise={"scale_sigma": 0.05, "misalignment_sigma_deg": 3.0},
)
UNLOCKED = replace(DVL.series, valid=np.zeros(3, dtype=bool))
BLIND = replace(DVL, name="blind", noise={}, series=UNLOCKED)


@pytest.mark.parametrize(
    ("sensors", "scale", "misalignment_deg"),
    [
        ([DVL, ODOMETRY], 0.002, 2.0),
        ([ODOMETRY], 0.05, 3.0),
        ([BLIND, ODOMETRY], 0.05, 3.0),
        ([BLIND, DVL], 0.002, 2.0),
        ([], 0.03, 0.5),
    ],
    ids=["the DVL goes before", "odometry alone", "a blind DVL", "a second DVL", "neither"],
)
def test_the_calibration_is_that_of_what_tells_the_velocity(
    sensors: list[Sensor], scale: float, misalignment_deg: float
) -> None:
    mission = Mission("m", {sensor.name: sensor for sensor in sensors})
    sigma = velocity_calibration_sigma(mission)
    np.testing.assert_allclose(sigma, [scale, np.radians(misalignment_deg)])


def test_wheels_miss_a_turn_and_nothing_else_does() -> None:
    noise = {**ODOMETRY.noise, "curvature_sigma_deg_m": 2.0}
    wheels = replace(ODOMETRY, noise=noise)
    assert curvature_sigma(Mission("m", {"odometry": wheels})) == pytest.approx(np.radians(2.0))
    assert curvature_sigma(Mission("m", {"dvl": DVL})) == 0.0
