"""Benchmarks that are called wrongly say so in a line, before any work."""

from __future__ import annotations

import sys

import pytest

from benchmarks import acceptance, aces, consistency
from benchmarks.speed import mission


@pytest.mark.parametrize(
    ("benchmark", "arguments", "said"),
    [
        (aces, ["nowhere"], "aces.clf.bz2"),
        (acceptance, ["--stpere", "nowhere"], "nowhere"),
        (consistency, ["--case", "nosuch"], "the cases are: laps, ins-ekf, matched; "),
        (consistency, ["--case", "laps", "nosuch"], "no case's name contains 'nosuch'"),
        (mission, [], "required: PATH, METHOD"),
        (mission, ["nowhere", "dr"], "nowhere"),
    ],
)
def test_wrong_use_is_refused(
    benchmark: object,
    arguments: list[str],
    said: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(sys, "argv", ["benchmark", *arguments])
    with pytest.raises(SystemExit) as ended:
        benchmark.main()  # type: ignore[attr-defined]
    assert ended.value.code == 2
    assert said in capsys.readouterr().err


def test_the_speed_of_a_mission_has_help(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["mission", "--help"])
    with pytest.raises(SystemExit) as ended:
        mission.main()
    assert ended.value.code == 0
    assert "KEY=VALUE" in capsys.readouterr().out
