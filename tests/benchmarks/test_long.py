"""The long checks: all of them are run, and one that fails is named."""

from __future__ import annotations

from importlib.util import find_spec
from types import SimpleNamespace

import pytest

from benchmarks import long


def test_every_check_is_there() -> None:
    for check in long.CHECKS:
        assert find_spec(f"benchmarks.{check.module}") is not None, check.module


@pytest.mark.parametrize("arguments", [[], ["--quick"]], ids=["whole", "quick"])
def test_the_check_that_failed_is_told_and_the_others_run(
    arguments: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    commands: list[list[str]] = []

    def run(command: list[str], **_: object) -> SimpleNamespace:
        commands.append(command)
        return SimpleNamespace(returncode=3 if "benchmarks.fuzz" in command else 0)

    monkeypatch.setattr(long.subprocess, "run", run)
    with pytest.raises(SystemExit) as ended:
        long.main(arguments)
    assert ended.value.code == 1
    given = {command[2]: tuple(command[3:]) for command in commands}
    assert given == {
        f"benchmarks.{check.module}": check.quick if arguments else check.whole
        for check in long.CHECKS
    }
    told = capsys.readouterr().out.splitlines()[-len(long.CHECKS) :]
    assert ["failed with exit code 3" in line for line in told] == [False, True, False, False]
