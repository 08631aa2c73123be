"""Roll and pitch of a vehicle in waves by its IMU alone."""

from __future__ import annotations

import numpy as np
import pytest

from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.preprocess.alignment import align
from gtsam_nav.preprocess.levelling import tilt_by
from gtsam_nav.preprocess.motion import vehicle_motion
from gtsam_nav.preprocess.settings import MotionSettings
from gtsam_nav.series import ImuSeries, ReferenceSeries
from gtsam_nav.simulation import SimulationSettings, simulate


@pytest.fixture(scope="module")
def waves() -> Mission:
    settings = SimulationSettings(sonar=None, landmarks=None, odometry=None)
    return simulate("marina", 1, 60.0, settings).without("attitude", "heading")


def true_tilt(mission: Mission, t: Array) -> Array:
    truth = mission.sensors["reference"].series
    assert isinstance(truth, ReferenceSeries)
    assert truth.rpy is not None
    return np.stack([np.interp(t, truth.t, axis) for axis in truth.rpy[:, :2].T], axis=1)


def test_the_gyro_follows_what_gravity_levels(waves: Mission) -> None:
    t = np.arange(5.0, 55.0, 0.1)
    tilt, true = tilt_by(waves.sensors["imu"], t), true_tilt(waves, t)
    assert np.all(np.std(tilt - true, axis=0) < np.radians(0.2))
    assert np.all(np.std(true, axis=0) > np.radians(0.8))


def test_without_an_ahrs_the_motion_is_levelled_by_an_imu_that_is_named(waves: Mission) -> None:
    start = align(waves)
    level = vehicle_motion(waves, start, MotionSettings())
    swaying = vehicle_motion(waves, start, MotionSettings(), waves.sensors["imu"])
    assert not np.any(level.rpy[:, :2])
    off = swaying.rpy[:, :2] - true_tilt(waves, swaying.t)
    assert np.all(np.std(off, axis=0) < np.radians(0.3))


def test_a_vehicle_upside_down_is_levelled_across_the_wrap() -> None:
    """It rocks slowly about a roll of 180 degrees."""
    t = np.arange(0.0, 60.0, 0.05)
    rocking = 0.2 * np.sin(0.3 * t)
    force = -9.81 * np.column_stack([0.0 * t, -np.sin(rocking), -np.cos(rocking)])
    rate = np.column_stack([0.06 * np.cos(0.3 * t), 0.0 * t, 0.0 * t])
    imu = Sensor("imu", "imu", ImuSeries(t=t, gyro_i=rate, accel_i=force))
    tilt = tilt_by(imu, t)
    np.testing.assert_allclose(wrap_angle(tilt[:, 0] - np.pi), rocking, atol=0.02)
    assert np.max(np.abs(np.diff(tilt[:, 0]))) < 0.01
