"""What the incremental estimate tells of several keyframes together."""

from __future__ import annotations

import gtsam
import numpy as np
import pytest

from gtsam_nav.config import Config
from gtsam_nav.graph import backend, factors
from gtsam_nav.graph.backend import Backend, graph_of, planar_rows
from gtsam_nav.graph.factors import X
from gtsam_nav.graph.keyframes import keyframe_times
from gtsam_nav.graph.measurements import build_problem
from gtsam_nav.graph.problem import Problem, SensorFactor
from gtsam_nav.graph.scan_matching import LOOP
from gtsam_nav.preprocess.alignment import align
from gtsam_nav.preprocess.motion import vehicle_motion
from gtsam_nav.simulation import simulate


def _problem() -> Problem:
    """Twenty seconds of the marina on water, without any reading."""
    mission = simulate("marina", seed=3, duration_s=20.0).without("imu").without("gnss")
    start = align(mission)
    motion = vehicle_motion(mission, start, Config().motion)
    t = keyframe_times(*mission.span_s, np.empty(0), 5.0)
    problem = build_problem(mission, start, motion, t, Config())
    problem.readings = [[] for _ in t]
    return problem


def test_joint_covariances_are_those_of_the_batch() -> None:
    problem = _problem()
    running = Backend(problem)
    for k in range(len(problem.t)):
        running.add_keyframe(k)
    running.update()
    graph = graph_of(problem.entries)
    for hint in problem.hints:
        graph.add(hint)
    values = running.values()
    marginals = gtsam.Marginals(graph, values)
    keys = [X(k) for k in (0, 2, 4)]
    joint = marginals.jointMarginalCovariance(keys)
    S = {key: planar_rows(values.atNavState(key).attitude().matrix()) for key in keys}
    for earlier, got in zip(keys[:2], running.joint_planar_covariances([0, 2], 4), strict=True):
        ends = (earlier, keys[2])
        wanted = np.block([[S[a] @ joint.at(a, b) @ S[b].T for b in ends] for a in ends])
        sigma = np.sqrt(np.diag(wanted))
        np.testing.assert_allclose(
            got / np.outer(sigma, sigma), wanted / np.outer(sigma, sigma), 0, 1e-3
        )


def test_a_new_order_changes_no_estimate(monkeypatch: pytest.MonkeyPatch) -> None:
    """Loops come in before the last keyframes; what follows finds the tree ordered anew."""

    def run(loops_per_ordering: int) -> Backend:
        monkeypatch.setattr(backend, "LOOPS_PER_ORDERING", loops_per_ordering)
        running = Backend(_problem())
        for k in range(5):
            running.add_keyframe(k)
            if k == 3:
                q, cov = np.array([0.5, 0.0, 0.0]), 0.1 * np.eye(3)
                loop = factors.planar_match(X(0), X(2), q, cov)
                running.add_factor(SensorFactor(LOOP, loop))
            running.update()
            running.state(k)
        return running

    plain, ordered = run(100), run(1)
    assert (plain._loops_since_ordering, ordered._loops_since_ordering) == (1, 0)
    np.testing.assert_allclose(ordered.covariance(4), plain.covariance(4), 1e-3, 1e-9)
    for k in range(5):
        got, wanted = ordered.peek(k), plain.peek(k)
        np.testing.assert_allclose(got.position(), wanted.position(), 0, 1e-3)
