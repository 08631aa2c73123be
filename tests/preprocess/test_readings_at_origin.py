"""Open-loop strapdown integration against a simulated motion without noise."""

from __future__ import annotations

import numpy as np

from gtsam_nav.frames import rotation_from_rpy
from gtsam_nav.mission import Sensor
from gtsam_nav.preprocess.strapdown import gravity_at, integrate, readings_at_origin
from gtsam_nav.series import ImuSeries
from gtsam_nav.simulation.inertia import gravity_n, ideal_imu
from gtsam_nav.simulation.marina import ORIGIN, marina
from gtsam_nav.simulation.motion import Motion, MotionSettings

MOTION = Motion(marina(), MotionSettings(), np.random.default_rng(4))
T = np.arange(0.0, 120.0, 0.01)


def test_it_follows_a_perfect_imu() -> None:
    truth = MOTION.at(T)
    gyro_b, accel_b = ideal_imu(truth, ORIGIN)
    moving = integrate(T, gyro_b, accel_b, truth.R_nb[0], truth.v_n[0], truth.p_n[0], ORIGIN)
    np.testing.assert_allclose(moving.R_nb, truth.R_nb, atol=1e-5)
    np.testing.assert_allclose(moving.v_n, truth.v_n, atol=0.01)
    np.testing.assert_allclose(moving.p_n, truth.p_n, atol=0.3)


def test_over_a_silence_attitude_and_velocity_stay() -> None:
    truth = MOTION.at(T)
    gyro_b, accel_b = ideal_imu(truth, ORIGIN)
    heard = (T < 50.0) | (T > 60.0)
    moving = integrate(
        T[heard],
        gyro_b[heard],
        accel_b[heard],
        truth.R_nb[0],
        truth.v_n[0],
        truth.p_n[0],
        ORIGIN,
        max_gap_s=0.2,
    )
    last = int(np.searchsorted(T[heard], 55.0)) - 1
    np.testing.assert_allclose(moving.v_n[last + 1], moving.v_n[last], atol=1e-12)
    np.testing.assert_allclose(moving.R_nb[last + 1], moving.R_nb[last], atol=1e-2)
    np.testing.assert_allclose(
        moving.p_n[last + 1] - moving.p_n[last], 10.01 * moving.v_n[last], atol=0.05
    )


def test_gravity_leans_and_weakens_with_the_place() -> None:
    p_n = np.array([[0.0, 0.0, 0.0], [3000.0, -2000.0, 0.0], [0.0, 0.0, 500.0]])
    np.testing.assert_allclose(gravity_at(p_n, ORIGIN), gravity_n(p_n, ORIGIN), atol=5e-5)
    np.testing.assert_allclose(gravity_at(p_n, None), np.tile([0.0, 0.0, 9.80665], (3, 1)))


def test_a_lever_arm_is_taken_off() -> None:
    truth = MOTION.at(T)
    gyro_b, accel_b = ideal_imu(truth, ORIGIN)
    arm_b, R_bi = np.array([1.0, -0.5, 0.3]), rotation_from_rpy([0.2, 0.1, -2.0])
    turning = np.gradient(gyro_b, T, axis=0)
    felt_b = accel_b + np.cross(turning, arm_b) + np.cross(gyro_b, np.cross(gyro_b, arm_b))
    series = ImuSeries(t=T, gyro_i=gyro_b @ R_bi, accel_i=felt_b @ R_bi)
    imu = Sensor(name="imu", type="imu", series=series, xyz_b=arm_b, R_bs=R_bi)
    got_gyro, got_accel = readings_at_origin(imu)
    np.testing.assert_allclose(got_gyro, gyro_b, atol=1e-12)
    np.testing.assert_allclose(got_accel, accel_b, atol=1e-9)
