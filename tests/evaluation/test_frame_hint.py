"""Hints on trajectories in other axes than their reference."""

from __future__ import annotations

import numpy as np
import pytest

from gtsam_nav.evaluation.frame_hint import READINGS, frame_hint
from gtsam_nav.frames import Array
from gtsam_nav.series import ReferenceSeries
from gtsam_nav.trajectory import Trajectory

T = np.arange(0.0, 100.0)
P_N = np.column_stack([0.5 * T, 8.0 * np.sin(T / 15.0), 0.0 * T])


def hint(p_n: Array, reference_n: Array = P_N, *, georeferenced: bool = True) -> str | None:
    noise = np.random.default_rng(1).normal(0.0, 0.1, p_n.shape)
    still = np.tile([1.0, 0.0, 0.0, 0.0], (len(T), 1))
    trajectory = Trajectory(t=T, p_n=p_n + noise, q_nb_wxyz=still)
    reference = ReferenceSeries(t=T, p_n=reference_n)
    return frame_hint(trajectory, reference, georeferenced=georeferenced)


def turned(p_n: Array, by_deg: float) -> Array:
    c, s = np.cos(np.radians(by_deg)), np.sin(np.radians(by_deg))
    return p_n @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]).T


def test_a_good_trajectory_gets_none() -> None:
    assert hint(P_N) is None
    assert hint(turned(P_N, 20.0)) is None
    assert hint(P_N + np.array([30.0, -20.0, 0.0])) is None
    assert hint(P_N * [1.2, 1.2, 1.0]) is None


@pytest.mark.parametrize(("name", "axes"), READINGS)
def test_each_reading_is_named(name: str, axes: Array) -> None:
    wrong = P_N.copy()
    wrong[:, :2] = P_N[:, :2] @ axes  # the inverse of a rotation or reflection
    told = hint(wrong)
    assert told is not None
    assert name in told


def test_a_mirrored_one_in_a_frame_of_its_own() -> None:
    mirrored = turned(P_N * [1.0, -1.0, 1.0], 35.0)
    for georeferenced in (True, False):
        told = hint(mirrored, georeferenced=georeferenced)
        assert told is not None
        assert "mirrored" in told
    assert hint(turned(P_N, 90.0), georeferenced=False) is None


def test_straight_ways_and_few_points_tell_nothing() -> None:
    straight = np.column_stack([T, 0 * T, 0 * T])
    assert hint(straight * [1.0, -1.0, 1.0], straight) is None
    lost = np.random.default_rng(2).normal(0.0, 10.0, P_N.shape)
    assert hint(lost) is None
