"""The attitude reference alone: what it converges to, and what it does not let disturb it."""

from __future__ import annotations

import doctest

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gtsam_nav.ekf import ahrs
from gtsam_nav.ekf.ahrs import Ahrs, descend_to_gravity
from gtsam_nav.frames import (
    quaternion_from_rotation,
    rotation_from_rpy,
    rpy_from_quaternion,
    wrap_angle,
)
from gtsam_nav.simulation import simulate

DT = 0.01
UP_N = np.array([0.0, 0.0, -9.80665])
angles = st.tuples(st.floats(-1.2, 1.2), st.floats(-1.2, 1.2), st.floats(-3.1, 3.1))


def test_the_example_of_the_docstring_runs() -> None:
    found = doctest.testmod(ahrs)
    assert found.attempted > 0
    assert found.failed == 0


@given(angles, st.floats(-0.5, 0.5), st.floats(-0.5, 0.5))
def test_the_descent_ends_where_gravity_is_and_keeps_the_heading(
    rpy: tuple[float, float, float], roll: float, pitch: float
) -> None:
    truth = np.array(rpy)
    # disturbed about horizontal axes: gravity has no slope in the turn about the vertical
    tilt = rotation_from_rpy([roll, pitch, 0.0])
    q = quaternion_from_rotation(tilt @ rotation_from_rpy(truth))
    direction_b = rotation_from_rpy(truth).T @ UP_N / 9.80665
    found = descend_to_gravity(q, direction_b)
    np.testing.assert_allclose(
        rpy_from_quaternion(found)[:2], truth[:2], atol=2e-3 + 0.02 * (roll**2 + pitch**2)
    )


@settings(max_examples=5)
@given(angles)
def test_at_rest_it_finds_level_and_heading(rpy: tuple[float, float, float]) -> None:
    accel_b = rotation_from_rpy(rpy).T @ UP_N
    reference = Ahrs([0.0, 0.0, rpy[2] + 0.5], sigma_rpy=1.0)
    for _ in range(300):
        reference.turn(np.zeros(3), DT)
        reference.see_gravity(accel_b)
        reference.see_heading(rpy[2])
    np.testing.assert_allclose(wrap_angle(reference.rpy - np.array(rpy)), 0.0, atol=0.02)
    assert np.linalg.norm(reference.q_nb_wxyz) == pytest.approx(1.0)


def test_gravity_says_nothing_of_the_heading() -> None:
    reference = Ahrs([0.0, 0.0, 1.0], sigma_rpy=0.5)
    for _ in range(100):
        reference.see_gravity(UP_N)
    north, east, down = reference.sigma_n
    assert north < 0.01
    assert east < 0.01
    assert down == pytest.approx(0.5, rel=0.02)
    assert reference.rpy[2] == pytest.approx(1.0, abs=1e-6)


def test_a_heading_crosses_south_the_short_way() -> None:
    reference = Ahrs([0.0, 0.0, np.radians(179.0)], sigma_rpy=0.1)
    reference.see_heading(np.radians(-179.0))
    assert abs(np.degrees(wrap_angle(reference.rpy[2] - np.pi))) < 1.0


def test_an_acceleration_is_trusted_less_than_gravity() -> None:
    calm, thrown = Ahrs(np.zeros(3)), Ahrs(np.zeros(3))
    calm.see_gravity([1.0, 0.0, -np.sqrt(9.80665**2 - 1.0)])
    thrown.see_gravity([5.0, 0.0, -9.80665])
    assert abs(thrown.rpy[1]) < 0.5 * np.arctan2(5.0, 9.8)
    assert abs(calm.rpy[1]) > 0.5 * np.arcsin(1.0 / 9.80665)
    before = calm.rpy
    calm.see_gravity(np.zeros(3))
    np.testing.assert_array_equal(calm.rpy, before)


@pytest.mark.slow
def test_it_follows_a_simulated_vessel() -> None:
    """Gyro alone drifts by its bias; gravity and compass hold it."""
    mission = simulate("laps", seed=3, duration_s=60.0)
    imu, compass = mission.sensors["imu"].series, mission.sensors["heading"].series
    assert mission.reference is not None
    truth = mission.reference.series
    reference = Ahrs(truth.rpy[0], gyro_noise_density_rad_s_sqrt_hz=0.01, sigma_tilt_rad=0.2)
    found, now = [], 0
    for k in range(1, len(imu.t)):
        reference.turn(imu.gyro_i[k], imu.t[k] - imu.t[k - 1])
        reference.see_gravity(imu.accel_i[k])
        while now < len(compass.t) and compass.t[now] <= imu.t[k]:
            reference.see_heading(compass.heading[now])
            now += 1
        found.append(reference.rpy)
    true_rpy = np.stack(
        [np.interp(imu.t[1:], truth.t, np.unwrap(axis)) for axis in truth.rpy.T], axis=1
    )
    error_deg = np.degrees(wrap_angle(np.array(found) - true_rpy))
    assert np.sqrt(np.mean(error_deg[3000:, :2] ** 2)) < 1.5
    assert np.sqrt(np.mean(error_deg[3000:, 2] ** 2)) < 1.5
