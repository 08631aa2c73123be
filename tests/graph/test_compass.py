"""The compass's constant bias, one state a stretch."""

from __future__ import annotations

from typing import Any

import gtsam
import numpy as np
import pytest

import gtsam_nav as gn
from gtsam_nav.config import Config
from gtsam_nav.frames import Array
from gtsam_nav.graph.backend import Covariances, graph_of, solve_batch
from gtsam_nav.graph.factors import X
from gtsam_nav.graph.measurements import build_problem, orientation
from gtsam_nav.graph.outset import mission_keyframes, start_and_motion
from gtsam_nav.graph.problem import RECEIVER_STRIDE
from gtsam_nav.mission import Mission


@pytest.fixture(scope="module")
def mission() -> Mission:
    return gn.simulate("marina", seed=3, duration_s=120.0).without("imu", "sonar", "landmarks")


def solved(mission: Mission) -> tuple[Array, Array, int]:
    """Yaw and bias of all keyframes, their sigmas, and how many states hold the constant."""
    config = Config()
    start, motion = start_and_motion(mission, config)
    t = mission_keyframes(mission, np.empty(0), np.empty(0), config)
    problem = build_problem(mission, start, motion, t, config)
    graph, values = graph_of(problem.entries), gtsam.Values()
    for k in range(len(t)):
        values.insert(X(k), problem.initial_state(k))
        for key, first in problem.variables[k]:
            values.insert(key, first(values.atNavState))
        for reading in problem.readings[k]:
            graph.push_back(reading.make(values.atNavState))
    found = solve_batch(graph, values)
    keys = [*(X(k) for k in range(len(t))), *problem.compass]
    yaw = np.array([found.atNavState(key).attitude().yaw() for key in keys])
    covariances = Covariances(graph, found)
    sigma = np.sqrt([covariances.joint([key])[2, 2] for key in keys])
    return yaw, sigma, sum(_is_constant(key) for key in list(values.keys()))


def _is_constant(key: Any) -> bool:
    symbol = gtsam.Symbol(key)
    return chr(symbol.chr()) == "m" and symbol.index() >= RECEIVER_STRIDE


def test_stretches_say_what_a_single_constant_would(
    mission: Mission, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(orientation, "STRETCH", 10**6)
    wanted, wanted_sigma, n_single = solved(mission)
    monkeypatch.setattr(orientation, "STRETCH", 4)
    yaw, sigma, n_stretches = solved(mission)
    assert (n_single, n_stretches) == (1, -(-(len(yaw) // 2) // 4))
    np.testing.assert_allclose(yaw, wanted, rtol=0, atol=1e-3 * np.min(sigma))
    np.testing.assert_allclose(sigma, wanted_sigma, rtol=1e-4)
