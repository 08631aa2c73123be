"""The registry, and the blindness of every method in it: no method sees what it is scored on."""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from solutions import dr_solution

from gtsam_nav.config import Config, load_config
from gtsam_nav.errors import ConfigError, DataError
from gtsam_nav.methods import check_method, estimate, methods
from gtsam_nav.mission import Mission
from gtsam_nav.series import GnssSeries, ReferenceSeries
from gtsam_nav.simulation import simulate
from gtsam_nav.solution import Progress, Solution

DURATION_S, WINDOW_S = 90.0, (0.0, 30.0)
INERTIAL = {"ins-ekf", "landmark-ekf", "graph"}
"""Methods that need no sensor of velocity."""
POLICIES = ["use=all", "use=none", "use=every_k", "use=window", "use=gaps"]


@pytest.fixture(scope="module")
def mission() -> Mission:
    return simulate(seed=2, duration_s=DURATION_S)


def config(*overrides: str) -> Config:
    return load_config(None, [f"gnss.window_s={list(WINDOW_S)}", *overrides])


@dataclass
class Spy:
    """An estimation method that only remembers what it was shown."""

    seen: Mission | None = None
    config: Config | None = None
    progress: Progress | None = None

    def estimate(self, mission: Mission, config: Config, progress: Progress) -> Solution:
        self.seen, self.config, self.progress = mission, config, progress
        progress("spying", 0.5)
        return replace(dr_solution(), mission=mission, reference=None)


@pytest.fixture
def spy(monkeypatch: pytest.MonkeyPatch) -> Spy:
    spy = Spy()
    monkeypatch.setitem(sys.modules, "spy_method", SimpleNamespace(estimate=spy.estimate))  # type: ignore[arg-type]
    registry = sys.modules["gtsam_nav.methods"]
    monkeypatch.setitem(registry._METHODS, "spy", registry._Method("spy_method", ()))
    return spy


def fixes_of(mission: Mission) -> GnssSeries:
    series = mission.sensors["gnss"].series
    assert isinstance(series, GnssSeries)
    return series


def test_the_names_are_those_of_the_design() -> None:
    assert {"dr", "graph"} <= set(methods())


def test_an_unknown_method_is_answered_with_the_choices(mission: Mission) -> None:
    for attempt in (check_method, lambda name: estimate(mission, name)):
        with pytest.raises(
            ConfigError, match=r"unknown method 'magic'; the choices are: .*dr.*graph"
        ):
            attempt("magic")


def test_defaults_are_filled_in(spy: Spy, mission: Mission) -> None:
    estimate(mission, "spy")
    assert spy.config == Config()
    assert spy.progress is not None


def test_progress_reaches_the_caller(spy: Spy, mission: Mission) -> None:
    heard: list[tuple[str, float]] = []
    estimate(mission, "spy", progress=lambda stage, fraction: heard.append((stage, fraction)))
    assert spy.seen is not None
    assert heard == [("spying", 0.5)]


@pytest.mark.parametrize("policy", POLICIES)
def test_a_method_is_shown_nothing_that_it_is_scored_on(
    spy: Spy, mission: Mission, policy: str
) -> None:
    fixes = fixes_of(mission)
    settings = config(f"gnss.{policy}", "gnss.gaps_s=[[10, 20]]", "gnss.every_k=7")
    solution = estimate(mission, "spy", settings)
    assert spy.seen is not None
    assert spy.seen.reference is None
    assert all(sensor.type != "reference" for sensor in spy.seen.sensors.values())
    shown = fixes_of(spy.seen)
    assert len(shown) + solution.gnss_withheld == len(fixes)
    assert solution.reference is mission.reference


@pytest.mark.parametrize("policy", POLICIES)
def test_withheld_fixes_are_the_reference_where_nothing_else_is(
    spy: Spy, mission: Mission, policy: str
) -> None:
    lone = mission.without("reference")
    settings = config(f"gnss.{policy}", "gnss.gaps_s=[[10, 20]]", "gnss.every_k=7")
    solution = estimate(lone, "spy", settings)
    assert spy.seen is not None
    shown = fixes_of(spy.seen)
    if policy == "use=all":
        assert solution.reference is None
        assert solution.gnss_withheld == 0
        return
    assert solution.reference is not None
    truth = solution.reference.series
    assert np.intersect1d(truth.t, shown.t).size == 0
    np.testing.assert_array_equal(np.union1d(truth.t, shown.t), fixes_of(lone).t)
    assert solution.gnss_withheld == len(truth)


def shaken(mission: Mission) -> Mission:
    """The mission with another truth and other fixes outside the window."""
    rng = np.random.default_rng(9)
    reference, gnss = mission.reference, mission.sensors["gnss"]
    assert reference is not None
    truth, fixes = reference.series, fixes_of(mission)
    assert isinstance(truth, ReferenceSeries)
    p_n = fixes.p_n + rng.normal(scale=500.0, size=fixes.p_n.shape) * (fixes.t >= 30.0)[:, None]
    other_truth = replace(truth, p_n=truth.p_n + 1e4, rpy=None)
    return mission.with_sensor(replace(reference, series=other_truth)).with_sensor(
        replace(gnss, series=replace(fixes, p_n=p_n))
    )


def everything(solution: Solution) -> dict[str, Any]:
    """All numbers of an estimate."""
    found = {f"trajectory.{k}": v for k, v in vars(solution.trajectory).items()}
    if solution.online is not None:
        found |= {f"online.{k}": v for k, v in vars(solution.online).items()}
    found |= {f"nis.{sensor}": i.nis for sensor, i in solution.innovations.items()}
    return found


@pytest.mark.slow
@pytest.mark.parametrize("method", [m for m in methods() if m != "kiss"])
def test_what_is_withheld_changes_nothing(mission: Mission, method: str) -> None:
    settings = config("gnss.use=window")
    one, other = (estimate(m, method, settings) for m in (mission, shaken(mission)))
    assert other.gnss_withheld == one.gnss_withheld > 0
    before, after = everything(one), everything(other)
    assert before.keys() == after.keys()
    for name, values in before.items():
        np.testing.assert_array_equal(values, after[name], err_msg=name)


@pytest.mark.parametrize("method", [m for m in methods() if m not in (*INERTIAL, "kiss")])
def test_a_mission_without_velocity_is_refused_by_name(mission: Mission, method: str) -> None:
    still = mission.without("dvl", "odometry")
    with pytest.raises(DataError, match=r"needs a DVL .* the mission has: attitude, depth, gnss"):
        estimate(still, method)


@pytest.mark.parametrize("method", methods())
def test_an_empty_mission_is_refused(method: str) -> None:
    with pytest.raises(DataError, match="mission 'nothing'"):
        estimate(Mission("nothing", {}), method)


def test_landmarks_that_a_method_does_not_use_are_named(spy: Spy) -> None:
    ranger = simulate("ranger", seed=0)
    estimate(ranger, "spy")
    assert spy.seen is not None
    said = "the landmarks of 'landmarks' are not used by spy: landmark-ekf or graph would"
    assert said in spy.seen.warnings
    estimate(ranger.without("landmarks"), "spy")
    assert said not in spy.seen.warnings


def test_the_configuration_has_the_last_word_on_wheels(spy: Spy, mission: Mission) -> None:
    for stated, rolls in (("null", False), ("true", True)):
        estimate(mission, "spy", config(f"motion.nonholonomic={stated}"))
        assert spy.seen is not None
        assert spy.seen.constraints.nonholonomic is rolls
