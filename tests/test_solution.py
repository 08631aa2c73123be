"""The stage clock, and what a solution says of its sonar."""

from __future__ import annotations

import time
from dataclasses import replace

import pytest
from solutions import graph_solution

from gtsam_nav.solution import StageClock


def test_stages_add_up_in_the_order_they_first_ran(monkeypatch: pytest.MonkeyPatch) -> None:
    now = iter([0.0, 1.0, 10.0, 12.0, 20.0, 20.5])
    monkeypatch.setattr(time, "perf_counter", lambda: next(now))
    clock = StageClock()
    for name in ("motion", "graph", "motion"):
        with clock.stage(name):
            pass
    assert list(clock.seconds.items()) == [("motion", 1.5), ("graph", 2.0)]


def test_a_stage_that_fails_is_still_timed(monkeypatch: pytest.MonkeyPatch) -> None:
    now = iter([3.0, 7.0])
    monkeypatch.setattr(time, "perf_counter", lambda: next(now))
    clock = StageClock()
    with pytest.raises(RuntimeError, match="no luck"), clock.stage("graph"):
        raise RuntimeError("no luck")
    assert clock.seconds == {"graph": 4.0}


def test_stages_nest() -> None:
    clock = StageClock()
    with clock.stage("all"):
        with clock.stage("part"):
            time.sleep(0.01)
        time.sleep(0.01)
    assert clock.seconds["all"] >= clock.seconds["part"] + 0.01 >= 0.02


def test_a_solution_knows_the_sonar_of_its_mission() -> None:
    solution = graph_solution()
    assert solution.sonar_kind == "simulated"
    deaf = replace(solution, mission=solution.mission.without("beams"))
    assert deaf.sonar_kind is None


def test_what_is_printed_fits_a_line() -> None:
    solution = graph_solution()
    for text in (repr(solution), repr(solution.mission)):
        assert len(text) < 300
        assert solution.mission.name in text
    assert f"'{solution.method}'" in repr(solution)
