"""The stacked filters against numerical derivatives, and against each other."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.preprocess.landmark_bank import COURSE, POSITION, FilterBank, rotations
from gtsam_nav.preprocess.landmark_drift import of_inertia, of_odometry
from gtsam_nav.preprocess.planar_motion import Increments
from gtsam_nav.sensors.noise import ImuNoise

COV_B = np.array([[0.02, 0.005], [0.005, 0.03]])
STEP_B, TURN, VARIANCE = np.array([0.8, 0.1]), 0.3, np.array([0.01, 0.02, 0.005])
STEP = Increments(STEP_B[None], np.array([TURN]), VARIANCE[None], STEP_B[:1])
FIRST = 5
"""Of the landmarks: after the pose, scale and curvature."""


def bank(n_landmarks: int = 2) -> FilterBank:
    """Two filters with full covariances."""
    rng = np.random.default_rng(5)
    n = FIRST + 2 * n_landmarks
    x = rng.normal(size=(2, n)) * np.array([*[2.0] * 3, 0.05, 0.02, *[2.0] * (n - 5)])
    root = 0.3 * rng.normal(size=(2, n, n))
    return FilterBank(x, root @ np.swapaxes(root, 1, 2), np.full(2, n_landmarks), FIRST)


def jacobian(f: Callable[[Array], Array], x: Array) -> Array:
    steps = 1e-6 * np.eye(len(x))
    return np.stack([(f(x + s) - f(x - s)) / 2e-6 for s in steps], axis=-1)


def moved(x: Array) -> Array:
    x = x.copy()
    x[:2] += (1 + x[3]) * rotations(x[2]) @ STEP_B
    x[2] += TURN + x[4] * STEP_B[0]
    return x


def seen_b(x: Array, landmark: int) -> Array:
    at = FIRST + 2 * landmark
    return np.asarray(rotations(x[2]).T @ (x[at : at + 2] - x[:2]))


def test_a_move_agrees_with_numerical_derivatives() -> None:
    filters, before = bank(), bank()
    filters.move(STEP, of_odometry(STEP, 0.05, 0.02), 0)
    for x, P, x0, P0 in zip(filters.x, filters.P, before.x, before.P, strict=True):
        F, R = jacobian(moved, x0), rotations(x0[2])
        expected = F @ P0 @ F.T
        expected[:2, :2] += R @ np.diag(VARIANCE[:2]) @ R.T
        expected[2, 2] += VARIANCE[2]
        np.testing.assert_allclose(x, moved(x0))
        np.testing.assert_allclose(P, expected, atol=1e-7)


def test_comparing_and_taking_agree_with_numerical_derivatives() -> None:
    filters, before = bank(), bank()
    p_b, landmark = np.array([1.0, -0.5]), np.array([1, 0])
    nis, surprise = filters.compare(p_b, COV_B)
    filters.take(landmark, p_b, COV_B)
    for f, own in enumerate(landmark.tolist()):
        x0, P0 = before.x[f], before.P[f]
        for k in range(2):
            J, off = jacobian(lambda x, k=k: seen_b(x, k), x0), p_b - seen_b(x0, k)
            S = J @ P0 @ J.T + COV_B
            np.testing.assert_allclose(nis[f, k], off @ np.linalg.solve(S, off), rtol=1e-6)
            widened = np.log(np.linalg.det(S) / np.linalg.det(COV_B))
            np.testing.assert_allclose(surprise[f, k], widened, rtol=1e-6)
        J = jacobian(lambda x, own=own: seen_b(x, own), x0)
        K = P0 @ J.T @ np.linalg.inv(J @ P0 @ J.T + COV_B)
        np.testing.assert_allclose(filters.x[f], x0 + K @ (p_b - seen_b(x0, own)), rtol=1e-6)
        np.testing.assert_allclose(filters.P[f], P0 - K @ J @ P0, atol=1e-6)


def test_a_new_landmark_has_the_errors_of_the_pose_and_of_its_sighting() -> None:
    filters, before = bank(0), bank(0)
    p_b = np.array([3.0, 1.0])
    filters.take(np.zeros(2, dtype=np.int64), p_b, COV_B)
    assert filters.count.tolist() == [1, 1]

    def grown(x: Array) -> Array:
        return np.append(x, x[:2] + rotations(x[2]) @ p_b)

    for x, P, x0, P0 in zip(filters.x, filters.P, before.x, before.P, strict=True):
        G, R = jacobian(grown, x0), rotations(x0[2])
        expected = G @ P0 @ G.T
        expected[FIRST:, FIRST:] += R @ COV_B @ R.T
        np.testing.assert_allclose(x, grown(x0))
        np.testing.assert_allclose(P, expected, atol=1e-7)


def test_filters_that_know_different_landmarks_do_not_disturb_each_other() -> None:
    """One takes a sighting for a new landmark, the other for one it knows."""
    together = bank(1)
    alone = together.chosen(np.array([1]))
    p_b = np.array([1.0, 2.0])
    together.take(np.array([1, 0]), p_b, COV_B)
    alone.take(np.array([0]), p_b, COV_B)
    assert together.count.tolist() == [2, 1]
    assert np.isinf(together.compare(p_b, COV_B)[0][1, 1])
    second = together.chosen(np.array([1]))
    assert second.room == 1
    np.testing.assert_allclose(second.x, alone.x)
    np.testing.assert_allclose(second.P, alone.P)


def test_an_inertial_path_is_put_right_by_its_velocitys_and_accelerations_errors() -> None:
    """Two steps of a path that lacks a steady acceleration: what the errors make of it."""
    t, course, lacking = np.array([0.0, 1.0, 3.0]), np.array([0.4, 0.9, 0.9]), np.array([0.3, -0.2])
    drift = of_inertia(t, course, ImuNoise(), 0.1, 0.2)
    filters = FilterBank.at_origin(drift.sigma)
    filters.x[0, COURSE], filters.x[0, 5:7] = course[0], lacking
    still = Increments(np.zeros((2, 2)), np.diff(course), np.zeros((2, 3)), np.zeros(2))
    for k in range(2):
        filters.move(still, drift, k)
    np.testing.assert_allclose(filters.x[0, POSITION], 0.5 * lacking * t[-1] ** 2)
    np.testing.assert_allclose(filters.x[0, 3:5], lacking * t[-1])
    assert np.all(np.diag(filters.P[0])[3:5] > (0.2 * t[-1]) ** 2)
