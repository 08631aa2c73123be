"""The vehicle's own motion: exact where the sensors are, and clear about what it left out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array, rotation_from_rpy, wrap_angle
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.preprocess.alignment import Alignment, align
from gtsam_nav.preprocess.motion import VehicleMotion, vehicle_motion
from gtsam_nav.preprocess.settings import MotionSettings
from gtsam_nav.series import (
    AttitudeSeries,
    DvlSeries,
    HeadingSeries,
    ImuSeries,
    OdometrySeries,
    ReferenceSeries,
)
from gtsam_nav.simulation import SimulationSettings, simulate

DURATION_S = 60.0
SETTINGS = MotionSettings()
V_B = np.array([0.6, -0.1, 0.05])


def times(rate_hz: float, start_s: float = 0.0) -> Array:
    return start_s + np.arange(DURATION_S * rate_hz) / rate_hz


def dvl(v_b: Array = V_B, t: Array | None = None, sigma: float = 0.03, name: str = "dvl") -> Sensor:
    t = times(2.0) if t is None else t
    n = len(t)
    series = DvlSeries(
        t=t,
        v_d=np.broadcast_to(v_b, (n, 3)).copy(),
        sigma=np.full(n, sigma),
        valid=np.ones(n, dtype=bool),
        bottom_lock=np.ones(n, dtype=bool),
    )
    return Sensor(name, "dvl", series)


def blinded(sensor: Sensor) -> Sensor:
    """A DVL that never saw the bottom, nor the water."""
    nothing = np.zeros(len(sensor.series), dtype=bool)
    return replace(sensor, series=replace(sensor.series, valid=nothing, bottom_lock=nothing))  # type: ignore[call-arg]


def odometry(speed_m_s: float = 0.5, yaw_rate: float = 0.1) -> Sensor:
    t = times(10.0)
    one = np.ones(len(t))
    series = OdometrySeries(
        t=t,
        v_b=np.outer(one, [speed_m_s, 0.0]),
        yaw_rate=yaw_rate * one,
        sigma_v=0.1 * one,
        sigma_yaw_rate=0.05 * one,
    )
    return Sensor("wheels", "odometry", series)


def compass(heading: Array, t: Array, sigma: float = 0.01) -> Sensor:
    series = HeadingSeries(t=t, heading=wrap_angle(heading), sigma=np.full(len(t), sigma))
    return Sensor("heading", "heading", series)


def clinometer(roll: float, pitch: float) -> Sensor:
    t = times(10.0)
    one = np.ones(len(t))
    series = AttitudeSeries(t=t, roll=roll * one, pitch=pitch * one, sigma=0.01 * one)
    return Sensor("attitude", "attitude", series)


def imu(omega_b: Array, R_bi: Array, bias_i: Array) -> Sensor:
    t = times(50.0)
    gyro_i = np.broadcast_to(omega_b, (len(t), 3)) @ R_bi + bias_i
    series = ImuSeries(t=t, gyro_i=gyro_i, accel_i=np.tile([0.0, 0.0, -9.81], (len(t), 1)))
    return Sensor("imu", "imu", series, R_bs=R_bi)


def mission(*sensors: Sensor) -> Mission:
    return Mission("m", {s.name: s for s in sensors})


def moved(*sensors: Sensor, start: Alignment | None = None) -> VehicleMotion:
    one = mission(*sensors)
    return vehicle_motion(one, start or align(one), SETTINGS)


def test_a_straight_course_is_exact() -> None:
    roll, pitch, yaw = 0.1, -0.2, 2.5
    t = times(10.0)
    motion = moved(dvl(), compass(np.full(len(t), yaw), t), clinometer(roll, pitch))
    v_n = rotation_from_rpy([roll, pitch, yaw]) @ V_B
    np.testing.assert_allclose(motion.p_n, motion.t[:, None] * v_n, atol=1e-9)
    np.testing.assert_allclose(motion.v_b, np.tile(V_B, (len(motion.t), 1)), atol=1e-12)
    np.testing.assert_allclose(
        motion.rpy, np.tile([roll, pitch, yaw], (len(motion.t), 1)), atol=1e-9
    )
    trajectory = motion.trajectory
    assert trajectory.v_n is not None
    np.testing.assert_allclose(trajectory.v_n, np.tile(v_n, (len(motion.t), 1)), atol=1e-9)
    np.testing.assert_array_equal(trajectory.p_n, motion.p_n)
    assert motion.rejections == ()


def test_it_starts_where_the_alignment_says() -> None:
    start = Alignment(
        0.0, np.array([3.0, 4.0, 5.0]), np.ones(3), np.array([0, 0, 1.0]), np.ones(3), True
    )
    motion = moved(dvl(), start=start)
    np.testing.assert_array_equal(motion.p_n[0], start.p_n)
    np.testing.assert_allclose(motion.rpy[:, 2], 1.0)  # nothing turns it


def test_the_grid_covers_the_mission() -> None:
    start_s, stop_s = 7.03, 7.03 + DURATION_S + 0.217
    t = np.append(times(2.0, start_s), stop_s)
    motion = moved(dvl(t=t))
    assert (motion.t[0], motion.t[-1]) == (start_s, stop_s)
    assert np.diff(motion.t).max() <= 1 / SETTINGS.rate_hz + 1e-9
    assert np.diff(motion.t).min() > 0


def test_places_between_the_grid_are_interpolated() -> None:
    motion = moved(odometry())
    p_n, rpy = motion.at(np.array([0.05, 30.0]))
    np.testing.assert_allclose(p_n[0], (motion.p_n[0] + motion.p_n[1]) / 2)
    np.testing.assert_allclose(rpy[0], (motion.rpy[0] + motion.rpy[1]) / 2)
    np.testing.assert_allclose(p_n[1], motion.p_n[300])


def test_a_motion_upside_down_is_so_between_its_times() -> None:
    t = times(10.0)
    rolled = wrap_angle(np.pi + 0.02 * np.where(np.arange(len(t)) % 2, 1.0, -1.0))
    one = np.ones(len(t))
    ahrs = AttitudeSeries(t=t, roll=rolled, pitch=0.0 * t, sigma=0.01 * one)
    motion = moved(dvl(), compass(0.0 * t, t), Sensor("attitude", "attitude", ahrs))
    _, rpy = motion.at(np.arange(10.0, 50.0, 0.033))
    assert np.max(np.abs(wrap_angle(rpy[:, 0] - np.pi))) < 0.021


def test_odometry_alone_drives_a_circle() -> None:
    speed, rate = 0.5, 0.1
    motion = moved(odometry(speed, rate))
    radius = speed / rate
    expected = radius * np.column_stack([np.sin(rate * motion.t), 1 - np.cos(rate * motion.t)])
    np.testing.assert_allclose(motion.rpy[:, 2], rate * motion.t, atol=1e-12)
    np.testing.assert_allclose(motion.p_n[:, :2], expected, atol=1e-3)
    np.testing.assert_array_equal(motion.p_n[:, 2], 0.0)
    assert motion.yaw_variance_rad2_s == pytest.approx(0.05**2 * 0.1)
    np.testing.assert_array_equal(motion.gyro_bias_b, np.zeros(3))


def test_odometry_steps_in_for_a_blind_dvl() -> None:
    motion = moved(blinded(dvl()), odometry(0.5, 0.0))
    assert motion.p_n[-1, 0] == pytest.approx(0.5 * motion.t[-1])
    assert {(r.sensor, r.reason) for r in motion.rejections} == {("dvl", "no lock")}
    assert len(motion.rejections) == len(times(2.0))


def test_a_second_dvl_steps_in_for_a_blind_one() -> None:
    motion = moved(blinded(dvl(name="old")), dvl(name="new"), odometry(9.0))
    np.testing.assert_allclose(motion.v_b[0], V_B)
    assert {r.sensor for r in motion.rejections} == {"old"}


@pytest.mark.parametrize("sensors", [(), (blinded(dvl()),)], ids=["none", "blind"])
def test_without_velocity_the_error_names_what_there_is(sensors: tuple[Sensor, ...]) -> None:
    with pytest.raises(DataError) as caught:
        moved(*sensors, clinometer(0.0, 0.0), compass(times(10.0), times(10.0)))
    present = ", ".join(sorted([*(s.name for s in sensors), "attitude", "heading"]))
    assert "mission 'm': the velocity needs a DVL with valid samples or odometry" in str(
        caught.value
    )
    assert str(caught.value).endswith(f"the mission has: {present}")


@pytest.mark.filterwarnings("error")
def test_where_a_single_reading_is_left_the_place_is_soon_unknown() -> None:
    """As of a log in other units, which starts at rest."""
    v_b = np.tile(1000.0 * V_B, (len(times(2.0)), 1))
    v_b[0] = 0.0
    motion = moved(dvl(v_b), compass(np.zeros(600), times(10.0)), clinometer(0.0, 0.0))
    assert len(motion.rejections) == len(v_b) - 1
    walked = SETTINGS.sigma_accel_m_s2**2 * motion.t[-1] ** 3 / 3
    assert motion.position_variance[-1] == pytest.approx(walked, rel=0.01)


def test_spikes_are_rejected_and_named() -> None:
    clean = dvl()
    assert isinstance(clean.series, DvlSeries)
    v_d = clean.series.v_d.copy()
    v_d[[20, 70], [0, 2]] += [2.0, -1.0]
    kept = np.delete(np.arange(len(v_d)), 33)  # so that rows are not places in the series
    spiked = replace(clean.series, v_d=v_d).select(kept)
    motion = moved(replace(clean, series=spiked))
    found = [(r.t, r.sensor, r.index, r.reason) for r in motion.rejections]
    assert found == [(10.0, "dvl", 20, "velocity spike"), (35.0, "dvl", 70, "velocity spike")]
    # the other axes of a rejected sample may stay
    np.testing.assert_allclose(motion.v_b, np.tile(V_B, (len(motion.t), 1)), atol=1e-9)


def test_a_vehicle_that_speeds_up_is_followed() -> None:
    clean = dvl()
    assert isinstance(clean.series, DvlSeries)
    v_d = clean.series.v_d.copy()
    v_d[:, 0] = 2.5 * np.clip((clean.series.t - 20.0) / 3.0, 0.0, 1.0)
    motion = moved(replace(clean, series=replace(clean.series, v_d=v_d)))
    assert motion.rejections == ()
    speed = np.linalg.norm(motion.v_b, axis=1)
    assert speed[motion.t < 15.0].max() < 0.2
    assert speed[motion.t > 28.0].min() > 2.3


def test_the_lever_arm_of_the_dvl_is_taken_off() -> None:
    rate, arm_b = 0.2, np.array([1.5, 0.0, 0.3])
    turn = imu(np.array([0.0, 0.0, rate]), np.eye(3), np.zeros(3))
    sensor = replace(dvl(V_B + np.cross([0.0, 0.0, rate], arm_b)), xyz_b=arm_b)
    v_b = moved(sensor, turn).v_b
    np.testing.assert_allclose(v_b, np.tile(V_B, (len(v_b), 1)), atol=1e-9)


@pytest.mark.parametrize("bias_deg_s", [0.0, 0.6, -2.0])
def test_the_gyro_bias_is_found_against_the_compass(bias_deg_s: float) -> None:
    R_bi = rotation_from_rpy([0.1, -0.2, 1.6])
    rate, bias_i = 0.05, R_bi.T @ np.radians([0.3, -0.5, bias_deg_s])
    rng = np.random.default_rng(1)
    t = times(10.0)
    heading = 1.0 + rate * t + rng.normal(scale=0.01, size=len(t))
    motion = moved(dvl(), imu(np.array([0.0, 0.0, rate]), R_bi, bias_i), compass(heading, t))
    np.testing.assert_allclose(motion.gyro_bias_b, R_bi @ bias_i, atol=3e-4)
    error = wrap_angle(motion.rpy[:, 2] - 1.0 - rate * motion.t)
    assert np.abs(error[motion.t < t[-1]]).max() < 0.01  # better than one reading


def test_the_gyro_bias_does_not_turn_into_a_velocity_of_the_lever_arm() -> None:
    """At rest, a DVL a metre ahead of the origin: a bias would move the origin sideways."""
    t = times(10.0)
    ahead = replace(dvl(np.zeros(3)), xyz_b=np.array([1.0, 0.0, 0.5]))
    biased = imu(np.zeros(3), np.eye(3), np.array([0.01, -0.01, 0.02]))
    found = moved(ahead, biased, compass(np.zeros(len(t)), t))
    assert np.max(np.abs(found.v_b)) < 2e-3
    assert np.max(np.abs(found.p_n)) < 0.02


def test_the_gyro_carries_the_heading_between_rare_readings() -> None:
    """Half a turn and more between readings of the compass."""
    rate, t = 0.5, times(0.1)
    turn = imu(np.array([0.0, 0.0, rate]), np.eye(3), np.array([0.0, 0.0, 1e-3]))
    motion = moved(dvl(), turn, compass(rate * t, t))
    inside = motion.t <= t[-1]
    np.testing.assert_allclose(motion.rpy[inside, 2], rate * motion.t[inside], atol=0.01)


def test_where_the_gyro_falls_silent_the_compass_turns_the_vehicle() -> None:
    rate, t = 0.05, times(10.0)
    whole = imu(np.array([0.0, 0.0, rate]), np.eye(3), np.zeros(3))
    for silence in ((20.0, 35.0), (30.0, np.inf)):
        kept = (whole.series.t < silence[0]) | (whole.series.t >= silence[1])
        motion = moved(
            dvl(), replace(whole, series=whole.series.select(kept)), compass(rate * t, t)
        )
        error = wrap_angle(motion.rpy[:, 2] - rate * motion.t)
        assert np.abs(error[motion.t < t[-1]]).max() < np.radians(0.3)


def test_wheels_do_not_overrule_a_slow_gyro() -> None:
    """At one sample a second no step is a silence, though it is longer than half a second."""
    gyro = imu(np.array([0.0, 0.0, 0.05]), np.eye(3), np.zeros(3))
    slow = replace(gyro, series=gyro.series.select(np.arange(len(gyro.series)) % 50 == 0))
    motion = moved(slow, odometry(yaw_rate=0.1))
    assert motion.rpy[-1, 2] == pytest.approx(0.05 * (motion.t[-1] - motion.t[0]))
    assert motion.yaw_variance_rad2_s == moved(gyro, dvl()).yaw_variance_rad2_s


def test_a_turn_that_wheels_tell_is_as_uncertain_as_theirs() -> None:
    """By the noise of their rates and by what they do not notice, over the gyro's silence."""
    gyro = imu(np.array([0.0, 0.0, 0.1]), np.eye(3), np.zeros(3))
    kept = (gyro.series.t < 20.0) | (gyro.series.t > 40.0)
    silent = replace(gyro, series=gyro.series.select(kept))
    whole, motion = moved(gyro, odometry()), moved(silent, odometry())
    added = (motion.yaw_variance_rad2_s - whole.yaw_variance_rad2_s) * (motion.t[-1] - motion.t[0])
    assert added == pytest.approx(20.0 * 0.05**2 * 0.1 + np.radians(1.0 * 10.0) ** 2, rel=0.02)


