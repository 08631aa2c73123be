"""The augmented state against the textbook's filter with dense matrices."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2

from gtsam_nav.ekf.augmented_state import AugmentedState
from gtsam_nav.ekf.compounding import compound, tail_to_tail
from gtsam_nav.errors import EstimationError
from gtsam_nav.frames import Array, wrap_angle

seeds = given(st.integers(0, 2**32 - 1))
NORTH_ALIGNED = np.diag([1.0, 1.0, 0.0])


def covariance(rng: np.random.Generator, scale: Array | float = 1.0) -> Array:
    root = rng.normal(size=(3, 3)) * scale
    return np.asarray(root.T @ root + 1e-4 * np.eye(3))


def beginning(n: int, pose: Array, cov: Array, scale_sigma: float = 0.0) -> AugmentedState:
    """Of a motion without errors."""
    return AugmentedState(n, np.append(np.zeros(2), pose), padded(cov), scale_sigma)


def padded(block: Array) -> Array:
    """Of a pose, among the errors of the motion."""
    return np.pad(block, ((2, 0), (2, 0)))


def augment(state: AugmentedState, pose: Array, J_last: Array, cov_added: Array) -> None:
    state.augment(np.append(np.zeros(2), pose), padded(J_last), padded(cov_added))


def some_state(rng: np.random.Generator, n: int) -> AugmentedState:
    """A few poses, every pair of neighbours but the last matched."""
    state = beginning(n, rng.normal(size=3), covariance(rng, 0.1))
    for k in range(1, n):
        q, J_last = rng.normal(size=3), rng.choice([0, 1])
        pose, J_compound, _ = compound(state.poses[-1], q)
        augment(state, pose, NORTH_ALIGNED if J_last else J_compound, covariance(rng, 0.1))
        if k < n - 1:
            state.update(k - 1, k, q + 0.02 * rng.normal(size=3), covariance(rng, 0.1), np.inf)
    return state


def squared(whitened: Array) -> float:
    """Normalised innovation squared."""
    return float(whitened @ whitened)


@seeds
def test_augmentation_is_that_of_dense_matrices(seed: int) -> None:
    rng = np.random.default_rng(seed)
    state = beginning(4, rng.normal(size=3), covariance(rng))
    x, P = state.poses.ravel(), state.cov
    for _ in range(3):
        pose, J_last, J_q = compound(state.poses[-1], rng.normal(size=3))
        added = J_q @ covariance(rng) @ J_q.T
        n = len(x)
        F = np.eye(n + 3, n)
        F[n:, n - 3 :] = J_last
        x, P = np.append(x, pose), F @ P @ F.T
        P[n:, n:] += added
        augment(state, pose, J_last, added)
        np.testing.assert_allclose(state.poses.ravel(), x)
        np.testing.assert_allclose(state.cov, P, atol=1e-12)


@seeds
def test_an_update_is_that_of_dense_matrices(seed: int) -> None:
    """Joseph's form with all its zeros; the measurement is of any two poses."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 7))
    state = some_state(rng, n)
    a, b = rng.choice(n, 2, replace=False).tolist()
    x, P = state.poses.ravel(), state.cov
    expected, J_a, J_b = tail_to_tail(x[3 * a : 3 * a + 3], x[3 * b : 3 * b + 3])
    R, q = covariance(rng, 0.2), expected + 0.1 * rng.normal(size=3)
    H = np.zeros((3, 3 * n))
    H[:, 3 * a : 3 * a + 3], H[:, 3 * b : 3 * b + 3] = J_a, J_b
    np.testing.assert_allclose(state.displacement(a, b)[1], H @ P @ H.T, atol=1e-9)
    innovation = q - expected
    innovation[2] = wrap_angle(innovation[2])
    S = H @ P @ H.T + R
    K = P @ H.T @ np.linalg.inv(S)
    left = np.eye(3 * n) - K @ H
    nis = squared(state.update(a, b, q, R, np.inf))
    assert nis == pytest.approx(innovation @ np.linalg.solve(S, innovation), rel=1e-6)
    moved = state.poses.ravel() - (x + K @ innovation)
    moved[2::3] = wrap_angle(moved[2::3])
    np.testing.assert_allclose(moved, 0.0, atol=1e-9)
    np.testing.assert_allclose(state.cov, left @ P @ left.T + K @ R @ K.T, atol=1e-9)


