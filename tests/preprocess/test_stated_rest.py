"""Where a vehicle that is said to rest when its IMU is quiet is taken to do so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gtsam_nav.mission import Constraints, Mission, Sensor
from gtsam_nav.preprocess.settings import MotionSettings
from gtsam_nav.preprocess.stated_rest import stated_rests
from gtsam_nav.series import DvlSeries, GnssSeries, ImuSeries, OdometrySeries, Series

REST_S, END_S = 30.0, 60.0
SETTINGS = MotionSettings()


def drive(speed_m_s: float, kind: str, until_s: float = END_S) -> Mission:
    """At rest, then at a steady speed; the IMU feels no difference."""
    rng = np.random.default_rng(0)
    t = np.arange(0.0, END_S, 0.02)
    n = len(t)
    imu = ImuSeries(
        t=t,
        gyro_i=1e-3 * rng.normal(size=(n, 3)),
        accel_i=np.array([0.0, 0.0, -9.81]) + 0.01 * rng.normal(size=(n, 3)),
    )
    t = np.arange(0.0, until_s, 0.2)
    v = np.where(t < REST_S, 0.0, speed_m_s)[:, None] * [1.0, 0.0, 0.0]
    v = v + 0.05 * rng.normal(size=v.shape)
    sigma, ok = np.full(len(t), 0.05), np.ones(len(t), dtype=bool)
    p = np.maximum(t - REST_S, 0.0)[:, None] * [speed_m_s, 0.0, 0.0]
    p = p + 0.5 * rng.normal(size=p.shape)
    series: dict[str, Series] = {
        "dvl": DvlSeries(t=t, v_d=v, sigma=sigma, valid=ok, bottom_lock=ok),
        "odometry": OdometrySeries(
            t=t, v_b=v[:, :2], yaw_rate=0.0 * t, sigma_v=sigma, sigma_yaw_rate=sigma
        ),
        "gnss": GnssSeries(t=t, p_n=p, sigma=np.full((len(t), 3), 0.5)),
    }
    return Mission(
        "drive",
        {"imu": Sensor("imu", "imu", imu), kind: Sensor(kind, kind, series[kind])},
        constraints=Constraints(zero_velocity=True),
    )


@pytest.mark.parametrize("kind", ["dvl", "odometry", "gnss"])
def test_a_sensor_of_motion_tells_a_rest_from_a_steady_speed(kind: str) -> None:
    rests, (warning,) = stated_rests(drive(1.5, kind), SETTINGS)
    assert rests is not None
    assert 20 <= len(rests.t) <= REST_S
    assert rests.t.max() < REST_S + 1.1
    assert "zero_velocity" in warning


@pytest.mark.parametrize("kind", ["dvl", "odometry", "gnss"])
def test_a_rest_that_all_agree_on_is_one(kind: str) -> None:
    rests, warnings = stated_rests(drive(0.0, kind), SETTINGS)
    assert rests is not None
    assert len(rests.t) > END_S - 2
    assert not warnings


def test_where_quiet_is_often_motion_an_unseen_rest_is_none() -> None:
    rests, (warning,) = stated_rests(drive(1.5, "dvl", until_s=50.0), SETTINGS)
    assert rests is not None
    assert rests.t.max() < REST_S + 1.1
    assert "no other sensor sees" in warning


def test_quiet_alone_is_a_rest_where_nothing_else_measures() -> None:
    rests, warnings = stated_rests(drive(0.0, "dvl").without("dvl"), SETTINGS)
    assert rests is not None
    assert len(rests.t) > END_S - 2
    assert not warnings


def test_no_rest_is_stated_unless_it_is() -> None:
    afloat = replace(drive(0.0, "dvl"), constraints=Constraints())
    assert stated_rests(afloat, SETTINGS) == (None, ())
    assert stated_rests(afloat, MotionSettings(zero_velocity=True))[0] is not None
