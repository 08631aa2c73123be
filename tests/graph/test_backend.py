"""What the incremental estimate tells of several keyframes together."""

from __future__ import annotations

import logging
from typing import Any

import gtsam
import numpy as np
import pytest

from gtsam_nav.config import Config
from gtsam_nav.frames import Array
from gtsam_nav.graph import backend as backend_module
from gtsam_nav.graph.backend import JUMP, LEAST_CHANGE, Backend, graph_of, planar_rows
from gtsam_nav.graph.factors import B, M, X
from gtsam_nav.graph.keyframes import keyframe_times
from gtsam_nav.graph.measurements import build_problem
from gtsam_nav.graph.online import run_online
from gtsam_nav.graph.outset import mission_keyframes, start_and_motion
from gtsam_nav.graph.problem import Problem
from gtsam_nav.mission import Mission
from gtsam_nav.preprocess.alignment import align
from gtsam_nav.preprocess.motion import vehicle_motion
from gtsam_nav.simulation import simulate
from gtsam_nav.solution import no_progress


def test_joint_covariances_are_those_of_the_batch() -> None:
    mission = simulate("marina", seed=3, duration_s=20.0).without("imu").without("gnss")
    start = align(mission)
    motion = vehicle_motion(mission, start, Config().motion)
    t = keyframe_times(*mission.span_s, np.empty(0), 5.0)
    problem = build_problem(mission, start, motion, t, Config())
    problem.readings = [[] for _ in t]
    backend = Backend(problem)
    for k in range(len(t)):
        backend.add_keyframe(k)
    backend.update()
    graph = graph_of(problem.entries)
    for hint in problem.hints:
        graph.add(hint)
    values = backend.values()
    marginals = gtsam.Marginals(graph, values)
    keys = [X(k) for k in (0, 2, 4)]
    joint = marginals.jointMarginalCovariance(keys)
    S = {key: planar_rows(values.atNavState(key).attitude().matrix()) for key in keys}
    for earlier, got in zip(keys[:2], backend.joint_planar_covariances([0, 2], 4), strict=True):
        ends = (earlier, keys[2])
        wanted = np.block([[S[a] @ joint.at(a, b) @ S[b].T for b in ends] for a in ends])
        sigma = np.sqrt(np.diag(wanted))
        np.testing.assert_allclose(
            got / np.outer(sigma, sigma), wanted / np.outer(sigma, sigma), 0, 1e-3
        )


def online_positions(mission: Mission) -> Array:
    """Of the keyframes, as the causal pass knew them when they entered."""
    config = Config()
    start, motion = start_and_motion(mission, config)
    t = mission_keyframes(mission, np.empty(0), np.empty(0), config)
    problem = build_problem(mission, start, motion, t, config)
    passed = run_online(problem, None, np.empty(0, dtype=int), config, no_progress)
    return np.array([state.position() for state in passed.states])


def test_slow_states_begin_where_they_are_known_to_be(monkeypatch: pytest.MonkeyPatch) -> None:
    """From zero, the biases of each keyframe would be linearised twice."""
    made: list[Any] = []
    make = backend_module._isam2
    monkeypatch.setattr(backend_module, "_isam2", lambda stiff: made.append(make(stiff)) or made[0])
    mission = simulate("marina", seed=3, duration_s=20.0).without("sonar", "landmarks")
    start, motion = start_and_motion(mission, Config())
    t = keyframe_times(*mission.span_s, np.empty(0), 5.0)
    backend = Backend(build_problem(mission, start, motion, t, Config()))
    for k in range(4):
        backend.add_keyframe(k)
        backend.update()
        backend.latest(k)
    before, last = backend.values(), backend.problem.t.size - 1
    backend.add_keyframe(last)
    backend.update()
    begun = made[0].getLinearizationPoint()
    known = before.atConstantBias(B(last - 1)).vector()
    assert np.linalg.norm(known) > 0.01
    np.testing.assert_allclose(begun.atConstantBias(B(last)).vector(), known, atol=1e-12)
    disturbance = before.atNavState(M(last - 1)).attitude().yaw()
    assert abs(disturbance) > 1e-4
    assert begun.atNavState(M(last)).attitude().yaw() == pytest.approx(disturbance, abs=1e-9)