LATE_TURN = np.array([0.0, 35.0, 45.0, 60.0]), np.array([0.0, 0.0, 4.0, 4.0])
"""When, s, and how far, rad, a vehicle turns: more than half a circle."""


def test_within_a_silence_of_the_gyro_the_compass_says_when_the_vehicle_turned() -> None:
    t = times(50.0)
    kept = (t < 20.0) | (t > 50.0)
    rate = np.where((t > 35.0) & (t < 45.0), 0.4, 0.0)
    gyro = imu(np.outer(rate, [0.0, 0.0, 1.0]), np.eye(3), np.zeros(3))
    gyro = replace(gyro, series=gyro.series.select(kept))
    t = times(10.0)
    motion = moved(dvl(), gyro, compass(np.interp(t, *LATE_TURN), t))
    error = wrap_angle(motion.rpy[:, 2] - np.interp(motion.t, *LATE_TURN))
    assert np.abs(error).max() < np.radians(2.0)


@pytest.mark.parametrize("stop_s", [50.0, np.inf], ids=["gap", "early end"])
def test_within_a_silence_of_the_compass_the_wheels_turn_the_vehicle(stop_s: float) -> None:
    t = times(10.0)
    drifting = 0.002
    rate = np.where((t > 35.0) & (t < 45.0), 0.4, 0.0) + drifting
    wheels = odometry()
    wheels = replace(wheels, series=replace(wheels.series, yaw_rate=rate))  # type: ignore[call-arg]
    kept = (t < 20.0) | (t > stop_s)
    motion = moved(wheels, compass(np.interp(t, *LATE_TURN)[kept], t[kept]))
    error = wrap_angle(motion.rpy[:, 2] - np.interp(motion.t, *LATE_TURN))
    assert np.abs(error).max() < drifting * 40.0 + 0.03
    assert np.abs(error[motion.t < 20.0]).max() < 0.01
    assert np.all(np.abs(error[motion.t > stop_s]) < 0.01)


