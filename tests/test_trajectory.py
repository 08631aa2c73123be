"""Trajectories: validation, interpolation, gaps, and covariances under a change of coordinates."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gtsam_nav.errors import DataError
from gtsam_nav.frames import (
    Array,
    quaternion_from_rotation,
    quaternion_from_rpy,
    rotation_from_rpy,
    rpy_from_rotation,
    wrap_angle,
)
from gtsam_nav.trajectory import Trajectory, record_times

OMEGA_B = np.array([0.1, -0.05, 0.3])
V_N = np.array([0.5, -0.2, 0.05])


def covariances(n: int, seed: int = 0) -> Array:
    roots = np.random.default_rng(seed).normal(size=(n, 6, 6)) * [0.5, 0.4, 0.3, 0.02, 0.02, 0.03]
    return np.swapaxes(roots, 1, 2) @ roots


def steady(t: Any, **more: Any) -> Trajectory:
    """Constant velocity and constant rate of turn: interpolation of it is exact."""
    t = np.asarray(t, dtype=float)
    R = Rotation.from_euler("ZYX", [1.0, 0.3, -0.4]) * Rotation.from_rotvec(t[:, None] * OMEGA_B)
    return Trajectory(
        t=t,
        p_n=t[:, None] * V_N + [10.0, 20.0, 1.0],
        q_nb_wxyz=quaternion_from_rotation(R.as_matrix()),
        v_n=np.tile(V_N, (len(t), 1)),
        **more,
    )


def full(n: int = 21) -> Trajectory:
    return steady(
        np.arange(float(n)),
        cov_pose_n=covariances(n),
        sigma_v_n=np.full((n, 3), 0.1),
        keyframe=np.arange(n) % 5 == 0,
    )


def assert_same(a: Trajectory, b: Trajectory) -> None:
    np.testing.assert_allclose(a.t, b.t, atol=1e-12)
    np.testing.assert_allclose(a.p_n, b.p_n, atol=1e-12)
    np.testing.assert_allclose(a.R_nb, b.R_nb, atol=1e-12)
    assert a.v_n is not None
    assert b.v_n is not None
    np.testing.assert_allclose(a.v_n, b.v_n, atol=1e-12)


def test_at_no_times_there_is_no_sample() -> None:
    nowhere = full().interpolate(np.empty(0)).at_lever_arm([1.0, 0.0, 0.0])
    assert nowhere.p_n.shape == (0, 3)
    assert nowhere.cov_pose_n is not None
    assert nowhere.cov_pose_n.shape == (0, 6, 6)
    assert nowhere.keyframe is None


@pytest.mark.parametrize("name", ["p_n", "q_nb_wxyz", "v_n", "cov_pose_n", "sigma_v_n", "keyframe"])
def test_every_column_has_an_entry_a_sample(name: str) -> None:
    good = full()
    values = {f: getattr(good, f) for f in good.__dataclass_fields__}
    with pytest.raises(ValueError, match=rf"Trajectory\.{name} has shape .* is needed"):
        Trajectory(**{**values, name: values[name][:-1]})


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("name", ["t", "p_n", "q_nb_wxyz", "v_n", "cov_pose_n", "sigma_v_n"])
def test_every_number_is_finite(name: str, bad: float) -> None:
    good = full()
    values = {f: getattr(good, f) for f in good.__dataclass_fields__}
    damaged = values[name].copy()
    damaged[3] = bad
    with pytest.raises(ValueError, match=rf"Trajectory\.{name} holds NaN or infinity"):
        Trajectory(**{**values, name: damaged})


@pytest.mark.parametrize("t", [[0.0, 0.0], [1.0, 0.0]])
def test_time_strictly_increases(t: list[float]) -> None:
    with pytest.raises(ValueError, match="t does not strictly increase"):
        Trajectory(t=t, p_n=np.zeros((2, 3)), q_nb_wxyz=[[1, 0, 0, 0]] * 2)


def test_quaternions_are_of_unit_length() -> None:
    with pytest.raises(ValueError, match="not of unit length"):
        Trajectory(t=[0.0], p_n=np.zeros((1, 3)), q_nb_wxyz=[[0.9, 0, 0, 0]])
    rounded = Trajectory(t=[0.0], p_n=np.zeros((1, 3)), q_nb_wxyz=[[0.7071, 0, 0, 0.7071]])
    assert np.linalg.norm(rounded.q_nb_wxyz) == pytest.approx(1.0, abs=1e-15)


def test_angles_are_those_of_the_attitude() -> None:
    rpy = np.random.default_rng(1).uniform(-1.5, 1.5, size=(8, 3))
    q_nb_wxyz = quaternion_from_rpy(rpy)
    trajectory = Trajectory(t=np.arange(8.0), p_n=np.zeros((8, 3)), q_nb_wxyz=q_nb_wxyz)
    np.testing.assert_allclose(trajectory.rpy, rpy, atol=1e-13)
    np.testing.assert_allclose(trajectory.R_nb, rotation_from_rpy(rpy), atol=1e-14)


@given(st.lists(st.floats(0, 20), min_size=1, max_size=9, unique=True).map(sorted))
def test_steady_motion_is_interpolated_exactly(t: list[float]) -> None:
    assert_same(full().interpolate(t), steady(t))


def test_known_times_give_what_is_known() -> None:
    trajectory = full()
    again = trajectory.interpolate(trajectory.t)
    assert_same(again, trajectory)
    np.testing.assert_allclose(again.cov_pose_n, trajectory.cov_pose_n, atol=1e-15)
    np.testing.assert_allclose(again.sigma_v_n, trajectory.sigma_v_n)
    assert again.keyframe is None  # interpolated samples are no states of the estimator


def test_interpolated_covariances_stay_covariances() -> None:
    cov = full().interpolate(np.linspace(0, 20, 77)).cov_pose_n
    assert cov is not None
    np.testing.assert_allclose(cov, np.swapaxes(cov, 1, 2), atol=1e-15)
    assert np.linalg.eigvalsh(cov).min() > 0


def test_attitude_takes_the_short_way_round() -> None:
    yaw = np.radians([170.0, -170.0])
    q_nb_wxyz = quaternion_from_rpy(np.column_stack([np.zeros((2, 2)), yaw]))
    q_nb_wxyz[1] *= -1  # the same attitude
    turning = Trajectory(t=[0.0, 1.0], p_n=np.zeros((2, 3)), q_nb_wxyz=q_nb_wxyz)
    middle = turning.interpolate([0.5]).rpy[0, 2]
    assert wrap_angle(middle - np.pi) == pytest.approx(0.0, abs=1e-12)


GAPPY = np.array([0.0, 1.0, 2.0, 9.0, 10.0])


@pytest.mark.parametrize(
    ("t", "covered"),
    [
        (-0.01, False),
        (0.0, True),
        (1.5, True),
        (2.0, True),  # the edges of a gap are known
        (2.01, False),
        (5.0, False),
        (8.99, False),
        (9.0, True),
        (10.0, True),
        (10.01, False),
    ],
)
def test_a_gap_is_not_bridged(t: float, covered: bool) -> None:
    trajectory = steady(GAPPY)
    assert bool(trajectory.covers(t)) is covered
    if covered:
        assert_same(trajectory.interpolate([t]), steady([t]))
    else:
        with pytest.raises(ValueError, match="outside the trajectory or inside one of its gaps"):
            trajectory.interpolate([t])


def test_a_longer_gap_may_be_asked_for() -> None:
    trajectory = steady(GAPPY)
    assert bool(trajectory.covers(5.0, max_gap_s=7.0))
    assert not bool(trajectory.covers(5.0, max_gap_s=6.99))
    assert_same(trajectory.interpolate([5.0], max_gap_s=7.0), steady([5.0]))


def test_short_trajectories() -> None:
    one = steady([3.0])
    assert_same(one.interpolate([3.0]), one)
    nothing = one.select(slice(0, 0))
    assert len(nothing) == 0
    np.testing.assert_array_equal(nothing.covers([1.0, 3.0]), [False, False])
    np.testing.assert_array_equal(one.covers([2.9, 3.0, 3.1]), [False, True, False])


@pytest.mark.parametrize("which", [slice(2, 5), np.array([2, 3, 4]), np.isin(range(21), [2, 3, 4])])
def test_select_takes_masks_indices_and_slices(which: Any) -> None:
    trajectory = full()
    picked = trajectory.select(which)
    for name in trajectory.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(picked, name), getattr(trajectory, name)[2:5])


def drawn(trajectory: Trajectory, k: int, n: int = 200_000) -> tuple[Array, Array]:
    """Positions (n, 3) and rotations (n, 3, 3) that the covariance of sample k describes."""
    assert trajectory.cov_pose_n is not None
    rng = np.random.default_rng(5)
    error = rng.multivariate_normal(np.zeros(6), trajectory.cov_pose_n[k], size=n)
    turned = Rotation.from_rotvec(error[:, 3:]).as_matrix() @ trajectory.R_nb[k]
    return trajectory.p_n[k] + error[:, :3], turned


@pytest.mark.parametrize("k", [0, 7])
def test_a_lever_arm_carries_the_covariance(k: int) -> None:
    lever_b = np.array([2.0, -1.0, 4.0])
    moved = full().at_lever_arm(lever_b)
    p_n, R_nb = drawn(full(), k)
    antenna_n = p_n + R_nb @ lever_b
    np.testing.assert_allclose(moved.p_n[k], full().p_n[k] + full().R_nb[k] @ lever_b, atol=1e-12)
    assert moved.cov_pose_n is not None
    sampled = np.cov(antenna_n.T)
    assert np.linalg.norm(moved.cov_pose_n[k, :3, :3] - sampled) < 0.02 * np.linalg.norm(sampled)
    np.testing.assert_array_equal(moved.q_nb_wxyz, full().q_nb_wxyz)
    assert moved.v_n is None
    assert moved.sigma_v_n is None


def test_there_and_back_again() -> None:
    lever_b = np.array([2.0, -1.0, 4.0])
    back = full().at_lever_arm(lever_b).at_lever_arm(-lever_b)
    np.testing.assert_allclose(back.p_n, full().p_n, atol=1e-12)
    np.testing.assert_allclose(back.cov_pose_n, full().cov_pose_n, atol=1e-12)


@pytest.mark.parametrize("k", [0, 7, 13])
def test_sigmas_of_the_angles_follow_from_the_rotation_error(k: int) -> None:
    trajectory = full()
    assert trajectory.cov_pose_n is not None
    step = 1e-6
    nudged = Rotation.from_rotvec(np.vstack([step * np.eye(3), -step * np.eye(3)]))
    rpy = rpy_from_rotation(nudged.as_matrix() @ trajectory.R_nb[k])
    J = (wrap_angle(rpy[:3] - rpy[3:]) / (2 * step)).T
    expected = np.sqrt(np.diag(J @ trajectory.cov_pose_n[k, 3:, 3:] @ J.T))
    assert trajectory.sigma_rpy is not None
    np.testing.assert_allclose(trajectory.sigma_rpy[k], expected, rtol=1e-6)


def test_sigmas_need_a_covariance() -> None:
    assert steady([0.0]).sigma_p_n is None
    assert steady([0.0]).sigma_rpy is None
    sigma_p_n = full().sigma_p_n
    assert sigma_p_n is not None
    np.testing.assert_allclose(sigma_p_n[4] ** 2, np.diag(covariances(21)[4])[:3])


@pytest.mark.parametrize("stop_s", [2.0, 2.04, 2.1, 3.0000000001])
def test_a_trajectory_ends_where_its_mission_does(stop_s: float) -> None:
    t = record_times(2.0, stop_s, 10.0)
    assert t[-1] == stop_s
    assert np.all(np.diff(t) > 1e-6)
    assert np.all(np.diff(t) <= 0.1 + 1e-6)
    assert len(t) == 1 or t[0] == 2.0


def test_a_variance_of_zero_survives_rounding() -> None:
    cov = covariances(3)
    cov[0, 0, 0] = -1e-22
    sigma = steady(np.arange(3.0), cov_pose_n=cov).sigma_p_n
    assert sigma is not None
    assert sigma[0, 0] == 0.0
    assert np.all(sigma[1:] > 0.0)


def test_no_trajectory_is_longer_than_memory() -> None:
    with pytest.raises(DataError, match="stamps are in seconds"):
        record_times(0.0, 1e9, 10.0)