def test_where_cholesky_fails_the_pass_goes_on_by_qr(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    mission = simulate("laps", seed=1, duration_s=20.0)
    by_qr = online_positions(mission)
    caplog.set_level(logging.INFO, logger="gtsam_nav")
    monkeypatch.setattr(Problem, "is_stiff", False)
    recovered = online_positions(mission)
    assert "anew by QR" in caplog.text
    np.testing.assert_allclose(recovered, by_qr, atol=1e-6)


class Failing:
    """An iSAM2 that takes its third update in, and then says that it is indeterminate."""

    def __init__(self, isam: Any) -> None:
        self._isam, self._updates = isam, 0

    def update(self, graph: Any, values: Any, **options: Any) -> None:
        self._isam.update(graph, values, **options)
        self._updates += 1
        if self._updates == 3:
            raise RuntimeError("Indeterminate linear system")

    def __getattr__(self, name: str) -> Any:
        return getattr(self._isam, name)


@pytest.mark.parametrize(("most", "kinds"), [(10, [False, False]), (0, [False, True])])
def test_a_failure_in_one_order_is_begun_anew_in_another(
    most: int, kinds: list[bool], monkeypatch: pytest.MonkeyPatch
) -> None:
    mission = simulate("marina", seed=3, duration_s=40.0).without("sonar")
    undisturbed = online_positions(mission)
    made: list[bool] = []

    def isam2(is_stiff: bool) -> Any:
        made.append(is_stiff)
        return Failing(plain(is_stiff)) if len(made) == 1 else plain(is_stiff)

    plain = backend_module._isam2
    monkeypatch.setattr(backend_module, "_isam2", isam2)
    monkeypatch.setattr(backend_module, "MOST_FRESH_STARTS", most)
    recovered = online_positions(mission)
    assert made == kinds
    np.testing.assert_allclose(recovered, undisturbed, atol=1e-3)


def test_a_longer_mission_hands_more_keyframes_over_at_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("gtsam_nav.graph.online.MOST_UPDATES", 2)
    updates: list[int] = []
    plain = backend_module.Backend.update

    def counted(self: Backend) -> None:
        updates.append(self._new_values.size())
        plain(self)

    monkeypatch.setattr(Backend, "update", counted)
    online_positions(simulate("marina", seed=3, duration_s=40.0).without("sonar"))
    assert len(updates) == 3
    assert updates[-1] == 0
    assert 0 < updates[1] <= updates[0]


class Untold:
    """An iSAM2 that gives no state's marginal, and remembers when it had to look at all states."""

    def __init__(self, isam: Any) -> None:
        self._isam = isam
        self.looked: list[bool] = []

    def update(self, graph: Any, values: Any, *, force_relinearize: bool) -> None:
        self.looked.append(force_relinearize)
        self._isam.update(graph, values, force_relinearize=force_relinearize)

    def marginalFactor(self, key: int) -> Any:  # noqa: N802
        raise RuntimeError(f"Indeterminate linear system near {key}")

    def __getattr__(self, name: str) -> Any:
        return getattr(self._isam, name)


def watched(monkeypatch: pytest.MonkeyPatch) -> list[Untold]:
    """The iSAM2s that are made from here on."""
    made: list[Untold] = []
    plain = backend_module._isam2
    monkeypatch.setattr(
        backend_module, "_isam2", lambda stiff: made.append(Untold(plain(stiff))) or made[-1]
    )
    return made


def test_a_state_by_its_marginal_is_that_of_all_states(monkeypatch: pytest.MonkeyPatch) -> None:
    mission = simulate("marina", seed=3, duration_s=40.0).without("sonar")
    by_marginals = online_positions(mission)
    made = watched(monkeypatch)
    np.testing.assert_allclose(online_positions(mission), by_marginals, atol=LEAST_CHANGE)
    assert len(made) == 1


def test_after_a_jump_all_states_are_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    made = watched(monkeypatch)
    mission = simulate("marina", seed=3, duration_s=40.0).without("sonar")
    online_positions(mission)
    assert not any(made[0].looked)
    predicted = Problem.predicted

    def beside(self: Problem, k: int, before: Any, bias: Any) -> Any:
        state = predicted(self, k, before, bias)
        return state.retract(np.eye(9)[3] * 2.0 * JUMP[3]) if k == 1 else state

    monkeypatch.setattr(Problem, "predicted", beside)
    online_positions(mission)
    assert made[1].looked[:3] == [False, True, False]
