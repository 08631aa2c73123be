"""The smoother against a batch solution: on linear problems both are the same estimate."""

from __future__ import annotations

from dataclasses import dataclass

import gtsam
import numpy as np
import pytest

from gtsam_nav.ekf.rts import smooth
from gtsam_nav.frames import Array

DT, N = 0.5, 60
F = np.block([[np.eye(2), DT * np.eye(2)], [np.zeros((2, 2)), np.eye(2)]])
Q = 0.3 * np.block(
    [
        [DT**3 / 3 * np.eye(2), DT**2 / 2 * np.eye(2)],
        [DT**2 / 2 * np.eye(2), DT * np.eye(2)],
    ]
)
H = np.eye(2, 4)
R = 0.8 * np.eye(2)
P_START = np.diag([4.0, 4.0, 1.0, 1.0])


@dataclass(frozen=True)
class Node:
    x: Array
    P: Array
    P_predicted: Array
    Phi: Array
    correction: Array


def measured(seed: int) -> Array:
    """Positions (N, 2) of a body of constant velocity but for white acceleration."""
    rng = np.random.default_rng(seed)
    x, out = rng.multivariate_normal(np.zeros(4), P_START), []
    for _ in range(N):
        out.append(H @ x + rng.multivariate_normal(np.zeros(2), R))
        x = rng.multivariate_normal(F @ x, Q)
    return np.array(out)


def filtered(z: Array) -> list[Node]:
    x, P, Phi, nodes = np.zeros(4), P_START, np.eye(4), []
    for k in range(N):
        if k:
            x, P, Phi = F @ x, F @ P @ F.T + Q, F
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        correction = K @ (z[k] - H @ x)
        after = (np.eye(4) - K @ H) @ P
        nodes.append(Node(x + correction, after, P, Phi, correction))
        x, P = x + correction, after
    return nodes


def batch(z: Array) -> tuple[Array, Array]:
    """States (N, 4) and their covariances by GTSAM."""
    graph, whiten = (
        gtsam.GaussianFactorGraph(),
        lambda cov: np.linalg.cholesky(np.linalg.inv(cov)).T,
    )
    prior, motion, position = whiten(P_START), whiten(Q), whiten(R)
    unit = gtsam.noiseModel.Unit.Create
    graph.add(0, prior, np.zeros(4), unit(4))
    for k in range(N):
        graph.add(k, position @ H, position @ z[k], unit(2))
        if k:
            graph.add(k - 1, -motion @ F, k, motion, np.zeros(4), unit(4))
    solution = graph.optimize()
    information, _ = graph.hessian()
    cov = np.linalg.inv(information)
    blocks = [cov[4 * k : 4 * k + 4, 4 * k : 4 * k + 4] for k in range(N)]
    return np.array([solution.at(k) for k in range(N)]), np.array(blocks)


@pytest.mark.parametrize("seed", range(3))
def test_the_smoother_is_the_batch_solution(seed: int) -> None:
    z = measured(seed)
    nodes = filtered(z)
    error, P = smooth(nodes)
    x_batch, P_batch = batch(z)
    np.testing.assert_allclose([n.x for n in nodes] + error, x_batch, atol=1e-6)
    np.testing.assert_allclose(P, P_batch, atol=1e-6)
    # the filter itself is another estimate but at the end
    assert np.abs(error[:-1]).max() > 0.1
    np.testing.assert_array_equal(error[-1], 0.0)


def test_what_is_known_exactly_stays_known() -> None:
    nodes = [
        Node(np.zeros(2), np.diag([1.0, 0.0]), np.diag([2.0, 0.0]), np.eye(2), np.array([c, 0.0]))
        for c in (0.0, 0.5)
    ]
    error, P = smooth(nodes)
    np.testing.assert_allclose(error[0], [0.25, 0.0])
    np.testing.assert_allclose(P[0], np.diag([0.75, 0.0]))


def test_what_is_not_carried_back_stays_as_filtered() -> None:
    """North and east do not know of each other: one may be smoothed alone."""
    nodes = filtered(measured(3))
    north, east = np.array([0, 2]), np.array([1, 3])
    whole, P_whole = smooth(nodes)
    error, P = smooth(nodes, carried=[north] * N)
    np.testing.assert_allclose(error[:, north], whole[:, north])
    np.testing.assert_array_equal(error[:, east], 0.0)
    np.testing.assert_allclose(P[:, north[:, None], north], P_whole[:, north[:, None], north])
    filtered_P = np.array([node.P for node in nodes])
    np.testing.assert_array_equal(P[:, east[:, None], east], filtered_P[:, east[:, None], east])
