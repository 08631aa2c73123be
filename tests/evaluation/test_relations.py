"""Scores on surveyed relations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import solutions

import gtsam_nav as gn
from gtsam_nav.evaluation.metrics import Metrics
from gtsam_nav.evaluation.relations import between, planar_poses, relation_scores
from gtsam_nav.mission import Relations
from gtsam_nav.solution import ClockOffset, Solution


@pytest.fixture
def solution() -> Solution:
    return solutions.graph_solution()


def surveyed(solution: Solution, apart_s: list[float], late_s: float = 0.0) -> Relations:
    """Its own relative poses, stamped late."""
    start = solution.trajectory.t[0] + 1.0
    t = np.array([[start + k, start + k + apart] for k, apart in enumerate(apart_s)])
    q = between(*(planar_poses(solution.trajectory, at) for at in t.T))
    return Relations("scans", t + late_s, q)


def test_what_agrees_has_no_error(solution: Solution) -> None:
    scores = relation_scores(solution.trajectory, surveyed(solution, [1.0, 2.0, 40.0]))
    assert scores.near is not None
    assert scores.loops is not None
    assert (scores.near.n, scores.loops.n) == (2, 1)
    assert scores.near.p95_m == pytest.approx(0.0, abs=1e-9)
    assert scores.loops.p95_deg == pytest.approx(0.0, abs=1e-6)


def test_errors_are_told_in_metres_and_degrees(solution: Solution) -> None:
    relations = surveyed(solution, [1.0, 1.0, 1.0])
    off = np.array([[0.3, 0.4, 0.0], [0.0, 0.0, np.radians(2.0)], [0.6, 0.8, np.radians(-4.0)]])
    scores = relation_scores(solution.trajectory, replace(relations, q=relations.q + off))
    assert scores.loops is None
    assert scores.near is not None
    assert scores.near.median_m == pytest.approx(0.5)
    assert scores.near.median_deg == pytest.approx(2.0)


def test_relations_beyond_the_trajectory_are_left_out(solution: Solution) -> None:
    relations = surveyed(solution, [1.0, 1e6])
    scores = relation_scores(solution.trajectory, relations)
    assert scores.near is not None
    assert scores.near.n == 1
    assert scores.loops is None


def test_a_relation_may_end_with_the_trajectory(solution: Solution) -> None:
    t = solution.trajectory.t
    at = np.array([[t[0], t[-1]]])
    relations = Relations(
        "scans", at, between(*(planar_poses(solution.trajectory, a) for a in at.T))
    )
    scores = relation_scores(solution.trajectory, relations)
    found = scores.near or scores.loops
    assert found is not None
    assert found.n == 1


def test_a_pose_in_another_is_forward_starboard_and_a_wrapped_turn() -> None:
    a = np.array([[1.0, 2.0, np.radians(170.0)], [0.0, 0.0, np.radians(30.0)]])
    b = np.array([[1.0, 5.0, np.radians(-170.0)], [2.0, 1.0, np.radians(50.0)]])
    c, s = np.cos(a[:, 2]), np.sin(a[:, 2])
    expected = [
        [3.0 * s[0], 3.0 * c[0], np.radians(20.0)],
        [2.0 * c[1] + s[1], c[1] - 2.0 * s[1], np.radians(20.0)],
    ]
    np.testing.assert_allclose(between(a, b), expected, atol=1e-12)


def test_a_run_is_scored_at_the_times_that_it_found(solution: Solution) -> None:
    late = replace(solution, relations=surveyed(solution, [1.0, 3.0], late_s=0.5))
    found = replace(late, clock_offsets=(ClockOffset("scans", "time_offset", -0.5, 0.01, 0.5),))
    scores = gn.evaluate(found).relations
    assert scores is not None
    assert scores.near is not None
    assert scores.near.p95_m == pytest.approx(0.0, abs=1e-9)
    worse = gn.evaluate(late).relations
    assert worse is not None
    assert worse.near is not None
    assert worse.near.p95_m > 1e-3
    metrics = gn.evaluate(found)
    assert Metrics.from_json(metrics.to_json()) == metrics