def test_wheels_that_stop_telling_turn_no_further() -> None:
    """The vehicle keeps its heading where nothing says otherwise."""
    wheels = odometry()
    wheels = replace(wheels, series=wheels.series.select(wheels.series.t < 30.0))
    assert moved(wheels, dvl()).rpy[-1, 2] == pytest.approx(0.1 * 29.9)


def test_a_compass_alone_is_smoothed_across_the_wrap() -> None:
    rng = np.random.default_rng(2)
    t = times(10.0)
    heading = 3.0 + 0.05 * t
    motion = moved(dvl(), compass(heading + rng.normal(scale=0.02, size=len(t)), t, 0.02))
    error = np.interp(t, motion.t, motion.rpy[:, 2]) - heading
    assert np.sqrt(np.mean(error**2)) < 0.02 / 1.5


def test_the_velocity_is_as_uncertain_as_stated_where_readings_lack() -> None:
    rng, step_s, sigma = np.random.default_rng(4), 0.1, 0.03
    t = times(10.0)
    silent = (t + 1.5) % 6.0 < 3.0
    normalised = []
    for _ in range(40):
        walk = np.cumsum(
            SETTINGS.sigma_accel_m_s2 * np.sqrt(step_s) * rng.normal(size=(len(t), 3)), 0
        )
        readings = walk + sigma * rng.normal(size=walk.shape)
        motion = moved(dvl(readings[~silent], t[~silent], sigma), clinometer(0.0, 0.0))
        error = np.interp(t, motion.t, motion.v_b[:, 0]) - walk[:, 0]
        normalised.append(error / np.interp(t, motion.t, motion.sigma_v))
    squared = np.mean(np.square(normalised), axis=0)
    assert np.mean(squared[silent]) == pytest.approx(1.0, abs=0.15)
    assert np.mean(squared[~silent]) == pytest.approx(1.0, abs=0.15)


