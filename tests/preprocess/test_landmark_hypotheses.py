"""Explanations of sightings, with what only later ones tell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gtsam_nav.frames import Array
from gtsam_nav.preprocess.landmark_drift import of_odometry
from gtsam_nav.preprocess.landmark_hypotheses import Sighted, _Hypotheses, explained
from gtsam_nav.preprocess.planar_motion import Increments
from gtsam_nav.preprocess.planar_smoothing import SightedPoints
from gtsam_nav.series import IntArray

GATE = 13.8
ROW = np.array([[0.0, 2.0], [1.0, 2.0], [2.0, 2.0], [4.0, 2.0]])
"""Landmarks beside a straight path; the steps between the first three are alike."""


def drive(x: Array, pose: IntArray, landmark: IntArray, variance: Array) -> Sighted:
    """Along poses n (course north) with exact sightings and odometry of the given variance."""
    p_b = ROW[landmark] - np.column_stack([x[pose], np.zeros(len(pose))])
    steps = np.column_stack([np.diff(x), np.zeros(len(x) - 1)])
    cov_b = np.tile(0.05**2 * np.eye(2), (len(pose), 1, 1))
    seen = SightedPoints(pose, p_b, cov_b)
    increments = Increments(steps, np.zeros(len(x) - 1), variance, steps[:, 0])
    return Sighted(increments, seen, np.ones(len(pose)), of_odometry(increments, 0.0, 0.0))


def row_seen_twice(odometry_off_m: float) -> tuple[Sighted, IntArray]:
    """All are seen, then after a long way, over which the odometry errs, two and two again."""
    x = np.array([0.0, 0.1, 0.2, 0.3])
    pose = np.array([0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 3, 3])
    landmark = np.array([0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3])
    variance = np.tile([1e-4, 1e-4, 1e-6], (3, 1))
    variance[1] = 0.8**2, 1e-2, 1e-4
    found = drive(x, pose, landmark, variance)
    found.increments.displacement_b[1, 0] += odometry_off_m
    return found, landmark


@pytest.mark.parametrize("most", [1, 20])
def test_where_nothing_errs_each_landmark_is_told(most: int) -> None:
    found, landmark = row_seen_twice(0.0)
    np.testing.assert_array_equal(_relabelled(explained(found, most, GATE).landmark), landmark)


def test_what_errs_alike_is_told_by_what_is_seen_later() -> None:
    """The odometry is off by a step of the row: the pair fits one too far, the next tells."""
    found, landmark = row_seen_twice(0.9)
    one, many = (_Hypotheses(found, most, GATE).run() for most in (1, 20))
    np.testing.assert_array_equal(_relabelled(many.landmark), landmark)
    assert np.any(_relabelled(one.landmark) != landmark)
    assert many.cost < one.cost


def test_two_sightings_of_a_moment_are_never_of_one_landmark() -> None:
    x, pose = np.zeros(1), np.zeros(2, dtype=np.int64)
    found = drive(x, pose, np.array([0, 0]), np.zeros((0, 3)))
    assert len(set(explained(found, 20, GATE).landmark.tolist())) == 2


def test_backwards_is_the_same_drive() -> None:
    rng = np.random.default_rng(3)
    found, _ = row_seen_twice(0.0)
    turned = replace(found.increments, turn=rng.normal(size=3))
    found = replace(found, increments=turned)
    twice = found.reversed().reversed()
    for a, b in ((found.increments, twice.increments), (found.seen, twice.seen)):
        for name in vars(a):
            np.testing.assert_allclose(getattr(a, name), getattr(b, name), atol=1e-12)
    # out along one step, back along its reverse
    step, back = found.increments, found.reversed().increments
    c, s = np.cos(step.turn[2]), np.sin(step.turn[2])
    there = step.displacement_b[2] + np.array([[c, -s], [s, c]]) @ back.displacement_b[0]
    np.testing.assert_allclose(there, 0.0, atol=1e-12)


def _relabelled(landmark: IntArray) -> IntArray:
    """Numbered in the order of discovery."""
    _, first, of = np.unique(landmark, return_index=True, return_inverse=True)
    return np.asarray(np.argsort(np.argsort(first))[of])
