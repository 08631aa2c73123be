"""The reduction of the sensors' graph to planar knots, against dense linear algebra."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from gtsam_nav.config import Config
from gtsam_nav.frames import Array
from gtsam_nav.graph.backend import Backend, graph_of, planar_rows
from gtsam_nav.graph.factors import X
from gtsam_nav.graph.keyframes import keyframe_times
from gtsam_nav.graph.measurements import build_problem
from gtsam_nav.graph.output import smoothed_covariances
from gtsam_nav.graph.problem import Problem
from gtsam_nav.graph.sensor_posterior import SensorPosterior, _tangent, sensor_posterior
from gtsam_nav.graph.settling import settle
from gtsam_nav.preprocess.alignment import align
from gtsam_nav.preprocess.motion import vehicle_motion
from gtsam_nav.series import IntArray
from gtsam_nav.simulation import simulate

KNOTS = np.array([0, 3, 4, 8])


@dataclass
class Dense:
    """Mean and covariance of the free variables and the velocity's two errors together."""

    mean: Array
    cov: Array
    planar: Array


@dataclass
class Case:
    problem: Problem
    graph: Any
    values: Any
    posterior: SensorPosterior


def make_case(uses_imu: bool, sigma: tuple[float, float]) -> Case:
    mission = simulate("marina", seed=7, duration_s=40.0)
    mission = mission if uses_imu else mission.without("imu")
    start = align(mission)
    motion = vehicle_motion(mission, start, Config().motion)
    t = keyframe_times(*mission.span_s, np.empty(0), 5.0)
    problem = build_problem(mission, start, motion, t, Config())
    problem.calibration_sigma = np.array(sigma)
    backend = Backend(problem)
    for k in range(len(t)):
        backend.add_keyframe(k)
    backend.update()
    graph = graph_of(problem.entries)
    settled = settle(problem, problem.entries, backend.values())
    graph.push_back(settled.factors)
    posterior = sensor_posterior(graph, settled.values, KNOTS, problem)
    return Case(problem, graph, settled.values, posterior)


def dense_solution(case: Case, keyframes: IntArray) -> Dense:
    """Scale and misalignment as two more columns of the Jacobian, by numerical differences."""
    A, b = case.graph.linearize(case.values).jacobian()
    keep = np.concatenate(
        [
            first + np.arange(_tangent(key)[0])[_tangent(key)[1]]
            for key, first in zip(
                sorted(case.values.keys()),
                np.cumsum([0, *(_tangent(k)[0] for k in sorted(case.values.keys()))]),
                strict=False,
            )
        ]
    )
    A = A[:, keep]
    H, g = A.T @ A, A.T @ b
    n = len(H)
    H = np.pad(H, ((0, 2), (0, 2)))
    g = np.pad(g, (0, 2))
    for d in case.problem.displacements:
        J, r = d.entry.factor.linearize(case.values).jacobian()
        root = np.linalg.norm(J[3, 12:15])
        R_a = case.values.atNavState(X(d.k - 1)).attitude().matrix()
        p_a, p_b = (case.values.atNavState(X(k)).position() for k in (d.k - 1, d.k))

        def residual(
            scale: float, turn: float, d: Any = d, p: Array = R_a.T @ (p_b - p_a)
        ) -> Array:
            c, s = np.cos(turn), np.sin(turn)
            turned = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ d.p_a
            return np.asarray(d.R_ab.T @ (p - (1 + scale) * turned))

        h = 1e-6
        J_d = root * np.column_stack(
            [
                (residual(h, 0) - residual(-h, 0)) / (2 * h),
                (residual(0, h) - residual(0, -h)) / (2 * h),
            ]
        )
        np.testing.assert_allclose(-root * residual(0, 0), r[3:6], atol=1e-6)
        for columns, block in ((slice(0, 9), d.k - 1), (slice(9, 18), d.k)):
            own = case.posterior.columns[X(block)]
            H[own, n:] += J[3:6, columns].T @ J_d
            H[n:, own] += J_d.T @ J[3:6, columns]
        H[n:, n:] += J_d.T @ J_d
        g[n:] += J_d.T @ r[3:6]
    H[n:, n:] += np.diag(1 / np.maximum(case.problem.calibration_sigma, 1e-9) ** 2)
    planar = np.zeros((n + 2, 3 * len(keyframes)))
    for m, k in enumerate(keyframes.tolist()):
        R = case.values.atNavState(X(k)).attitude().matrix()
        planar[case.posterior.columns[X(k)], 3 * m : 3 * m + 3] = planar_rows(R).T
    # balance the units before inverting
    scale = 1 / np.sqrt(np.diag(H))
    cov = scale[:, None] * np.linalg.inv(scale[:, None] * H * scale) * scale
    return Dense(cov @ g, cov, planar)


