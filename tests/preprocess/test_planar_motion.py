"""Planar dead reckoning: displacements, turns and how their noise adds up."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rovers import SIGMA_V_M_S, SIGMA_YAW_RATE_RAD_S, STEP_S, rover, truth

from gtsam_nav.errors import DataError
from gtsam_nav.frames import wrap_angle
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.preprocess.planar_motion import PlanarMotion, planar_motion
from gtsam_nav.preprocess.settings import MotionSettings
from gtsam_nav.series import AttitudeSeries, BoolArray, DvlSeries, HeadingSeries, OdometrySeries

SETTINGS = MotionSettings()
MINUTE_S = np.arange(0.0, 60.0, 0.2)


def motion_of(mission: Mission) -> PlanarMotion:
    motion = planar_motion(mission, SETTINGS)
    assert motion is not None
    return motion


def odometry_of(mission: Mission) -> OdometrySeries:
    series = mission.sensors["odometry"].series
    assert isinstance(series, OdometrySeries)
    return series


def test_odometry_is_integrated_along_its_course() -> None:
    t, p, course, _ = truth(24.0)
    motion = motion_of(rover(noise=0.0, duration_s=24.0))
    walked, turned, _ = motion.at(t)
    np.testing.assert_allclose(walked, p - p[0], atol=1e-3)
    np.testing.assert_allclose(turned, course, atol=1e-9)
    assert not motion.course_is_heading


def test_increments_are_in_the_axes_of_their_start() -> None:
    t, p, course, _ = truth(24.0)
    some = np.arange(0, len(t), 40)
    increments = motion_of(rover(noise=0.0, duration_s=24.0)).increments(t[some])
    step = np.diff(p[some], axis=0)
    c, s = np.cos(course[some[:-1]]), np.sin(course[some[:-1]])
    along = np.column_stack([c * step[:, 0] + s * step[:, 1], c * step[:, 1] - s * step[:, 0]])
    np.testing.assert_allclose(increments.displacement_b, along, atol=1e-3)
    np.testing.assert_allclose(increments.turn, np.diff(course[some]), atol=1e-9)


def test_white_noise_of_each_reading_adds_up() -> None:
    variance = motion_of(rover(duration_s=10.0)).increments(np.array([1.0, 5.0])).variance[0]
    expected = np.array([SIGMA_V_M_S, SIGMA_V_M_S, SIGMA_YAW_RATE_RAD_S]) ** 2 * 4.0 * STEP_S
    np.testing.assert_allclose(variance, expected, rtol=0.1)


def test_the_variance_is_that_of_many_drawn_runs() -> None:
    ends = np.array([motion_of(rover(seed=k, duration_s=4.0)).course[-1] for k in range(300)])
    assert np.var(ends) == pytest.approx(motion_of(rover(duration_s=4.0)).variance[-1, 2], rel=0.25)


def test_a_silence_costs_certainty() -> None:
    mission = rover(duration_s=20.0)
    series = odometry_of(mission)
    gap = (series.t < 8.0) | (series.t > 12.0)
    silent = mission.with_sensor(replace(mission.sensors["odometry"], series=series.select(gap)))
    span = np.array([8.0, 12.0])
    bridged = motion_of(silent).increments(span).variance[0]
    assert np.all(bridged > 10 * motion_of(mission).increments(span).variance[0])


def test_speeds_of_a_vehicle_that_leans_are_level() -> None:
    """Bow up by half of a right angle, and upside down."""
    n = len(MINUTE_S)
    bottom = np.ones(n, dtype=bool)
    mission = dived(bottom_lock=bottom, valid=bottom, sigma=0.01)
    dvl = mission.sensors["dvl"]
    assert isinstance(dvl.series, DvlSeries)
    askew = replace(dvl, series=replace(dvl.series, v_d=np.tile([0.5, 0.1, 0.0], (n, 1))))
    for roll, pitch, v_level in (
        (0.0, np.pi / 4, [0.5 * np.sqrt(0.5), 0.1]),
        (np.pi, 0.0, [0.5, -0.1]),
    ):
        tilt = AttitudeSeries(
            t=MINUTE_S, roll=np.full(n, roll), pitch=np.full(n, pitch), sigma=np.full(n, 0.01)
        )
        leaning = mission.with_sensor(askew).with_sensor(Sensor("attitude", "attitude", tilt))
        p, _, _ = motion_of(leaning).at(MINUTE_S[[-1]])
        np.testing.assert_allclose(p[0], np.array(v_level) * MINUTE_S[-1], atol=1e-6)


def dived(*, bottom_lock: BoolArray, valid: BoolArray, sigma: float) -> Mission:
    """Straight ahead at 0.5 m/s by a DVL, for a minute."""
    n = len(MINUTE_S)
    v_d = np.tile([0.5, 0.0, 0.0], (n, 1))
    dvl = DvlSeries(
        t=MINUTE_S, v_d=v_d, sigma=np.full(n, sigma), valid=valid, bottom_lock=bottom_lock
    )
    heading = HeadingSeries(t=MINUTE_S, heading=np.zeros(n), sigma=np.full(n, 0.01))
    noise = {"water_sigma_m_s": 0.1}
    sensors = (Sensor("dvl", "dvl", dvl, noise=noise), Sensor("heading", "heading", heading))
    return Mission("boat", {sensor.name: sensor for sensor in sensors})


def test_a_silence_of_a_dvl_holds_the_noise_of_its_ends() -> None:
    """The way is a sum over the pings: each weighs half of the time to its neighbours."""
    heard = (MINUTE_S < 20.0) | (MINUTE_S > 24.0)
    mission = dived(bottom_lock=heard, valid=heard, sigma=0.03)
    motion = planar_motion(mission, MotionSettings(sigma_accel_m_s2=1e-9))
    assert motion is not None
    pings_s = MINUTE_S[heard]
    weights = np.trapezoid(np.eye(len(pings_s)), pings_s, axis=1)
    assert motion.variance[-1, 0] == pytest.approx(np.sum(np.square(0.03 * weights)), rel=1e-6)


def test_the_noise_of_wheels_comes_with_the_motion_however_often_it_is_told() -> None:
    mission = rover(duration_s=20.0)
    series = odometry_of(mission)
    silent = series.select((series.t < 8.0) | (series.t > 12.0))
    calm = MotionSettings(sigma_accel_m_s2=1e-9, sigma_yaw_accel_rad_s2=1e-9)
    told = planar_motion(mission, calm)
    seldom = planar_motion(
        mission.with_sensor(replace(mission.sensors["odometry"], series=silent)), calm
    )
    assert told is not None
    assert seldom is not None
    np.testing.assert_allclose(seldom.variance[-1], told.variance[-1], rtol=1e-6)


def test_a_current_moves_the_vehicle_all_along_a_spell_of_water_lock() -> None:
    """One velocity, not noise that averages out: the sigma of the way grows with the time."""
    on_bottom = (MINUTE_S < 20.0) | (MINUTE_S > 50.0)
    mission = dived(bottom_lock=on_bottom, valid=np.ones_like(on_bottom), sigma=1e-3)
    before, half, whole, after = np.sqrt(motion_of(mission).at(np.array([19, 35, 50, 59]))[2][:, 0])
    assert before < 0.05
    assert half == pytest.approx(0.1 * 15.0, rel=0.05)
    assert whole == pytest.approx(0.1 * 30.0, rel=0.05)
    assert after == pytest.approx(whole, rel=0.01)


def test_a_step_late_in_a_spell_of_water_lock_is_as_good_as_an_early_one() -> None:
    mission = dived(
        bottom_lock=MINUTE_S < 5.0, valid=np.ones(len(MINUTE_S), dtype=bool), sigma=1e-3
    )
    early, late = motion_of(mission).increments(np.array([10.0, 12.0, 50.0, 52.0])).variance[::2, 0]
    assert late == pytest.approx(early)
    assert 0.2**2 <= late <= 0.3**2


def test_a_compass_is_the_course() -> None:
    mission = rover(duration_s=20.0)
    t, _, course, _ = truth(20.0)
    heading = HeadingSeries(t=t, heading=wrap_angle(course + 1.0), sigma=np.full(len(t), 0.01))
    motion = motion_of(mission.with_sensor(Sensor("heading", "heading", heading)))
    assert motion.course_is_heading
    assert motion.curvature_sigma == 0.0
    np.testing.assert_allclose(np.diff(motion.at(t)[1]), np.diff(course), atol=1e-9)
    np.testing.assert_allclose(wrap_angle(motion.at(t)[1] - course - 1.0), 0.0, atol=1e-9)


def with_silent_compass(mission: Mission, stop_s: float, off: float = 0.0) -> Mission:
    """A compass that falls silent at 5 s; afterwards it is off."""
    t, _, course, _ = truth(20.0)
    kept = (t < 5.0) | (t > stop_s)
    heading = HeadingSeries(
        t=t[kept],
        heading=wrap_angle(course + 1.0 + np.where(t > stop_s, off, 0.0))[kept],
        sigma=np.full(int(kept.sum()), 0.01),
    )
    return mission.with_sensor(Sensor("heading", "heading", heading))


@pytest.mark.parametrize("stop_s", [15.0, np.inf], ids=["gap", "early end"])
def test_while_a_compass_is_silent_the_wheels_tell_the_turn(stop_s: float) -> None:
    t, _, course, _ = truth(20.0)
    mission = rover(noise=0.0, duration_s=20.0)
    motion = motion_of(with_silent_compass(mission, stop_s))
    _, found, variance = motion.at(t)
    np.testing.assert_allclose(wrap_angle(found - course - 1.0), 0.0, atol=1e-3)
    alone = motion_of(mission).at(t)[2]
    grown, expected = (
        np.interp(14.0, t, v) - np.interp(6.0, t, v) for v in (variance[:, 2], alone[:, 2])
    )
    assert grown > expected
    assert motion.course_is_heading


def test_wheels_bend_the_course_over_the_way_that_a_silent_compass_misses() -> None:
    wheels = rover(noise=0.0, duration_s=20.0).sensors["odometry"]
    uneven = replace(wheels, noise={"curvature_sigma_deg_m": 1.0})
    mission = Mission("rover", {"odometry": uneven})
    motion = motion_of(with_silent_compass(mission, 15.0))
    alone = motion_of(mission)
    assert motion.curvature_sigma == alone.curvature_sigma > 0.0
    within = np.array([4.0, 8.0, 12.0])
    bent_m, way_m = (m.increments(within).bent_m for m in (motion, alone))
    unheard_m = alone.increments(np.array([4.9, 8.0])).bent_m
    np.testing.assert_allclose(bent_m, [unheard_m[0], way_m[1]], atol=0.1)
    # its first heading takes off what they had turned
    back, after = motion.increments(np.array([12.0, 16.0, 19.0])).bent_m
    assert back == pytest.approx(-np.sum(bent_m))
    assert after == 0.0


def test_what_a_compass_says_after_a_silence_does_not_change_what_was_before() -> None:
    t, _, course, _ = truth(20.0)
    back = motion_of(with_silent_compass(rover(noise=0.0, duration_s=20.0), 15.0, off=0.2))
    found = wrap_angle(back.at(t)[1] - course - 1.0)
    np.testing.assert_allclose(found[t < 14.8], 0.0, atol=1e-3)
    np.testing.assert_allclose(found[t > 15.2], 0.2, atol=1e-3)


def test_a_dvl_with_a_compass_moves_a_vehicle() -> None:
    t, p, course, _ = truth(20.0)
    n = len(t)
    dvl = DvlSeries(
        t=t,
        v_d=np.tile([0.5, 0.0, 0.0], (n, 1)),
        sigma=np.full(n, 0.01),
        valid=np.ones(n, dtype=bool),
        bottom_lock=np.ones(n, dtype=bool),
    )
    heading = HeadingSeries(t=t, heading=wrap_angle(course), sigma=np.full(n, 0.01))
    sensors = (Sensor("dvl", "dvl", dvl), Sensor("heading", "heading", heading))
    mission = Mission("boat", {sensor.name: sensor for sensor in sensors})
    walked, _, _ = motion_of(mission).at(t)
    np.testing.assert_allclose(walked, p - p[0], atol=0.02)
    with pytest.raises(DataError, match="a DVL alone tells no turns"):
        planar_motion(mission.without("heading"), SETTINGS)


def test_nothing_that_moves_is_no_motion() -> None:
    assert planar_motion(rover(duration_s=5.0).without("odometry"), SETTINGS) is None


BRISK = MotionSettings(sigma_accel_m_s2=5.0, sigma_yaw_accel_rad_s2=50.0)
CALM = MotionSettings(sigma_accel_m_s2=1e-9, sigma_yaw_accel_rad_s2=1e-9)


def test_readings_that_suffice_leave_no_walk_between_them() -> None:
    always = np.ones(len(MINUTE_S), dtype=bool)
    mission = dived(bottom_lock=always, valid=always, sigma=0.03)
    walking = planar_motion(mission, BRISK)
    told = planar_motion(mission, BRISK, readings_suffice=True)
    calm = planar_motion(mission, CALM)
    assert walking is not None
    assert told is not None
    assert calm is not None
    np.testing.assert_allclose(told.variance[-1], calm.variance[-1], rtol=1e-3)
    assert walking.variance[-1, 0] > 1.5 * told.variance[-1, 0]


def test_wheels_follow_the_vehicle_at_their_usual_rate() -> None:
    """Their readings are of all that it does; only while they are silent something is missed."""
    mission = rover(0, duration_s=20.0)
    series = odometry_of(mission)
    silent = series.select((series.t < 8.0) | (series.t > 12.0))
    gap = mission.with_sensor(replace(mission.sensors["odometry"], series=silent))
    brisk, calm, missed = (
        planar_motion(m, s) for m, s in ((mission, BRISK), (mission, CALM), (gap, BRISK))
    )
    assert brisk is not None
    assert calm is not None
    assert missed is not None
    np.testing.assert_allclose(brisk.variance[-1], calm.variance[-1], rtol=1e-3)
    assert np.all(missed.variance[-1] > 1.5 * calm.variance[-1])
