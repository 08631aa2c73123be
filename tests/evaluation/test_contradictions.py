"""Warnings on sensors that a gate refused for long."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from gtsam_nav.evaluation.contradictions import contradictions
from gtsam_nav.mission import Mission, Rejection
from gtsam_nav.solution import Innovations, Solution
from gtsam_nav.trajectory import Trajectory

T = np.arange(200) * 0.5


def solution(refused: Sequence[int], reason: str = "innovation gate") -> Solution:
    used = np.delete(T, refused)
    innovations = {"dvl": Innovations(used, np.ones(len(used)), 3)} if len(used) else {}
    return Solution(
        method="ins-ekf",
        trajectory=Trajectory(
            t=T, p_n=np.zeros((200, 3)), q_nb_wxyz=np.tile([1.0, 0, 0, 0], (200, 1))
        ),
        mission=Mission("m", {}),
        rejections=tuple(Rejection(T[k], "dvl", k, reason, 9.0) for k in refused),
        innovations=innovations,
    )


def test_a_long_refusal_is_said_with_its_time() -> None:
    (said,) = contradictions(solution(range(40, 80)))
    assert said.startswith(
        "dvl: 40 of 200 measurements were rejected, in one run those from 20.0 s to 39.5 s"
    )
    assert "contradict" in said


def test_of_several_runs_the_longest_is_named() -> None:
    (said,) = contradictions(solution([*range(10, 18), *range(60, 110), *range(150, 190)]))
    assert "in one run those from 30.0 s to 54.5 s" in said


@pytest.mark.parametrize(("n", "said"), [(21, 1), (20, 0)])
def test_more_than_ten_seconds_are_long(n: int, said: int) -> None:
    assert len(list(contradictions(solution(range(50, 50 + n + 1))))) == said


@pytest.mark.parametrize(("n", "said"), [(20, 1), (19, 0)])
def test_fewer_than_twenty_may_be_outliers(n: int, said: int) -> None:
    kept = solution(range(1, 10 * n, 10))
    few = replace(kept, innovations={"dvl": Innovations(T[:5], np.ones(5), 3)})
    assert len(list(contradictions(few))) == said


def test_a_sensor_that_is_refused_always_is_said() -> None:
    (said,) = contradictions(solution(range(200)))
    assert said.startswith("dvl: 200 of 200")


def test_most_of_a_sensor_is_said_though_some_pass_in_between() -> None:
    assert len(list(contradictions(solution([k for k in range(200) if k % 3])))) == 1


@pytest.mark.parametrize(
    "refused", [range(0, 200, 3), range(50, 60), [10, 80, 150]], ids=["third", "burst", "few"]
)
def test_outliers_are_not(refused: Sequence[int]) -> None:
    assert not list(contradictions(solution(refused)))


def test_what_a_reader_left_out_is_not() -> None:
    assert not list(contradictions(solution(range(200), "no lock")))
