"""An edge near given states: what GTSAM's factor between Pose3s is there."""

from __future__ import annotations

from typing import Any

import gtsam
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from gtsam_nav.frames import Array
from gtsam_nav.graph.factors import X
from gtsam_nav.graph.measurements.edges import KeyframeEdge

POSE = np.r_[0:6, 9:15]
"""Turn and shift of two states, among their tangents."""


def normal_equations(factor: Any, values: Any) -> tuple[Array, Array, float]:
    A, b = factor.linearize(values).jacobian()
    return A.T @ A, A.T @ b, 2.0 * float(factor.error(values))


@settings(max_examples=30)
@given(seed=st.integers(0, 10_000), off=st.sampled_from([0.0, 0.1, 1.5]))
def test_value_and_derivative_are_those_of_the_logarithm(seed: int, off: float) -> None:
    rng = np.random.default_rng(seed)
    poses = [gtsam.Pose3.Expmap(rng.normal(size=6)) for _ in range(2)]
    stated = poses[0].between(poses[1]).compose(gtsam.Pose3.Expmap(off * rng.uniform(-1, 1, 6)))
    root = rng.normal(size=(6, 6)) + 4 * np.eye(6)
    information = root.T @ root
    edge = KeyframeEdge(0, 1, stated.rotation().matrix(), stated.translation(), information, 0)
    values, native_values = gtsam.Values(), gtsam.Values()
    for k, pose in enumerate(poses):
        values.insert(X(k), gtsam.NavState(pose.rotation(), pose.translation(), rng.normal(size=3)))
        native_values.insert(k, pose)
    noise = gtsam.noiseModel.Gaussian.Information(information)
    native = gtsam.BetweenFactorPose3(0, 1, stated, noise)
    H, g, cost = normal_equations(edge.by_logarithm(values.atNavState), values)
    H_native, g_native, cost_native = normal_equations(native, native_values)
    scale = np.abs(H_native).max()
    np.testing.assert_allclose(H[np.ix_(POSE, POSE)], H_native, atol=1e-9 * scale)
    np.testing.assert_allclose(g[POSE], g_native, atol=1e-9 * scale)
    np.testing.assert_allclose(cost, cost_native, rtol=1e-9, atol=1e-9)