def test_the_covariance_stays_one_over_many_updates() -> None:
    rng = np.random.default_rng(4)
    n, R = 40, np.diag([1e-3, 1e-3, 1e-4]) ** 2
    state = beginning(n, np.zeros(3), 1e4 * np.eye(3))
    for k in range(1, n):
        pose, J_last, J_q = compound(state.poses[-1], np.array([1.0, 0.0, 0.2]))
        augment(state, pose, J_last, J_q @ np.diag([0.5, 0.5, 0.1]) ** 2 @ J_q.T)
        for a in range(k):
            q, _ = state.displacement(a, k)
            state.update(a, k, q + rng.normal(size=3) * np.sqrt(np.diag(R)), R, np.inf)
    np.testing.assert_array_equal(state.cov, state.cov.T)
    assert np.linalg.eigvalsh(state.cov)[0] > 0
    np.testing.assert_array_equal(state.marginals[7], state.marginal(7))


def test_what_the_gate_stops_leaves_no_trace() -> None:
    state = some_state(np.random.default_rng(0), 4)
    poses, cov = state.poses, state.cov
    q, _ = state.displacement(0, 3)
    limit = float(chi2.ppf(0.999, 3))
    far = np.add(q, [50.0, 0.0, 0.0])
    assert squared(state.update(0, 3, far, 0.01 * np.eye(3), limit)) > limit
    np.testing.assert_array_equal(state.poses, poses)
    np.testing.assert_array_equal(state.cov, cov)
    assert squared(state.update(0, 3, q, 0.01 * np.eye(3), limit)) <= limit
    assert np.trace(state.cov) < np.trace(cov)


def test_a_singular_innovation_covariance_is_not_used() -> None:
    """Two poses that are tied without error, and a measurement that claims none."""
    state = beginning(2, np.zeros(3), np.eye(3))
    augment(state, np.zeros(3), np.eye(3), np.zeros((3, 3)))
    cov = state.cov
    assert squared(state.update(0, 1, np.array([0.1, 0, 0]), np.zeros((3, 3)), np.inf)) == np.inf
    assert squared(state.update(0, 1, np.zeros(3), np.diag([1.0, 1.0, 0.0]), 1.0)) == np.inf
    np.testing.assert_array_equal(state.poses, np.zeros((2, 3)))
    np.testing.assert_array_equal(state.cov, cov)


def test_a_covariance_that_is_not_finite_is_an_error() -> None:
    state = beginning(2, np.zeros(3), np.full((3, 3), np.nan))
    augment(state, np.zeros(3), np.eye(3), np.eye(3))
    with pytest.raises(EstimationError, match="not finite"):
        state.update(0, 1, np.zeros(3), np.eye(3), np.inf)


def test_yaws_are_compared_the_short_way_round() -> None:
    state = beginning(2, np.array([0.0, 0.0, 3.1]), 0.01 * np.eye(3))
    augment(state, np.array([0.0, 0.0, -3.1]), NORTH_ALIGNED, 0.01 * np.eye(3))
    assert squared(state.update(0, 1, np.zeros(3), 0.01 * np.eye(3), np.inf)) < 1.0
    yaw = state.poses[:, 2]
    assert np.all((yaw >= -np.pi) & (yaw < np.pi))
    assert np.all(np.abs(yaw) > 3.1)


