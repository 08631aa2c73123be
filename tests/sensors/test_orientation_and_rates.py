"""Heading, tilt and angular rate from whatever measures them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from gtsam_nav.frames import Array, rotation_from_rpy, wrap_angle
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.sensors.orientation import headings_true, measures_tilt_at, tilt_at
from gtsam_nav.sensors.rates import angular_rate_b, mean_gyro_bias_b
from gtsam_nav.series import AttitudeSeries, BoolArray, HeadingSeries, ImuSeries, OdometrySeries

T = np.arange(0.0, 60.0, 0.1)
RATE = 0.2


def mission(*sensors: Sensor) -> Mission:
    return Mission("m", {s.name: s for s in sensors})


def compass(heading: Array, t: Array = T, **noise: float) -> Sensor:
    series = HeadingSeries(t=t, heading=heading, sigma=np.full(len(t), 0.01))
    return Sensor("heading", "heading", series, noise=noise)


def gyro(omega_i: Sequence[float], R_bi: Array) -> Sensor:
    accel_i = np.tile([0.0, 0.0, -9.81], (len(T), 1))
    series = ImuSeries(t=T, gyro_i=np.tile(omega_i, (len(T), 1)), accel_i=accel_i)
    return Sensor("imu", "imu", series, R_bs=R_bi)


def wheels(yaw_rate: float) -> Sensor:
    one = np.ones(len(T))
    series = OdometrySeries(
        t=T, v_b=np.zeros((len(T), 2)), yaw_rate=yaw_rate * one, sigma_v=one, sigma_yaw_rate=one
    )
    return Sensor("odometry", "odometry", series)


def test_declination_turns_magnetic_north_into_true_north() -> None:
    heading = np.linspace(-3, 3, len(T))
    plain = headings_true(mission(compass(heading)))
    turned = headings_true(mission(compass(heading, declination_deg=2.5)))
    assert plain is not None
    assert turned is not None
    np.testing.assert_array_equal(plain.heading, heading)
    np.testing.assert_allclose(turned.heading, heading + np.radians(2.5))
    np.testing.assert_array_equal(turned.sigma, plain.sigma)


def test_without_a_compass_there_is_no_heading() -> None:
    assert headings_true(mission()) is None


def test_tilt_is_interpolated() -> None:
    series = AttitudeSeries(
        t=[0.0, 1.0, 2.0], roll=[0.0, 0.1, 0.1], pitch=[0.2, 0.2, 0.0], sigma=[0.01, 0.01, 0.03]
    )
    tilt, sigma = tilt_at(mission(Sensor("a", "attitude", series)), np.array([0.5, 1.5, 9.0]))
    np.testing.assert_allclose(tilt, [[0.05, 0.2], [0.1, 0.1], [0.1, 0.0]])
    np.testing.assert_allclose(sigma, [0.01, 0.02, 0.03])


def test_a_roll_is_interpolated_across_the_wrap() -> None:
    """A vehicle that swims upside down does not stand on its feet between two readings."""
    roll = wrap_angle(np.pi + np.array([-0.02, 0.02, 0.04]))
    series = AttitudeSeries(t=[0.0, 1.0, 2.0], roll=roll, pitch=np.zeros(3), sigma=np.ones(3))
    tilt, _ = tilt_at(mission(Sensor("a", "attitude", series)), np.array([0.5, 1.5]))
    np.testing.assert_allclose(wrap_angle(tilt[:, 0] - np.pi), [0.0, 0.03], atol=1e-12)


def test_tilt_that_nobody_measures_is_level_and_vague() -> None:
    tilt, sigma = tilt_at(mission(), np.arange(3.0))
    np.testing.assert_array_equal(tilt, np.zeros((3, 2)))
    np.testing.assert_array_equal(sigma, np.radians(10.0))


def test_tilt_is_vague_in_a_silence() -> None:
    t = np.concatenate([np.arange(0.0, 1.0, 0.1), np.arange(9.0, 10.0, 0.1)])
    level, sigma = np.zeros(len(t)), np.full(len(t), 0.01)
    series = AttitudeSeries(t=t, roll=level, pitch=level, sigma=sigma)
    at = np.array([0.5, 5.0, 9.5])
    known = mission(Sensor("a", "attitude", series))
    np.testing.assert_allclose(tilt_at(known, at)[1], [0.01, np.radians(10.0), 0.01])
    np.testing.assert_array_equal(measures_tilt_at(known, at), [True, False, True])
    assert not np.any(measures_tilt_at(mission(), at))


def test_rates_come_from_the_imu_first() -> None:
    R_bi = rotation_from_rpy([0.3, -0.2, 1.2])
    omega_b = np.array([0.1, -0.05, RATE])
    one = mission(gyro(R_bi.T @ omega_b, R_bi), wheels(9.0), compass(-9.0 * T))
    np.testing.assert_allclose(
        angular_rate_b(one, T, np.zeros(3)), np.tile(omega_b, (len(T), 1)), atol=1e-14
    )


def test_then_from_odometry() -> None:
    found = angular_rate_b(mission(wheels(RATE), compass(-9.0 * T)), T, np.zeros(3))
    np.testing.assert_allclose(found, np.tile([0.0, 0.0, RATE], (len(T), 1)))


def test_then_from_the_compass() -> None:
    """Across the wrap, and not beyond half a second of the ends."""
    wrapped = (RATE * T + np.pi) % (2 * np.pi) - np.pi
    found = angular_rate_b(mission(compass(wrapped)), T, np.zeros(3))
    found = found[5:-5]
    np.testing.assert_allclose(found, np.tile([0, 0, RATE], (len(found), 1)), atol=1e-12)


@pytest.mark.parametrize("sensors", [(), (compass(np.zeros(1), T[:1]),)])
def test_else_nothing_turns(sensors: tuple[Sensor, ...]) -> None:
    found = angular_rate_b(mission(*sensors), T, np.zeros(3))
    np.testing.assert_array_equal(found, np.zeros((len(T), 3)))


def only(sensor: Sensor, told: BoolArray) -> Sensor:
    return replace(sensor, series=sensor.series.select(told))


def test_while_the_imu_is_silent_the_next_source_tells_the_rate_which_has_no_gyro_bias() -> None:
    bias_b = np.array([0.0, 0.0, 0.5])
    heard = (T < 20.0) | (T > 30.0) & (T < 40.0)
    imu = only(gyro((0.0, 0.0, RATE + 0.5), np.eye(3)), heard)
    north = compass(RATE * T)
    for others in ((north,), (only(wheels(RATE), T > 35.0), north), (wheels(RATE), compass(-T))):
        found = angular_rate_b(mission(imu, *others), T, bias_b)[5:-5]
        np.testing.assert_allclose(found, np.tile([0, 0, RATE], (len(found), 1)), atol=1e-12)
    alone = angular_rate_b(mission(imu), T, bias_b)[:, 2]
    np.testing.assert_allclose(alone[heard], RATE, atol=1e-12)
    np.testing.assert_array_equal(alone[(T > 20.0) & (T < 30.0) | (T > 41.0)], 0.0)


def test_a_compass_turns_a_vehicle_that_leans_about_the_vertical() -> None:
    half = np.full(len(T), np.pi / 2)
    leaning = AttitudeSeries(t=T, roll=half, pitch=0.0 * T, sigma=0.01 + 0.0 * T)
    found = angular_rate_b(
        mission(compass(RATE * T), Sensor("attitude", "attitude", leaning)), T, np.zeros(3)
    )[5:-5]
    np.testing.assert_allclose(found, np.tile([0, RATE, 0], (len(found), 1)), atol=1e-12)


def test_the_mean_gyro_bias_is_what_the_compass_does_not_turn() -> None:
    R_bi, bias_b = rotation_from_rpy([0.0, 0.0, 0.7]), np.array([0.01, -0.02, 0.03])
    imu = gyro(tuple(R_bi.T @ np.add(bias_b, [0.0, 0.0, RATE])), R_bi)
    north = compass(wrap_angle(3.0 + RATE * T))
    np.testing.assert_allclose(mean_gyro_bias_b(mission(imu, north)), bias_b, atol=1e-12)
    np.testing.assert_array_equal(mean_gyro_bias_b(mission(imu)), np.zeros(3))
    np.testing.assert_array_equal(mean_gyro_bias_b(mission(north)), np.zeros(3))


def test_the_gyro_is_averaged_while_the_compass_tells_its_turn() -> None:
    """A turn before the compass begins and one after it ends are none of its bias."""
    imu = gyro((0.0, 0.0, 0.0), np.eye(3))
    outside = (T < 20.0) | (T > 40.0)
    turning = np.column_stack([0 * T, 0 * T, np.where(outside, 9.0, RATE + 0.01)])
    series = ImuSeries(t=T, gyro_i=turning, accel_i=np.zeros((len(T), 3)))
    told = T[~outside]
    both = mission(Sensor("imu", "imu", series, R_bs=imu.R_bs), compass(RATE * told, told))
    np.testing.assert_allclose(mean_gyro_bias_b(both), [0.0, 0.0, 0.01], atol=1e-12)
    for apart in (compass(RATE * told, told + 100.0), compass(np.zeros(1), T[:1])):
        np.testing.assert_array_equal(mean_gyro_bias_b(mission(imu, apart)), np.zeros(3))


def test_a_turn_while_either_is_silent_is_no_bias() -> None:
    """Of an IMU that ends early, or has a gap, or whose compass has one."""
    turned = np.interp(T, [25.0, 35.0], [0.0, 4.0])
    turning = gyro((0.0, 0.0, 0.01), np.eye(3))
    rates = np.column_stack([0 * T, 0 * T, np.where((T > 25.0) & (T < 35.0), 0.4, 0.0) + 0.01])
    whole = replace(turning, series=replace(turning.series, gyro_i=rates))  # type: ignore[call-arg]
    gap, early = (T < 20.0) | (T > 40.0), T < 20.0
    north = compass(wrap_angle(turned))
    for imu, told in ((only(whole, gap), north), (only(whole, early), north)):
        np.testing.assert_allclose(mean_gyro_bias_b(mission(imu, told)), [0, 0, 0.01], atol=1e-12)
    silent = mission(whole, only(north, gap))
    np.testing.assert_allclose(mean_gyro_bias_b(silent), [0, 0, 0.01], atol=1e-12)


def test_a_compass_whose_readings_come_in_bursts_tells_the_bias() -> None:
    """Over some hundredths of a second its noise is a turn of degrees a second."""
    turning = gyro((0.0, 0.0, RATE + 0.01), np.eye(3))
    told = (np.arange(0.0, 59.0, 2.0)[:, None] + 0.01 * np.arange(5)).ravel()
    noise = 0.01 * np.random.default_rng(1).standard_normal(len(told))
    found = mean_gyro_bias_b(mission(turning, compass(wrap_angle(RATE * told + noise), told)))
    np.testing.assert_allclose(found, [0.0, 0.0, 0.01], atol=0.001)


def test_what_a_compass_tells_for_a_moment_is_hardly_a_bias() -> None:
    told = np.array([20.0, 20.2])
    found = mean_gyro_bias_b(mission(gyro((0.0, 0.0, 0.0), np.eye(3)), compass(0.1 * told, told)))
    assert -0.03 < found[2] < 0.0


@pytest.mark.parametrize("roll", [1.0, 3.1, -3.1])
def test_a_turn_of_a_vehicle_that_leans_is_no_bias(roll: float) -> None:
    R_nb = rotation_from_rpy([roll, 0.0, 0.0])
    leaning = AttitudeSeries(t=T, roll=0.0 * T + roll, pitch=0.0 * T, sigma=0.01 + 0.0 * T)
    turning = gyro(tuple(R_nb.T @ [0.0, 0.0, RATE]), np.eye(3))
    found = mean_gyro_bias_b(
        mission(turning, compass(wrap_angle(RATE * T)), Sensor("attitude", "attitude", leaning))
    )
    np.testing.assert_allclose(found, np.zeros(3), atol=1e-12)