def test_the_noise_walks_the_position_as_far_as_stated() -> None:
    rng, sigma, t = np.random.default_rng(3), 0.1, times(2.0)
    ends = []
    for _ in range(200):
        noisy = dvl(sigma * rng.normal(size=(len(t), 3)), sigma=sigma)
        motion = moved(noisy)
        ends.append(motion.p_n[-1, :2])
    stated = motion.position_variance_m2_s * DURATION_S
    assert np.mean(np.square(ends)) == pytest.approx(stated, rel=0.2)


def test_a_simulated_survey_is_followed() -> None:
    outing = simulate(seed=4, duration_s=300.0, settings=SimulationSettings.matched())
    assert outing.reference is not None
    truth = outing.reference.series
    assert isinstance(truth, ReferenceSeries)
    blind = outing.without("reference", "odometry")
    motion = vehicle_motion(blind, align(blind), SETTINGS)
    p_n, rpy = motion.at(truth.t)
    assert truth.rpy is not None
    error_m = np.linalg.norm((p_n - p_n[0] - truth.p_n + truth.p_n[0])[:, :2], axis=1)
    way_m = np.linalg.norm(np.diff(truth.p_n, axis=0), axis=1).sum()
    assert way_m > 150
    assert error_m.max() < 0.04 * way_m
    assert np.degrees(np.abs(wrap_angle(rpy - truth.rpy)).max()) < 8.0


def test_a_disturbed_compass_does_not_bend_the_way_that_a_gyro_tells() -> None:
    settings = SimulationSettings.matched().model_copy(update={"sonar": None, "landmarks": None})
    survey = simulate("marina", seed=3, duration_s=300.0, settings=settings)
    assert survey.reference is not None
    truth = survey.reference.series
    assert isinstance(truth, ReferenceSeries)
    assert truth.rpy is not None

    def strayed(fast_imu: Sensor | None) -> float:
        """Over five seconds, in units of the gyro's own noise."""
        motion = vehicle_motion(survey, align(survey), SETTINGS, fast_imu)
        yaw = np.interp(motion.t, truth.t, np.unwrap(truth.rpy[:, 2]))
        off = motion.rpy[:, 2] - yaw
        return float(np.std(off[50:] - off[:-50]) / (1e-3 * np.sqrt(5.0)))

    assert 0.6 < strayed(survey.sensors["imu"]) < 1.5
    assert strayed(None) > 3.0  # a slow gyro misses turns: the compass is believed
