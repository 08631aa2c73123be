"""The true motion: clear of the walls, smooth, and consistent with its own derivatives."""

from __future__ import annotations

import numpy as np
import pytest

from gtsam_nav.frames import (
    Array,
    earth_rate_n,
    gravity_m_s2,
    rotation_from_rpy,
    rpy_from_rotation,
    wrap_angle,
)
from gtsam_nav.simulation.inertia import ideal_imu
from gtsam_nav.simulation.marina import marina
from gtsam_nav.simulation.motion import Motion, MotionSettings, draw_wander

WORLD = marina()


@pytest.fixture(scope="module")
def motion() -> Motion:
    return Motion(WORLD, MotionSettings(), np.random.default_rng(0))


def test_the_vehicle_keeps_clear_of_everything(motion: Motion) -> None:
    truth = motion.at(np.arange(0.0, 1400.0, 0.2))
    assert WORLD.clearance(truth.p_n[:, :2]).min() > 1.0


def test_ten_minutes_revisit_the_corridor_and_both_basins(motion: Motion) -> None:
    """In each part of the marina some place is passed again at least two minutes later."""
    truth = motion.at(np.arange(0.0, 600.0, 2.0))
    p_n = truth.p_n[:, :2]
    distance = np.linalg.norm(p_n[:, None] - p_n, axis=2)
    later = truth.t[None] - truth.t[:, None] > 120.0
    turn = np.radians(25.0)
    along = p_n @ [np.cos(turn), np.sin(turn)] - 22.0  # 0 at the corridor's mouth to the tank
    revisited = np.any((distance < 15.0) & later, axis=1)
    in_tank, in_corridor = along < 0, (along > 0) & (along < 150)
    assert np.any(revisited & in_tank)
    assert np.mean(revisited[in_corridor & (truth.t < 250)]) > 0.9
    assert along.max() > 170.0


def test_speed_is_that_of_the_settings(motion: Motion) -> None:
    speed = np.linalg.norm(motion.at(np.arange(30.0, 600.0)).v_n[:, :2], axis=1)
    assert speed.mean() == pytest.approx(0.8, rel=0.05)
    assert speed.max() < 1.0
    resting = motion.at(np.arange(0.0, 10.0, 0.1))
    np.testing.assert_allclose(resting.v_n[:, :2], 0.0)


def test_velocity_acceleration_and_rates_are_the_derivatives(motion: Motion) -> None:
    t, h = np.arange(5.0, 200.0, 3.7), 1e-4
    before, now, after = (motion.at(t + k * h) for k in (-1, 0, 1))
    np.testing.assert_allclose((after.p_n - before.p_n) / (2 * h), now.v_n, atol=1e-6)
    np.testing.assert_allclose((after.v_n - before.v_n) / (2 * h), now.a_n, atol=1e-6)
    turn = np.swapaxes(before.R_nb, 1, 2) @ after.R_nb / (2 * h)
    rate = np.column_stack([turn[:, 2, 1], turn[:, 0, 2], turn[:, 1, 0]])
    np.testing.assert_allclose(rate, now.omega_nb_b, atol=1e-5)


WANDERING = MotionSettings(
    wander_accel_m_s2=0.05, wander_vertical_accel_m_s2=0.02, wander_yaw_accel_rad_s2=0.1
)


def test_a_wandering_vehicle_moves_as_its_derivatives_say() -> None:
    test_velocity_acceleration_and_rates_are_the_derivatives(
        Motion(WORLD, WANDERING, np.random.default_rng(0))
    )


def test_a_wander_accelerates_as_white_noise_of_its_density_does() -> None:
    """Over a time within the band, velocities change by the density times its root."""
    t, lag_s = np.arange(0.0, 600.0, 0.1), 0.5
    level, yaw = [], []
    for seed in range(20):
        stray = draw_wander(WANDERING, np.random.default_rng(seed))
        _, now, _ = stray.at(t)
        _, later, _ = stray.at(t + lag_s)
        change = (later - now).std(axis=0) / np.sqrt(lag_s)
        level.append(change[:3])
        yaw.append(change[3])
    np.testing.assert_allclose(np.mean(level, axis=0), [0.05, 0.05, 0.02], rtol=0.1)
    # half a second is long for the yaw's band, which begins at 2 rad/s
    assert 0.07 < np.mean(yaw) < 0.1


def test_without_wander_the_course_is_kept_to_the_bit() -> None:
    t = np.arange(0.0, 50.0, 0.5)
    rails = Motion(WORLD, MotionSettings(), np.random.default_rng(1)).at(t)
    strayed = Motion(WORLD, WANDERING, np.random.default_rng(1)).at(t)
    away = strayed.p_n - rails.p_n
    assert 0.03 < away[:, :2].std() < 0.3
    np.testing.assert_allclose(strayed.rpy[:, :2], rails.rpy[:, :2], atol=1e-15)


def integrate(motion: Motion, start_s: float, span_s: float, rate_hz: float) -> tuple[Array, Array]:
    """Position and attitude that strapdown integration of the noise-free IMU ends at."""
    dt = 1 / rate_hz
    t = start_s + np.arange(round(span_s * rate_hz) + 1) * dt
    truth = motion.at(t)
    gyro_b, accel_b = ideal_imu(truth, WORLD.origin, flat=True)
    earth_n = earth_rate_n(WORLD.origin.latitude_deg)
    gravity_n = np.array([0.0, 0.0, gravity_m_s2(WORLD.origin.latitude_deg)])
    p_n, v_n, R_nb = truth.p_n[0], truth.v_n[0], truth.R_nb[0]

    from scipy.spatial.transform import Rotation

    turns = Rotation.from_rotvec(0.5 * (gyro_b[1:] + gyro_b[:-1]) * dt).as_matrix()
    earth_turn = Rotation.from_rotvec(-earth_n * dt).as_matrix()
    for k, turn in enumerate(turns):
        R_next = earth_turn @ R_nb @ turn
        force_n = 0.5 * (R_nb @ accel_b[k] + R_next @ accel_b[k + 1])
        a_n = force_n + gravity_n - 2 * np.cross(earth_n, v_n)
        p_n, v_n, R_nb = p_n + v_n * dt + 0.5 * a_n * dt**2, v_n + a_n * dt, R_next
    return p_n, R_nb


@pytest.mark.parametrize("start_s", [0.0, 290.0])
def test_strapdown_integration_of_the_ideal_imu_gives_the_truth(
    motion: Motion, start_s: float
) -> None:
    p_n, R_nb = integrate(motion, start_s, 60.0, 100.0)
    end = motion.at([start_s + 60.0])
    assert np.linalg.norm(p_n - end.p_n[0]) < 0.05
    turned = wrap_angle(rpy_from_rotation(R_nb) - end.rpy[0])
    assert np.abs(turned).max() < np.radians(0.01)


def test_specific_force_at_rest_and_level_is_gravity_upwards() -> None:
    calm = MotionSettings(
        rest_s=100.0, roll_deg=0, pitch_deg=0, yaw_deg=0, heave_m=0, depth_swing_m=0
    )
    truth = Motion(WORLD, calm, np.random.default_rng(0)).at([50.0])
    gyro_b, accel_b = ideal_imu(truth, WORLD.origin, flat=True)
    gravity = gravity_m_s2(WORLD.origin.latitude_deg)
    np.testing.assert_allclose(accel_b[0], [0, 0, -gravity], atol=1e-12)
    earth_b = rotation_from_rpy(truth.rpy[0]).T @ earth_rate_n(WORLD.origin.latitude_deg)
    np.testing.assert_allclose(gyro_b[0], earth_b, atol=1e-15)
