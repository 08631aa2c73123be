"""What the errors that dead reckoning takes for zero add to its covariance."""

from __future__ import annotations

import numpy as np
import pytest

from gtsam_nav.ekf.considered import ConsideredErrors, with_considered
from gtsam_nav.frames import Array, quaternion_from_rpy
from gtsam_nav.simulation.processes import gauss_markov
from gtsam_nav.trajectory import Trajectory

STEP_S = 0.5
T = np.arange(0.0, 150.0, STEP_S)
COURSE = 0.4 * np.sin(2 * np.pi * T / 60.0) + T / 50.0
SPEED_M_S = 0.8


def moved(course: Array, speed: Array) -> Array:
    """Positions (..., n, 2) of steps at the mean of their ends' velocities."""
    v = speed[..., None] * np.stack([np.cos(course), np.sin(course)], axis=-1)
    steps = 0.5 * (v[..., 1:, :] + v[..., :-1, :]) * STEP_S
    return np.concatenate([np.zeros_like(steps[..., :1, :]), np.cumsum(steps, axis=-2)], axis=-2)


def track() -> Trajectory:
    speed = np.full(len(T), SPEED_M_S)
    level = np.zeros(len(T))
    v_n = SPEED_M_S * np.column_stack([np.cos(COURSE), np.sin(COURSE), level])
    return Trajectory(
        t=T,
        p_n=np.column_stack([moved(COURSE, speed), level]),
        q_nb_wxyz=quaternion_from_rpy(np.column_stack([level, level, COURSE])),
        v_n=v_n,
        cov_pose_n=np.tile(1e-12 * np.eye(6), (len(T), 1, 1)),
        sigma_v_n=np.zeros((len(T), 3)),
    )


@pytest.mark.slow
def test_the_covariance_is_that_of_simulated_errors() -> None:
    errors = ConsideredErrors(
        heading=0.01, disturbance=0.03, disturbance_time_s=40.0, misalignment=0.008, scale=0.02
    )
    rng, runs = np.random.default_rng(5), 4000
    constant = rng.normal(scale=errors.heading, size=(runs, 1))
    drift = gauss_markov(rng, len(T), STEP_S, errors.disturbance, errors.disturbance_time_s, runs)
    aside = rng.normal(scale=errors.misalignment, size=(runs, 1))
    scale = rng.normal(scale=errors.scale, size=(runs, 1))
    wrong = constant + drift.T
    p = moved(COURSE + wrong + aside, SPEED_M_S * (1 + scale) * np.ones(len(T)))
    found = with_considered(track(), errors)
    assert found.cov_pose_n is not None
    assert found.sigma_v_n is not None
    planar = np.array([0, 1, 5])
    for k in (60, 150, len(T) - 1):
        seen = np.column_stack([p[:, k] - found.p_n[k, :2], wrong[:, k]])
        stated = found.cov_pose_n[k][np.ix_(planar, planar)]
        nees = np.sum(seen * np.linalg.solve(stated, seen.T).T, axis=1)
        assert np.mean(nees) == pytest.approx(3.0, rel=0.06)
    turned = np.sqrt(errors.heading**2 + errors.disturbance**2 + errors.misalignment**2)
    expected = SPEED_M_S * np.hypot(turned, errors.scale)
    np.testing.assert_allclose(np.linalg.norm(found.sigma_v_n, axis=1), expected, rtol=1e-6)


@pytest.mark.parametrize("sigma_deg_m", [0.05, 0.4])
def test_a_turn_that_odometry_does_not_notice_bends_the_way(sigma_deg_m: float) -> None:
    """By 6 and by 48 degrees in the end; over the second the course is far from linear."""
    sigma, rng = np.radians(sigma_deg_m), np.random.default_rng(5)
    turned = rng.normal(scale=sigma, size=(4000, 1)) * (SPEED_M_S * T)
    p = moved(COURSE + turned, SPEED_M_S * np.ones(len(T)))[:, -1] - track().p_n[-1, :2]
    found = with_considered(track(), ConsideredErrors(0.0, 0.0, 1.0, 0.0, 0.0, curvature=sigma))
    assert found.cov_pose_n is not None
    stated = found.cov_pose_n[-1, :2, :2]
    nees = np.sum(p * np.linalg.solve(stated + 1e-9 * np.eye(2), p.T).T, axis=1)
    assert 0.3 < np.mean(nees) < 2.2
    assert found.cov_pose_n[-1, 5, 5] == pytest.approx(np.var(turned[:, -1]), rel=0.06)


def test_nothing_that_is_estimated_moves() -> None:
    errors = ConsideredErrors(0.1, 0.1, 60.0, 0.1, 0.1)
    before, after = track(), with_considered(track(), errors)
    for name in ("t", "p_n", "q_nb_wxyz", "v_n"):
        np.testing.assert_array_equal(getattr(after, name), getattr(before, name))


def test_without_such_errors_the_covariance_stays() -> None:
    none = ConsideredErrors(0.0, 0.0, 1.0, 0.0, 0.0)
    np.testing.assert_array_equal(with_considered(track(), none).cov_pose_n, track().cov_pose_n)
