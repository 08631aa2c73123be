"""The matrix of versions: bounds that can be pinned, and constraints that hold all of them."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

from benchmarks.versions import failures, last_line, lower_bounds, pinned

ROOT = Path(__file__).parents[2]
CONSTRAINT = re.compile(r"([a-z0-9-]+)==([\w.]+)(; python_version == \"3\.\d+\")?")


def number(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in re.findall(r"\d+", version))


def canonical(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def test_every_dependency_has_a_lower_bound() -> None:
    lines = lower_bounds(ROOT / "pyproject.toml")
    assert "gtsam==4.3.0" in lines
    assert any(line.startswith("open3d==") and "python_version < '3.13'" in line for line in lines)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    n_test = len(project["optional-dependencies"]["test"])
    assert len(lines) == len(project["dependencies"]) + n_test


def test_a_dependency_without_a_bound_is_named(tmp_path: Path) -> None:
    path = tmp_path / "pyproject.toml"
    path.write_text('[project]\ndependencies = ["numpy"]\noptional-dependencies = {test = []}\n')
    with pytest.raises(ValueError, match="'numpy' states no lower bound"):
        lower_bounds(path)


def test_only_what_differs_says_for_which_python() -> None:
    found = pinned({"3.11": {"a": "1", "b": "1"}, "3.12": {"a": "1", "b": "2", "c": "3"}})
    assert found == [
        "a==1",
        'b==1; python_version == "3.11"',
        'b==2; python_version == "3.12"',
        "c==3",
    ]


def test_the_constraints_are_names_and_versions_that_the_bounds_allow() -> None:
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    matches = [CONSTRAINT.fullmatch(line) for line in lines]
    assert [line for line, m in zip(lines, matches, strict=True) if m is None] == []
    chosen: dict[str, list[str]] = {}
    for match in matches:
        assert match is not None
        chosen.setdefault(match[1], []).append(match[2])
    for bound in lower_bounds(ROOT / "pyproject.toml"):
        name, lowest = bound.partition(";")[0].split("==")
        versions = chosen[canonical(name)]
        assert all(number(version) >= number(lowest) for version in versions), name


def test_the_last_line_that_says_something_is_told() -> None:
    assert last_line("a\nb\n\n") == "b"
    assert last_line("") == "no word"


def test_the_tests_that_failed_are_told() -> None:
    summary = "FAILED tests/a.py::b - assert 1 == 2\nERROR tests/c.py\nSKIPPED [1] d\n1 failed\n"
    assert failures(summary) == ["FAILED tests/a.py::b - assert 1 == 2", "ERROR tests/c.py"]
