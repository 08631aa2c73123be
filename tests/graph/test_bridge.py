"""The state between two keyframes that are known, against simulated noise."""

from __future__ import annotations

import numpy as np
import pytest

from gtsam_nav.frames import Array, skew
from gtsam_nav.graph.bridge import _added, inertial_bridge, joint_of_neighbours, steady_bridge

GYRO, ACCEL, SPAN_S = 3e-3, 5e-3, 4.0
FORCE_N = np.array([0.6, -0.3, -9.8])


def errors(runs: int, steps: int, start: Array) -> Array:
    """Attitude, velocity and position errors of integrated readings, (runs, steps + 1, 9)."""
    rng = np.random.default_rng(1)
    dt = SPAN_S / steps
    turned = rng.normal(scale=GYRO * np.sqrt(dt), size=(runs, steps, 3))
    gained = rng.normal(scale=ACCEL * np.sqrt(dt), size=(runs, steps, 3))
    x = np.empty((runs, steps + 1, 9))
    x[:, 0] = start
    for i in range(steps):
        theta, v, p = np.split(x[:, i], 3, axis=1)
        middle = theta + turned[:, i] / 2
        speed = v - middle @ skew(FORCE_N).T * dt + gained[:, i]
        moved = p + (v + speed) / 2 * dt
        x[:, i + 1] = np.hstack([theta + turned[:, i], speed, moved])
    return x


def test_what_both_ends_leave_unknown_is_as_large_as_stated_and_unrelated_to_them() -> None:
    runs, steps = 4000, 80
    rng = np.random.default_rng(2)
    start = rng.normal(size=(runs, 9)) * np.repeat([2e-3, 1e-2, 0.1], 3)
    x = errors(runs, steps, start)
    inside = np.arange(8, steps, 12)
    bridge = inertial_bridge(inside * SPAN_S / steps, SPAN_S, FORCE_N, GYRO**2, ACCEL**2)
    known = np.einsum("nij,rj->rni", bridge.by_start, x[:, 0])
    known += np.einsum("nij,rj->rni", bridge.by_end, x[:, -1])
    left = x[:, inside] - known
    for i in range(len(inside)):
        nees = np.sum(left[:, i] * np.linalg.solve(bridge.noise[i], left[:, i].T).T, axis=1)
        assert np.mean(nees) == pytest.approx(9.0, rel=0.05)
        for end in (x[:, 0], x[:, -1]):
            together = np.corrcoef(left[:, i].T, end.T)[:9, 9:]
            assert np.abs(together).max() < 0.08


def test_the_covariance_inside_is_that_of_the_estimates_errors() -> None:
    """Both ends are known with errors of their own, which go together."""
    runs, steps, at = 4000, 40, 14
    rng = np.random.default_rng(3)
    x = errors(runs, steps, np.zeros(9))
    root = rng.normal(size=(18, 18)) * np.tile(np.repeat([1e-3, 5e-3, 2e-2], 3), 2)[:, None]
    wrong = rng.normal(size=(runs, 18)) @ root.T
    bridge = inertial_bridge(np.array([at * SPAN_S / steps]), SPAN_S, FORCE_N, GYRO**2, ACCEL**2)
    start, end = x[:, 0] + wrong[:, :9], x[:, -1] + wrong[:, 9:]
    error = start @ bridge.by_start[0].T + end @ bridge.by_end[0].T - x[:, at]
    P = bridge.covariance(root @ root.T)[0]
    nees = np.sum(error * np.linalg.solve(P, error.T).T, axis=1)
    assert np.mean(nees) == pytest.approx(9.0, rel=0.05)


def test_ends_that_are_known_are_kept() -> None:
    ends = np.array([0.0, SPAN_S])
    for bridge in (
        inertial_bridge(ends, SPAN_S, FORCE_N, GYRO**2, ACCEL**2),
        steady_bridge(ends / SPAN_S, np.zeros((2, 9)), np.ones(9)),
    ):
        np.testing.assert_allclose(bridge.by_start, [np.eye(9), np.zeros((9, 9))], atol=1e-8)
        np.testing.assert_allclose(bridge.by_end, [np.zeros((9, 9)), np.eye(9)], atol=1e-8)
        np.testing.assert_allclose(bridge.noise, 0.0, atol=1e-12)


def test_intervals_of_centiseconds_are_no_harder() -> None:
    span_s = 0.02
    bridge = inertial_bridge(np.array([0.01]), span_s, FORCE_N, 1e-6, 1e-4)
    assert np.all(np.isfinite(bridge.by_end))
    assert np.linalg.eigvalsh(bridge.noise[0]).min() > -1e-15


def test_neighbours_that_only_their_link_ties_have_this_joint_covariance() -> None:
    rng = np.random.default_rng(8)
    link = inertial_bridge(np.array([1.0]), SPAN_S, FORCE_N, GYRO**2, ACCEL**2).link
    scale = np.repeat([1e2, 10.0, 5.0], 3)
    root_0, root_1 = (rng.normal(size=(9, 9)) * scale for _ in range(2))
    # what else is known of each, and the factor between them
    information = np.zeros((18, 18))
    noise = _added(np.array([SPAN_S]), -skew(FORCE_N), GYRO**2, ACCEL**2)[0]
    transition = -(link @ noise).T
    J = np.hstack([transition, np.eye(9)])
    information += J.T @ np.linalg.solve(noise, J)
    information[:9, :9] += root_0.T @ root_0
    information[9:, 9:] += root_1.T @ root_1
    P = np.linalg.inv(information)
    found = joint_of_neighbours(P[:9, :9], P[9:, 9:], link)
    sigma = np.sqrt(np.diag(P))
    np.testing.assert_allclose(
        found / np.outer(sigma, sigma), P / np.outer(sigma, sigma), atol=1e-4
    )
