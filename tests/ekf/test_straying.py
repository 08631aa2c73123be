"""How far a walk strays while scans are taken, against drawn walks."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from gtsam_nav.ekf.straying import straying
from gtsam_nav.frames import Array

STEP_S, SCAN_S = 0.1, 4.0


def even(t: Array) -> Array:
    return 0.01 * t


def jumping(t: Array) -> Array:
    """As where the bottom was lost for a moment, in the middle of the second scan."""
    return 0.01 * t + 0.5 * np.clip(t - 7.0, 0.0, 0.5)


@pytest.mark.parametrize("covered", [1.0, 0.5])
@pytest.mark.parametrize("growth", [even, jumping])
def test_means_and_ends_of_a_walk(growth: Callable[[Array], Array], covered: float) -> None:
    t = STEP_S * np.arange(101)
    beams_s = np.array([[1.0, 1.0 + covered * SCAN_S], [5.0, 5.0 + covered * SCAN_S]])
    variance = growth(t)
    steps = np.random.default_rng(4).normal(size=(20000, 100)) * np.sqrt(np.diff(variance))
    walks = np.concatenate([np.zeros((len(steps), 1)), np.cumsum(steps, axis=1)], axis=1)
    spans = [(t >= begin - 1e-9) & (t <= end + 1e-9) for begin, end in beams_s]
    end = [walks[:, np.flatnonzero(span)[-1]] for span in spans]
    mean = walks[:, spans[1]].mean(axis=1)
    drawn = np.cov([end[1] - mean, mean - end[0]])
    stated = straying(t, variance, beams_s, np.zeros((2, 2, 2)))[1]
    np.testing.assert_allclose(stated[::2, ::2], drawn, atol=0.04 * drawn.trace())
    np.testing.assert_array_equal(stated[1::2, 1::2], stated[::2, ::2])
    assert not np.any(stated[::2, 1::2])


def test_a_scan_that_is_taken_at_once_has_its_pose_at_its_end() -> None:
    t = STEP_S * np.arange(101)
    stated = straying(t, even(t), np.array([[2.0, 2.0], [5.0, 5.0]]), np.zeros((2, 2, 2)))
    np.testing.assert_allclose(stated[1], np.diag([0.0, 0.0, 0.03, 0.03]), atol=1e-9)
    assert not np.any(stated[0, :2, :2])
