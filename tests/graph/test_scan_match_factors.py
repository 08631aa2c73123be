"""Scan matches and preintegration as factors: residual, cost, and prediction."""

from __future__ import annotations

import gtsam
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gtsam_nav.frames import rotation_from_rpy
from gtsam_nav.graph import factors
from gtsam_nav.graph.factors import X

angles = st.floats(-3.1, 3.1)
offsets = st.floats(-20.0, 20.0)
small = st.floats(-0.3, 0.3)


@given(
    yaw_a=angles,
    x=offsets,
    y=offsets,
    yaw=angles,
    ex=small,
    ey=small,
    eyaw=small,
    seed=st.integers(0, 99),
)
def test_planar_match_costs_its_mahalanobis_distance(
    yaw_a: float, x: float, y: float, yaw: float, ex: float, ey: float, eyaw: float, seed: int
) -> None:
    root = np.random.default_rng(seed).normal(scale=0.3, size=(3, 3))
    cov = root @ root.T + 0.05**2 * np.eye(3)
    q = np.array([x, y, yaw])
    factor = factors.planar_match(X(0), X(1), q, cov)

    def cost(error: np.ndarray) -> float:
        R_a = rotation_from_rpy([0.0, 0.0, yaw_a])
        p_a = np.array([4.0, -7.0, 1.5])
        there = q + error
        # depth and velocity may be anything
        p_b = p_a + R_a @ [there[0], there[1], 2.0]
        values = gtsam.Values()
        values.insert(X(0), factors.nav_state(R_a, p_a, np.array([0.5, 0.1, 0.0])))
        R_b = R_a @ rotation_from_rpy([0.0, 0.0, there[2]])
        values.insert(X(1), factors.nav_state(R_b, p_b, np.array([-0.2, 0.3, 0.1])))
        return float(factor.error(values))

    assert cost(np.zeros(3)) == pytest.approx(0.0, abs=1e-9)
    error = np.array([ex, ey, eyaw])
    # the native residual is the Logmap of a pose: its translation is exact only without a turn
    straight = error * [1.0, 1.0, 0.0]
    for e in (straight, error * [0.0, 0.0, 1.0]):
        d2 = float(e @ np.linalg.solve(cov, e))
        assert cost(e) == pytest.approx(d2 / 2, rel=1e-6, abs=1e-9)


def test_planar_match_leaves_tilt_depth_and_velocity_free() -> None:
    factor = factors.planar_match(X(0), X(1), np.array([3.0, -1.0, 0.4]), 0.01 * np.eye(3))
    values = gtsam.Values()
    values.insert(X(0), gtsam.NavState())
    R_ab = rotation_from_rpy([0.0, 0.0, 0.4])
    values.insert(X(1), factors.nav_state(R_ab, np.array([3.0, -1.0, 0.0]), np.zeros(3)))
    A, _ = factor.linearize(values).jacobian()
    free = [0, 1, 5, 6, 7, 8]  # roll, pitch, down, velocity
    np.testing.assert_allclose(A[:, [9 + c for c in free]], 0.0, atol=1e-9)
    assert np.linalg.matrix_rank(A[:, 9:]) == 3
