"""Joint covariances of groups of variables in one pass."""

from __future__ import annotations

from typing import Any

import gtsam
import numpy as np
import pytest

import gtsam_nav as gn
from gtsam_nav.config import Config
from gtsam_nav.errors import EstimationError
from gtsam_nav.frames import Array
from gtsam_nav.graph import factors
from gtsam_nav.graph.backend import Covariances, graph_of
from gtsam_nav.graph.block_covariances import FEW, joint_covariances
from gtsam_nav.graph.factors import X
from gtsam_nav.graph.measurements import build_problem
from gtsam_nav.graph.measurements.gnss import error_key
from gtsam_nav.graph.outset import mission_keyframes, start_and_motion
from gtsam_nav.graph.problem import Problem
from gtsam_nav.graph.readings import made


@pytest.fixture(scope="module")
def settled() -> tuple[Problem, Any, gtsam.Values]:
    """A minute of the marina with all that its keyframes, landmarks and readings bring."""
    mission = gn.simulate("marina", seed=3, duration_s=60.0).without("imu", "sonar")
    config = Config()
    start, motion = start_and_motion(mission, config)
    t = mission_keyframes(mission, np.empty(0), np.empty(0), config)
    problem = build_problem(mission, start, motion, t, config)
    values = gtsam.Values()
    graph = graph_of(problem.entries)
    for k in range(len(t)):
        values.insert(X(k), problem.initial_state(k))
        for key, first in problem.variables[k]:
            values.insert(key, first(values.atNavState))
        for factor in made(problem.readings[k][1:], values.atNavState):
            graph.add(factor)
    return problem, graph, values


def in_sigmas(cov: Array, wanted: Array) -> Array:
    sigma = np.maximum(np.sqrt(np.diag(wanted)), 1e-2)  # what is pinned has next to none
    return cov / np.outer(sigma, sigma)


def test_they_are_the_graphs_own_wherever_the_variables_lie(
    settled: tuple[Problem, Any, gtsam.Values],
) -> None:
    """Also of a reading that is not in the graph, and of a landmark and who might have seen it."""
    problem, graph, values = settled
    k = next(k for k, brought in enumerate(problem.readings) if brought and k > 1)
    groups: list[tuple[int, ...]] = [
        (X(0),),
        (error_key(0, k), X(k)),
        (problem.compass[k], X(k)),
        *((X(2), key) for key in problem.landmarks.values()),
    ]
    slow = Covariances(graph, values)
    many = joint_covariances(graph, values, groups * (1 + FEW))
    for keys, got in zip(groups, many, strict=False):
        wanted = slow.joint(list(keys))
        np.testing.assert_allclose(in_sigmas(got, wanted), in_sigmas(wanted, wanted), 0, 1e-3)
    assert joint_covariances(graph, values, []) == []


def test_an_indeterminate_graph_is_told_as_by_gtsam() -> None:
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    graph.push_back(factors.depth(X(0), 1.0, np.zeros(3), 0.1))
    values.insert(X(0), gtsam.NavState())
    with pytest.raises(EstimationError, match="no covariance"):
        joint_covariances(graph, values, [(X(0),)])