@pytest.fixture(scope="module", params=[True, False], ids=["imu", "no_imu"])
def case(request: pytest.FixtureRequest) -> Case:
    return make_case(request.param, (0.02, np.radians(1.0)))


def test_reduction_equals_the_dense_augmented_system(case: Case) -> None:
    dense, posterior = dense_solution(case, KNOTS), case.posterior
    n = len(posterior.mean)
    cross = dense.cov @ dense.planar
    sigma = np.sqrt(np.diag(dense.cov)[:n])
    planar_cov = dense.planar.T @ cross
    planar_sigma = np.sqrt(np.diag(planar_cov))
    np.testing.assert_allclose(posterior.mean / sigma, dense.mean[:n] / sigma, atol=1e-4)
    relative = np.outer(sigma, planar_sigma)
    np.testing.assert_allclose(posterior.cross / relative, cross[:n] / relative, atol=1e-5)
    relative = np.outer(planar_sigma, planar_sigma)
    np.testing.assert_allclose(posterior.planar_cov / relative, planar_cov / relative, atol=1e-5)
    np.testing.assert_allclose(
        posterior.planar_mean / planar_sigma,
        (dense.planar.T @ dense.mean) / planar_sigma,
        atol=1e-4,
    )
    calibration = posterior.calibration
    np.testing.assert_allclose(calibration.mean, dense.mean[n:], atol=1e-6)
    np.testing.assert_allclose(calibration.cov, dense.cov[n:, n:], rtol=1e-4, atol=1e-12)
    np.testing.assert_allclose(calibration.cross, cross[n:], atol=1e-4 * np.abs(cross[n:]).max())


def test_covariances_with_sonar_equal_the_dense_ones(case: Case) -> None:
    dense, posterior = dense_solution(case, KNOTS), case.posterior
    rng = np.random.default_rng(0)
    root = rng.normal(size=(12, 6)) / np.sqrt(np.diag(posterior.planar_cov))[:, None]
    information = root @ root.T
    keys = sorted(case.values.keys())
    got = smoothed_covariances(case.graph, keys, posterior, information)
    C = dense.cov @ dense.planar
    S = dense.planar.T @ C
    with_sonar = dense.cov - C @ information @ np.linalg.solve(np.eye(12) + S @ information, C.T)
    for key, cov in zip(keys, got, strict=True):
        own = posterior.columns[key]
        wanted = with_sonar[own, own]
        sigma = np.sqrt(np.diag(wanted))
        relative = np.outer(sigma, sigma)
        # the marginals still hold the pinned components
        np.testing.assert_allclose(cov / relative, wanted / relative, atol=2e-3)


def test_step_given_the_planar_poses_hits_them(case: Case) -> None:
    posterior = case.posterior
    planar = posterior.planar_mean + 0.01 * np.arange(12)
    step = posterior.step_given(planar)
    S = dense_solution(case, KNOTS).planar[: len(step)]
    np.testing.assert_allclose(S.T @ step, planar, atol=1e-8)
    np.testing.assert_allclose(
        posterior.step_given(posterior.planar_mean), posterior.mean, atol=1e-12
    )


def test_known_calibration_changes_nothing() -> None:
    free = make_case(False, (0.0, 0.0))
    assert np.abs(free.posterior.calibration.mean).max() < 1e-9
    spread = free.posterior.calibration.spread
    sigma2 = np.diag(free.posterior.planar_cov)
    assert (spread**2).sum() < 1e-9 * sigma2.sum()