def test_errors_of_a_matched_problem_are_chi_square() -> None:
    """Independent displacements, independent matches, small angles: 3 a pose over many trials."""
    rng = np.random.default_rng(1)
    n, trials = 5, 100
    Q, R = np.diag([0.2, 0.2, 0.01]) ** 2, np.diag([0.05, 0.05, 0.01]) ** 2
    nees = 0.0
    for _ in range(trials):
        truth = np.array([[2.0 * k, 0.5 * (k % 2), 0.1 * k] for k in range(n)])
        first = truth[0] + 0.1 * rng.normal(size=3)
        state = beginning(n, first, 0.01 * np.eye(3))
        for k in range(1, n):
            noise = rng.multivariate_normal(np.zeros(3), Q)
            pose = np.append(state.poses[-1, :2] + (truth[k] - truth[k - 1])[:2], truth[k, 2])
            augment(state, pose + noise, NORTH_ALIGNED, Q)
            for a in range(k):
                match = rng.multivariate_normal(tail_to_tail(truth[a], truth[k])[0], R)
                state.update(a, k, match, R, np.inf)
        error = (state.poses - truth).ravel()
        nees += float(error @ np.linalg.solve(state.cov, error))
    low, high = chi2.ppf([0.001, 0.999], 3 * n * trials)
    assert low < nees < high


def chain(scale_sigma: float, short_by: float, n: int = 12) -> tuple[AugmentedState, float]:
    """A straight way, known to a centimetre a step, whose matches are all too short by a share."""
    step_m = 10.0
    state = beginning(n, np.zeros(3), 1e-8 * np.eye(3), scale_sigma)
    for k in range(1, n):
        pose, J, _ = compound(state.poses[-1], np.array([step_m, 0.0, 0.0]))
        augment(state, pose, J, np.diag([0.02, 0.02, 1e-4]) ** 2)
        match = np.array([step_m * (1 - short_by), 0.0, 0.0])
        state.update(k - 1, k, match, np.diag([0.02, 0.02, 1e-4]) ** 2, np.inf)
    return state, step_m * (n - 1)


def test_matches_that_are_all_too_short_shorten_the_way_no_more() -> None:
    (blind, length), (aware, _) = chain(0.0, 0.01), chain(0.05, 0.01)
    assert blind.poses[-1, 0] == pytest.approx(length * 0.995, rel=1e-4)
    assert aware.poses[-1, 0] == pytest.approx(length, abs=0.02)


def test_the_scale_is_estimated_with_the_poses_as_by_least_squares() -> None:
    """The last pose's variance against that of a dense least-squares problem."""
    n, sigma = 12, 0.004
    state, _ = chain(sigma, 0.0, n)
    # unknown: the scale and n - 1 steps; each step is measured twice
    steps = np.eye(n - 1)
    H = np.vstack(
        [
            np.hstack([np.ones((1, 1)) / sigma, np.zeros((1, n - 1))]),
            np.hstack([np.zeros((n - 1, 1)), steps / 0.02]),
            np.hstack([-10.0 * np.ones((n - 1, 1)), steps]) / 0.02,
        ]
    )
    cov = np.linalg.inv(H.T @ H)
    way = np.append(0.0, np.ones(n - 1))
    assert state.marginal(n - 1)[0, 0] == pytest.approx(way @ cov @ way, rel=1e-3)


