"""A yaw that no compass tells, shown by the first fixes beside measured velocities."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import gtsam_nav as gn
from gtsam_nav.ekf.error_state import yaw_variance
from gtsam_nav.ekf.inertial_start import inertial_start
from gtsam_nav.ekf.yaw_by_fixes import yaw_shown_by_fixes
from gtsam_nav.frames import wrap_angle
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.preprocess.alignment import align
from gtsam_nav.preprocess.settings import MotionSettings
from gtsam_nav.series import BoolArray, ReferenceSeries
from gtsam_nav.simulation import SimulationSettings
from gtsam_nav.trajectory import UNIFORM_YAW_SIGMA

UNHEADED = ("heading", "attitude", "odometry", "landmarks")


def unheaded(seed: int, duration_s: float) -> Mission:
    settings = SimulationSettings(sonar=None, landmarks=None)
    return gn.simulate("marina", seed, duration_s, settings).without(*UNHEADED)


def test_the_way_turned_onto_the_fixes_tells_the_yaw() -> None:
    mission = unheaded(2, 70.0)
    shown = yaw_shown_by_fixes(mission, mission.sensors["imu"], align(mission), MotionSettings())
    truth = mission.sensors["reference"].series
    assert isinstance(truth, ReferenceSeries)
    assert truth.rpy is not None
    assert shown is not None
    assert shown.in_world
    assert np.radians(1.0) < shown.sigma < np.radians(30.0)
    assert abs(wrap_angle(shown.yaw - truth.rpy[0, 2])) < 3.0 * shown.sigma


def test_fixes_too_close_together_leave_the_yaw_to_the_local_frame() -> None:
    mission = unheaded(2, 30.0)
    gnss = mission.sensors["gnss"]
    few = mission.with_sensor(replace(gnss, series=gnss.series.crop(0.0, 3.0)))
    shown = yaw_shown_by_fixes(few, few.sensors["imu"], align(few), MotionSettings())
    assert shown is not None
    assert not shown.in_world
    assert not gn.estimate(few, "ins-ekf").georeferenced


def test_a_gyro_that_is_silent_tells_less_or_nothing() -> None:
    mission = unheaded(2, 70.0)
    imu, start = mission.sensors["imu"], align(mission)
    known, less = (
        yaw_shown_by_fixes(mission.with_sensor(one), one, start, MotionSettings())
        for one in (imu, replace(imu, series=imu.series.select(~inside(imu, 20.0, 21.0))))
    )
    assert known is not None
    assert less is not None
    assert less.sigma > known.sigma + np.radians(1.0)
    late = replace(imu, series=imu.series.select(~inside(imu, 0.0, 55.0)))
    assert yaw_shown_by_fixes(mission.with_sensor(late), late, start, MotionSettings()) is None


def test_a_vehicle_that_is_known_to_turn_quickly_turns_further_unseen() -> None:
    mission = unheaded(2, 70.0)
    imu = mission.sensors["imu"]
    silent = replace(imu, series=imu.series.select(~inside(imu, 20.0, 20.5)))
    mission = mission.with_sensor(silent)
    usual = MotionSettings()
    quick = MotionSettings(sigma_yaw_accel_rad_s2=1.5 * usual.sigma_yaw_accel_rad_s2)
    starts = [inertial_start(mission, silent, settings) for settings in (usual, quick)]
    less, more = (yaw_variance(start.state, start.P) for start in starts)
    assert more > 1.2 * less


def inside(sensor: Sensor, from_s: float, to_s: float) -> BoolArray:
    return np.asarray((sensor.series.t >= from_s) & (sensor.series.t < to_s))


def test_a_yaw_is_worth_starting_from_as_long_as_anything_is_known_of_it() -> None:
    mission = unheaded(2, 130.0)
    gnss, start = mission.sensors["gnss"], align(mission)
    late = mission.with_sensor(replace(gnss, series=gnss.series.crop(60.0, np.inf)))
    shown = yaw_shown_by_fixes(late, late.sensors["imu"], start, MotionSettings())
    assert shown is not None
    assert np.radians(45.0) < shown.sigma < UNIFORM_YAW_SIGMA


def test_without_fixes_or_velocities_nothing_is_shown() -> None:
    mission = unheaded(2, 20.0)
    for lacking in ("gnss", "dvl"):
        less = mission.without(lacking)
        assert yaw_shown_by_fixes(less, less.sensors["imu"], align(less), MotionSettings()) is None


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 3])
def test_the_filter_starts_in_the_direction_that_the_fixes_show(seed: int) -> None:
    config = gn.load_config(None, ("gnss.use=window", "gnss.window_s=[0,120]"))
    ate = gn.evaluate(gn.estimate(unheaded(seed, 200.0), "ins-ekf", config)).ate.none
    assert ate is not None
    assert ate.mean < 2.0
