"""The motion that places echoes, of a vehicle upside down too."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import gtsam_nav as gn
from gtsam_nav.frames import quaternion_from_rpy, rotation_from_rpy, wrap_angle
from gtsam_nav.mission import Mission
from gtsam_nav.series import AttitudeSeries
from gtsam_nav.sonar.motion import lies_inverted
from gtsam_nav.trajectory import Trajectory

INVERTED = rotation_from_rpy(np.array([np.pi, 0.0, 0.0]))


def rolling(*roll_deg: float) -> Trajectory:
    n = len(roll_deg)
    rpy = np.column_stack([np.radians(roll_deg), np.zeros(n), np.ones(n)])
    return Trajectory(
        t=np.arange(float(n)), p_n=np.zeros((n, 3)), q_nb_wxyz=quaternion_from_rpy(rpy)
    )


def test_a_vehicle_lies_inverted_while_its_keel_is_up() -> None:
    times = np.array([0.0, 0.9, 1.5, 2.0, 2.9, 3.0])
    inverted = lies_inverted(rolling(0.0, 170.0, -170.0, 20.0), times)
    np.testing.assert_array_equal(inverted, [False, True, True, True, False, False])


def told_upside_down(mission: Mission) -> Mission:
    """The same mission in body axes that are turned about the bow: starboard is port."""
    for sensor in mission.sensors.values():
        series = sensor.series
        if isinstance(series, AttitudeSeries):
            series = replace(series, roll=wrap_angle(series.roll + np.pi))
        xyz_b, R_bs = INVERTED @ sensor.xyz_b, INVERTED @ sensor.R_bs
        mission = mission.with_sensor(replace(sensor, series=series, xyz_b=xyz_b, R_bs=R_bs))
    return mission


@pytest.mark.slow
@pytest.mark.parametrize("method", ["graph", "scan-match"])
def test_upside_down_the_echoes_lie_where_they_lie_upright(method: str) -> None:
    upright = gn.simulate("marina", seed=3, duration_s=60.0).without("landmarks", "odometry")
    maps = [gn.estimate(m, method).sonar_map for m in (upright, told_upside_down(upright))]
    assert maps[0] is not None
    assert maps[1] is not None
    np.testing.assert_array_equal(maps[0].t, maps[1].t)
    np.testing.assert_allclose(maps[0].points_n, maps[1].points_n, atol=1.0)