def test_errors_of_the_motion_are_estimated_with_the_poses_as_with_dense_matrices() -> None:
    """All ways are turned by one angle, and by what is left of another that forgets itself."""
    rng = np.random.default_rng(3)
    n, R = 8, np.diag([0.05, 0.05, 0.01]) ** 2
    first_cov = covariance(np.random.default_rng(5), 1.0)
    P = np.diag([0.03, 0.1, 0.1, 0.1, 0.02]) ** 2
    P[2:, 2:] += 1e-3 * first_cov
    x = np.zeros(5)
    state = AugmentedState(n, x, P)
    for k in range(1, n):
        J = np.eye(5)
        J[1, 1], J[3, :2], J[4, 1] = 0.7, 2.0, 0.5
        added = 1e-3 * np.pad(covariance(rng), ((1, 1), (1, 1)))
        new = J @ state.newest + [0.0, 0.0, 2.0, 0.0, 0.0]
        # dense: the errors stand first, then all poses
        old = np.r_[0, 1, len(x) - 3 : len(x)]
        F = np.zeros((len(x) + 3, len(x)))
        F[2 : len(x), 2:] = np.eye(len(x) - 2)
        into = np.r_[0, 1, len(x) : len(x) + 3]
        F[np.ix_(into, old)] = J
        x, P = np.append(x, new[2:]), F @ P @ F.T
        x[:2] = new[:2]
        P[np.ix_(into, into)] += added
        state.augment(new, J, added)
        a, b = slice(3 * k - 1, 3 * k + 2), slice(3 * k + 2, 3 * k + 5)
        expected, J_a, J_b = tail_to_tail(x[a], x[b])
        H = np.zeros((3, len(x)))
        H[:, a], H[:, b] = J_a, J_b
        innovation = 0.02 * rng.normal(size=3)
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        x, P = x + K @ innovation, P - K @ H @ P
        state.update(k - 1, k, expected + innovation, R, np.inf)
        np.testing.assert_allclose(state.newest, np.append(x[:2], x[-3:]), atol=1e-9)
    np.testing.assert_allclose(state.cov, P[2:, 2:], atol=1e-9)


def test_errors_within_a_scan_are_shared_by_all_its_matches_as_with_dense_matrices() -> None:
    """And by the way onward; of older scans each match has its own."""
    rng, n, m = np.random.default_rng(8), 5, 3
    start, free = covariance(rng, 0.1), np.zeros((3, 3))
    first_cov = np.block([[np.eye(m), np.zeros((m, 3))], [np.zeros((3, m)), start]])
    first = np.zeros(m + 5)
    state = AugmentedState(n, first, np.pad(first_cov, ((2, 0), (2, 0))))
    # dense: of each scan its errors, then its pose
    x, P = np.zeros(m + 3), first_cov
    for k in range(1, n):
        onward, reached, added = *(0.1 * rng.normal(size=(2, 3, m))), covariance(rng, 0.1)
        own = np.block([[np.eye(m), reached.T], [reached, reached @ reached.T + added]])
        F = np.zeros((len(x) + m + 3, len(x)))
        F[: len(x)] = np.eye(len(x))
        F[-3:, -m - 3 :] = np.hstack([onward, np.eye(3)])
        J, cov_added = np.zeros((m + 5, m + 5)), np.zeros((m + 5, m + 5))
        J[-3:, 2:], cov_added[2:, 2:] = np.hstack([onward, np.eye(3)]), own
        state.augment(J @ state.newest, J, cov_added)
        x, P = F @ x, F @ P @ F.T
        P[-m - 3 :, -m - 3 :] += own
        for a in range(k - 1, -1, -1):
            by_a, by_b = 0.1 * rng.normal(size=(2, 3, m))
            poses = [slice((m + 3) * i + m, (m + 3) * (i + 1)) for i in (a, k)]
            expected, J_a, J_b = tail_to_tail(x[poses[0]], x[poses[1]])
            H, R = np.zeros((3, len(x))), covariance(rng, 0.05)
            H[:, poses[0]], H[:, poses[1]] = J_a, J_b
            bends = np.hstack([by_a if a == k - 1 else free, by_b])
            H[:, (m + 3) * (k - 1) : (m + 3) * (k - 1) + m] = bends[:, :m]
            H[:, (m + 3) * k : (m + 3) * k + m] = by_b
            within = np.concatenate([x[(m + 3) * i : (m + 3) * i + m] for i in (k - 1, k)])
            q = expected + bends @ within + 0.02 * rng.normal(size=3)
            K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
            x = x + K @ (q - expected - bends @ within)
            P = P - K @ H @ P
            state.update(a, k, q, R, np.inf, bends)
        np.testing.assert_allclose(state.newest[2:], x[-m - 3 :], atol=1e-9)
    entries = np.concatenate([np.arange((m + 3) * i + m, (m + 3) * (i + 1)) for i in range(n)])
    np.testing.assert_allclose(state.cov, P[np.ix_(entries, entries)], atol=1e-9)
