"""What is said where no loop closure of scans stood."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from gtsam_nav.graph.doubts import FEWEST_LOOPS, refused_loops


def matches(n: int, accepted: int = 0, is_loop: bool = True) -> Any:
    return [SimpleNamespace(accepted=k < accepted, is_loop=is_loop) for k in range(n)]


def test_none_of_many_is_said_with_the_mend() -> None:
    (said,) = refused_loops(matches(16))
    assert said.startswith("none of 16 loop closures")
    assert "sonar.use=false" in said


@pytest.mark.parametrize(("n", "accepted"), [(0, 0), (FEWEST_LOOPS - 1, 0), (16, 1)])
def test_few_or_some_are_not(n: int, accepted: int) -> None:
    assert not list(refused_loops(matches(n, accepted)))


def test_neither_are_matches_of_successive_scans() -> None:
    assert not list(refused_loops(matches(16, is_loop=False)))
