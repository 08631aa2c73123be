"""The sensors' Gaussian, alone and with the sonar, against dense linear algebra."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.spatial.transform import Rotation

from gtsam_nav.config import Config
from gtsam_nav.frames import Array
from gtsam_nav.graph.backend import Backend, graph_of, planar_rows
from gtsam_nav.graph.factors import X
from gtsam_nav.graph.keyframes import keyframe_times
from gtsam_nav.graph.knot_system import KnotSystem
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
        R_a, R_b = (case.values.atNavState(X(k)).attitude().matrix() for k in (d.k - 1, d.k))
        p_a, p_b = (case.values.atNavState(X(k)).position() for k in (d.k - 1, d.k))
        further = Rotation.from_matrix(d.R_ab.T @ R_a.T @ R_b).as_rotvec()
        bend = 0.5 * case.problem.uses_imu * np.cross(further, d.R_ab.T @ d.p_a)

        def residual(
            scale: float,
            turn: float,
            d: Any = d,
            p: Array = R_a.T @ (p_b - p_a),
            bend: Array = bend,
        ) -> Array:
            c, s = np.cos(turn), np.sin(turn)
            turned = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ d.p_a
            return np.asarray(d.R_ab.T @ (p - (1 + scale) * turned) - bend)

        h = 1e-6
        J_d = root * np.column_stack(
            [
                (residual(h, 0) - residual(-h, 0)) / (2 * h),
                (residual(0, h) - residual(0, -h)) / (2 * h),
            ]
        )
        np.testing.assert_allclose(-root * residual(0, 0), r[3:6], atol=1e-6)
        for columns, block in ((slice(0, 9), d.k - 1), (slice(9, 18), d.k)):
            own = case.posterior.system.columns[X(block)]
            H[own, n:] += J[3:6, columns].T @ J_d
            H[n:, own] += J_d.T @ J[3:6, columns]
        H[n:, n:] += J_d.T @ J_d
        g[n:] += J_d.T @ r[3:6]
    H[n:, n:] += np.diag(1 / np.maximum(case.problem.calibration_sigma, 1e-9) ** 2)
    planar = np.zeros((n + 2, 3 * len(keyframes)))
    for m, k in enumerate(keyframes.tolist()):
        R = case.values.atNavState(X(k)).attitude().matrix()
        planar[case.posterior.system.columns[X(k)], 3 * m : 3 * m + 3] = planar_rows(R).T
    # balance the units before inverting
    scale = 1 / np.sqrt(np.diag(H))
    cov = scale[:, None] * np.linalg.inv(scale[:, None] * H * scale) * scale
    return Dense(cov @ g, cov, planar)


@pytest.fixture(scope="module", params=[True, False], ids=["imu", "no_imu"])
def case(request: pytest.FixtureRequest) -> Case:
    return make_case(request.param, (0.02, np.radians(1.0)))


def assert_close_in_sigmas(got: Array, wanted: Array, cov: Array, atol: float) -> None:
    np.testing.assert_allclose(got / np.sqrt(np.diag(cov)), wanted / np.sqrt(np.diag(cov)), 0, atol)


def assert_same_covariance(got: Array, wanted: Array, atol: float) -> None:
    relative = np.sqrt(np.outer(np.diag(wanted), np.diag(wanted)))
    np.testing.assert_allclose(got / relative, wanted / relative, 0, atol)


def test_sensors_alone_equal_the_dense_augmented_system(case: Case) -> None:
    dense, posterior = dense_solution(case, KNOTS), case.posterior
    n = len(posterior.step)
    assert_close_in_sigmas(posterior.step, dense.mean[:n], dense.cov[:n, :n], 1e-4)
    planar_cov = dense.planar.T @ dense.cov @ dense.planar
    assert_same_covariance(posterior.planar_cov, planar_cov, 1e-5)
    constants = posterior.constants
    np.testing.assert_allclose(constants.mean, dense.mean[n:], atol=1e-6)
    np.testing.assert_allclose(constants.cov, dense.cov[n:, n:], rtol=1e-4, atol=1e-12)


def test_covariances_of_the_sensors_alone_equal_the_dense_ones(case: Case) -> None:
    dense = dense_solution(case, KNOTS)
    keys = sorted(case.values.keys())
    got = smoothed_covariances(case.graph, keys, case.posterior)
    for key, cov in zip(keys, got, strict=True):
        own = case.posterior.system.columns[key]
        # the marginals still hold the pinned components
        assert_same_covariance(cov, dense.cov[own, own], 2e-3)


def test_covariance_does_not_depend_on_how_finely_time_is_divided(
    case: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gtsam_nav.graph.dissection.LARGEST_UNDIVIDED", 1)
    again = sensor_posterior(case.graph, case.values, KNOTS, case.problem)
    assert_same_covariance(again.planar_cov, case.posterior.planar_cov, 1e-9)


@pytest.mark.parametrize(("most_between", "step"), [(0, 0.0), (1, 0.3), (8, 0.0)])
def test_sensors_and_sonar_equal_the_dense_system(
    case: Case, most_between: int, step: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The sonar's information is added to the dense normal equations, wherever it was taken."""
    monkeypatch.setattr("gtsam_nav.graph.knot_system.MOST_BETWEEN", most_between)
    monkeypatch.setattr("gtsam_nav.graph.dissection.LARGEST_UNDIVIDED", 2)
    dense = dense_solution(case, KNOTS)
    sigma = np.sqrt(np.diag(dense.planar.T @ dense.cov @ dense.planar))
    root = np.random.default_rng(0).normal(size=(12, 6)) / sigma[:, None]
    information, gradient = root @ root.T, root @ np.arange(6.0)
    P = dense.planar
    gain = dense.cov @ P @ np.linalg.inv(np.eye(12) + information @ P.T @ dense.cov @ P)
    cov = dense.cov - gain @ information @ P.T @ dense.cov
    mean = dense.mean + gain @ (gradient - information @ P.T @ dense.mean)

    touching = coo_array(np.ones((12, 12)))
    knots = KnotSystem(case.graph, case.values, KNOTS, case.problem, touching)
    taken = step * np.tile(sigma[:3], (4, 1))
    there = gradient - information @ taken.ravel()
    joint = knots.with_sonar(coo_array(information), there, taken)
    n, columns = len(knots.system.g), knots.system.columns
    assert_close_in_sigmas(joint.planar.ravel(), P.T @ mean, P.T @ cov @ P, 1e-3)
    np.testing.assert_allclose(joint.constants.mean, mean[n:], atol=1e-6)
    np.testing.assert_allclose(joint.constants.cov, cov[n:, n:], rtol=1e-3, atol=1e-12)
    keys = sorted(case.values.keys())
    for key, got in zip(keys, joint.covariances(keys), strict=True):
        assert_same_covariance(got, cov[columns[key], columns[key]], 1e-3)
    moved = joint.moved()
    for k in range(len(case.problem.t)):
        step = case.values.atNavState(X(k)).localCoordinates(moved.atNavState(X(k)))
        own = columns[X(k)]
        assert_close_in_sigmas(step, mean[own], cov[own, own], 2e-3)


def test_known_calibration_changes_nothing() -> None:
    free = make_case(False, (0.0, 0.0))
    assert np.abs(free.posterior.constants.mean).max() < 1e-9
    spread = free.posterior.spread
    assert (spread**2).sum() < 1e-9 * np.trace(free.posterior.planar_cov)
