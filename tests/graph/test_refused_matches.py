"""What is said where no match of scans stood."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from gtsam_nav.graph.doubts import FEWEST_MATCHES, refused_matches


def matches(n: int, accepted: int = 0) -> Any:
    return [SimpleNamespace(accepted=k < accepted) for k in range(n)]


def test_none_of_many_is_said_with_the_mend() -> None:
    (said,) = refused_matches(matches(16))
    assert said.startswith("none of 16 matches")
    assert "sonar.use=false" in said


@pytest.mark.parametrize(("n", "accepted"), [(0, 0), (FEWEST_MATCHES - 1, 0), (16, 1)])
def test_few_or_some_are_not(n: int, accepted: int) -> None:
    assert not list(refused_matches(matches(n, accepted)))
