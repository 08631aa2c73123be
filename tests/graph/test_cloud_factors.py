"""Relative poses of clouds as factors, the prior of a loop, and what contradicts it."""

from __future__ import annotations

import gtsam
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gtsam_nav.frames import Array
from gtsam_nav.graph import factors
from gtsam_nav.graph.backend import Covariances
from gtsam_nav.graph.cloud_loops import contradiction, match_clouds, relative_prior
from gtsam_nav.graph.factors import X
from gtsam_nav.registration.result import CloudMatch, RelativePose
from gtsam_nav.registration.settings import Open3dSettings


def random_pose(rng: np.random.Generator) -> RelativePose:
    root = 0.1 * rng.normal(size=(6, 6))
    R_ab = Rotation.from_rotvec(rng.normal(size=3)).as_matrix()
    return RelativePose(R_ab, 3 * rng.normal(size=3), root @ root.T + 1e-4 * np.eye(6))


def moved(pose: RelativePose, small: Array) -> tuple[Array, Array]:
    """The pose after a turn and shift of b along its own axes."""
    turn = Rotation.from_rotvec(small[:3]).as_matrix()
    return pose.R_ab @ turn, pose.p_a + pose.R_ab @ small[3:]


def states(rng: np.random.Generator, R_ab: Array, p_a: Array) -> gtsam.Values:
    """Two keyframes in this relative pose, of any velocity."""
    R_a, p_n = Rotation.from_rotvec(rng.normal(size=3)).as_matrix(), rng.normal(size=3)
    values = gtsam.Values()
    values.insert(X(0), factors.nav_state(R_a, p_n, rng.normal(size=3)))
    values.insert(X(1), factors.nav_state(R_a @ R_ab, p_n + R_a @ p_a, rng.normal(size=3)))
    return values


@given(seed=st.integers(0, 500))
def test_the_factor_costs_its_mahalanobis_distance(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pose, small = random_pose(rng), 0.2 * rng.normal(size=6)
    factor = factors.relative_pose(X(0), X(1), pose)
    e = pose.error_of(*moved(pose, small))
    np.testing.assert_allclose(e, small, atol=1e-9)
    expected = 0.5 * float(e @ np.linalg.solve(pose.cov, e))
    assert factor.error(states(rng, *moved(pose, small))) == pytest.approx(expected, rel=1e-5)


def test_its_jacobian_is_that_of_its_residual() -> None:
    rng = np.random.default_rng(3)
    pose = random_pose(rng)
    values = states(rng, *moved(pose, 0.05 * rng.normal(size=6)))
    factor = factors.relative_pose(X(0), X(1), pose)
    A, _ = factor.linearize(values).jacobian()
    for which, key in enumerate((X(0), X(1))):
        for c in range(9):
            step = np.zeros(9)
            step[c] = 1e-6
            residual = []
            for sign in (1.0, -1.0):
                there = gtsam.Values(values)
                there.update(key, values.atNavState(key).retract(sign * step))
                residual.append(factor.whitenedError(there))
            numerical = (residual[0] - residual[1]) / 2e-6
            np.testing.assert_allclose(A[:, 9 * which + c], numerical, rtol=1e-4, atol=2e-4)


def test_the_prior_of_a_loop_has_the_graphs_uncertainty() -> None:
    """A keyframe held fast, and another that a relative pose ties to it: that pose comes back."""
    rng = np.random.default_rng(5)
    pose = random_pose(rng)
    values = states(rng, pose.R_ab, pose.p_a)
    graph = gtsam.NonlinearFactorGraph()
    fast = gtsam.noiseModel.Isotropic.Sigma(9, 1e-4)
    graph.add(gtsam.PriorFactorNavState(X(0), values.atNavState(X(0)), fast))
    graph.add(factors.relative_pose(X(0), X(1), pose))
    graph.add(factors.velocity(X(1), np.zeros(3), 1.0))
    prior = relative_prior(values, Covariances(graph, values), 0, 1)
    np.testing.assert_allclose(prior.R_ab, pose.R_ab, atol=1e-9)
    np.testing.assert_allclose(prior.p_a, pose.p_a, atol=1e-9)
    np.testing.assert_allclose(prior.cov, pose.cov, rtol=1e-3, atol=1e-6)


@pytest.mark.parametrize(("sigmas", "believed"), [(1.0, True), (20.0, False)])
def test_a_match_far_from_the_estimate_is_no_loop(sigmas: float, believed: bool) -> None:
    prior = random_pose(np.random.default_rng(7))
    small = np.zeros(6)
    small[4] = sigmas * np.sqrt(prior.cov[4, 4])
    R_ab, p_a = moved(prior, small)
    match = CloudMatch(RelativePose(R_ab, p_a, 1e-6 * np.eye(6)), 0.9)
    reason = contradiction(prior, match, 0.999)
    assert (reason == "") == believed
    assert believed or "contradicts the estimate" in reason


@pytest.mark.parametrize("sigma_m", [0.01, 5.0])
def test_clouds_of_hardly_a_point_are_no_loop(sigma_m: float) -> None:
    many = np.random.default_rng(0).uniform(-10.0, 10.0, size=(2000, 3))
    cov = np.diag([0.1 * sigma_m] * 3 + [sigma_m] * 3) ** 2
    prior = RelativePose(np.eye(3), np.zeros(3), cov)
    for few in (many[:0], many[:3]):
        for pair in ((many, few), (few, many)):
            match = match_clouds(*pair, prior, Open3dSettings())
            assert match.failure == "fewer than 100 points"
