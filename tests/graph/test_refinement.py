"""The joint refinement: one answer, wherever it begins."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any

import gtsam
import numpy as np
import pytest

import gtsam_nav as gn
from gtsam_nav.frames import Array, rotation_from_rpy
from gtsam_nav.graph import estimator, refinement
from gtsam_nav.graph.factors import X
from gtsam_nav.graph.refinement import JointRefinement, Refined
from gtsam_nav.series import BeamSeries
from gtsam_nav.solution import no_progress

pytestmark = pytest.mark.slow

SAME_M = 0.01

MOST_ITERATIONS = 6
"""A start that is off by a turn or a stretch needs none of its own."""
FEW_ITERATIONS = 3
"""One at the widest gate, one at the last, and one for what that still moves."""


@dataclass
class Start:
    """What a refinement is made of and begins with."""

    arguments: tuple[Any, ...]
    graph: Any
    values: Any

    def refined(self, values: Any) -> Refined:
        return JointRefinement(*self.arguments).run(self.graph, values, no_progress)

    def positions(self, values: Any) -> Array:
        keyframes = range(len(self.arguments[2].t))
        return np.array([values.atNavState(X(k)).position()[:2] for k in keyframes])


@pytest.fixture(scope="module")
def start() -> Start:
    """A marina without fixes: nothing but a compass ties its heading."""
    found: list[Start] = []

    class Recording(JointRefinement):
        def __init__(self, *arguments: Any) -> None:
            super().__init__(*arguments)
            self.arguments = arguments

        def run(self, graph: Any, values: Any, progress: Any) -> Refined:
            found.append(Start(self.arguments, graph, values))
            return super().run(graph, values, progress)

    mission = gn.simulate("marina", seed=3, duration_s=60.0)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(estimator, "JointRefinement", Recording)
        gn.estimate(mission, "graph", gn.load_config(None, ["gnss.use=none"]))
    return found[0]


def moved(start: Start, yaw_deg: float = 0.0, scale: float = 1.0, jitter_m: float = 0.0) -> Any:
    """The start turned about and stretched from the first keyframe, each position shaken."""
    values, rng = gtsam.Values(start.values), np.random.default_rng(0)
    turn = rotation_from_rpy(np.array([0.0, 0.0, np.radians(yaw_deg)]))
    first = values.atNavState(X(0)).position()
    for k in range(len(start.arguments[2].t)):
        state = values.atNavState(X(k))
        p_n = first + turn @ (state.position() - first) * [scale, scale, 1.0]
        p_n[:2] += jitter_m * rng.normal(size=2)
        attitude = gtsam.Rot3(turn @ state.attitude().matrix())
        values.update(X(k), gtsam.NavState(attitude, p_n, turn @ state.velocity()))
    return values


@pytest.fixture(scope="module")
def plain(start: Start) -> Array:
    """Where the start as it is leads."""
    return start.positions(start.refined(start.values).values)


@pytest.mark.parametrize(
    "change",
    [{"jitter_m": 1e-3}, {"yaw_deg": 25.0}, {"scale": 0.95}],
    ids=["shaken", "turned", "stretched"],
)
def test_all_starts_settle_on_one_track(
    start: Start, plain: Array, change: dict[str, float]
) -> None:
    """Sensors that are linear about a start once and for all stretch a track that is turned."""
    refined = start.refined(moved(start, **change))
    assert refined.converged
    assert refined.iterations <= MOST_ITERATIONS
    np.testing.assert_allclose(start.positions(refined.values), plain, atol=SAME_M)


def test_sensors_linearised_anew_at_each_step_lead_to_the_same(
    start: Start, plain: Array, monkeypatch: pytest.MonkeyPatch
) -> None:
    for bound in ("ALL_BUT_LINEAR", "ON_THE_WAY"):
        monkeypatch.setattr(refinement, bound, np.zeros(3))
    refined = start.refined(moved(start, yaw_deg=25.0))
    assert refined.converged
    np.testing.assert_allclose(start.positions(refined.values), plain, atol=SAME_M)


def test_a_gate_at_which_nothing_moves_narrows_at_once(start: Start) -> None:
    settled = start.refined(start.values).values
    assert start.refined(settled).iterations <= FEW_ITERATIONS


@dataclass
class Scripted:
    """Stands for the system of the knots: moves one of them north as it is written."""

    steps_m: list[float]
    gates: list[float] = field(default_factory=list)
    rounds: list[int] = field(default_factory=list)
    made_at: list[int] = field(default_factory=list)
    walls_at: list[int] = field(default_factory=list)

    def made(self, *_: Any) -> Scripted:
        self.made_at.append(len(self.gates))
        return self

    def with_sonar(self, _information: Any, _gradient: Array, before: Array) -> Any:
        planar = before.copy()
        planar[0, 0] += self.steps_m[len(self.gates) - 1]
        return SimpleNamespace(planar=planar, moved=lambda: self.values)

    def run(self, start: Start, patch: pytest.MonkeyPatch, **settings: float) -> Refined:
        self.values, script = start.values, self

        class Recording(JointRefinement):
            def _normal_equations(self, *arguments: Any) -> Any:
                script.gates.append(arguments[-1])
                script.rounds.append(self._rounds)
                return super()._normal_equations(*arguments)

            def _walls(self, *arguments: Any) -> Any:
                script.walls_at.append(len(script.gates))
                return super()._walls(*arguments)

        patch.setattr(refinement, "KnotSystem", self.made)
        *arguments, defaults = start.arguments
        joint = Recording(*arguments, defaults.model_copy(update=settings))
        return joint.run(start.graph, start.values, no_progress)


def test_the_gate_narrows_by_its_factor_and_at_once_where_the_knots_arrive(
    start: Start, monkeypatch: pytest.MonkeyPatch
) -> None:
    script = Scripted([2.0, 0.5, 0.08, 0.02])
    refined = script.run(start, monkeypatch)
    assert (refined.iterations, refined.converged) == (4, True)
    np.testing.assert_allclose(script.gates, [3.0, 3.0 * 0.85, 3.0 * 0.85**2, 1.0])
    # anew after two metres, and where they arrived half a metre from there
    assert script.made_at == [0, 1, 3]
    assert script.walls_at == [0, 1, 2, 3]
    assert script.rounds == [0, 1, 2, 0]


def test_nothing_has_settled_on_sensors_that_are_linear_elsewhere(
    start: Start, monkeypatch: pytest.MonkeyPatch
) -> None:
    script = Scripted([0.5, 0.02, 0.02])
    refined = script.run(start, monkeypatch, first_gate_m=1.0)
    assert (refined.iterations, refined.converged) == (3, True)
    assert script.made_at == [0, 2]


def test_what_echoes_err_together_is_measured_at_the_last_gate(
    start: Start, monkeypatch: pytest.MonkeyPatch
) -> None:
    script = Scripted([0.5, 0.5, 0.02, 0.02])
    script.run(start, monkeypatch, first_gate_m=1.1)
    np.testing.assert_allclose(script.gates, [1.1, 1.0, 1.0, 1.0])
    assert script.rounds == [0, 0, 1, 2]


def test_steps_within_a_coarser_convergence_settle(
    start: Start, monkeypatch: pytest.MonkeyPatch
) -> None:
    script = Scripted([0.3, -0.3, 0.3])
    refined = script.run(start, monkeypatch, converged_m=0.5)
    assert (refined.iterations, refined.converged) == (2, True)


def test_a_sonar_that_falls_silent_leaves_an_estimate() -> None:
    mission = gn.simulate("marina", seed=0, duration_s=90.0)
    sonar = mission.sensors["sonar"]
    beams = sonar.series
    assert isinstance(beams, BeamSeries)
    heard = (beams.t < 45.0)[:, None]
    silent = replace(sonar, series=replace(beams, intensity=beams.intensity * heard))
    solution = gn.estimate(mission.with_sensor(silent), "graph")
    assert mission.reference is not None
    assert gn.evaluate(solution, mission.reference).ate.none.rmse < 2.0


def test_scans_of_too_few_points_are_not_registered(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: Any) -> None:
        raise AssertionError("the echoes of thin scans were registered")

    monkeypatch.setattr(estimator, "JointRefinement", refused)
    mission = gn.simulate("marina", seed=3, duration_s=60.0)
    solution = gn.estimate(
        mission, "graph", gn.load_config(None, ["sonar.scans.min_points=100000"])
    )
    assert solution.scans is not None
    thin = [r.index for r in solution.rejections if r.reason == "fewer than 100000 points"]
    assert thin == list(range(len(solution.scans.t)))
