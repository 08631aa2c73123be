"""Closures judged by each other: true ones and false ones along a path of known uncertainty."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from gtsam_nav.frames import Array
from gtsam_nav.graph.loop_consistency import (
    LoopEvidence,
    consistent_pairs,
    graduated_inliers,
    largest_consistent_set,
    normalised_squares,
)
from gtsam_nav.series import BoolArray

SIGMA = np.array([0.1, 0.1, 0.01])
Judge = Callable[[LoopEvidence, float], BoolArray]
judges = pytest.mark.parametrize("judge", [largest_consistent_set, graduated_inliers])


def evidence(n: int, seed: int, spread: float = 100.0) -> tuple[LoopEvidence, Array]:
    """Closures whose predictions share a drift of many sigmas and walk a little besides.

    Alone none can be told from a false one; but true ones are off by nearly the same.
    """
    rng = np.random.default_rng(seed)
    drift = spread * SIGMA
    walk = 0.5 * SIGMA
    steps = np.arange(n)
    shared = np.ones((n, n)) - 0.0
    walked = np.minimum.outer(steps, steps).astype(float)
    cov = np.zeros((n, 3, n, 3))
    for axis in range(3):
        cov[:, axis, :, axis] = drift[axis] ** 2 * shared + walk[axis] ** 2 * walked
    off = rng.multivariate_normal(np.zeros(3 * n), cov.reshape(3 * n, 3 * n)).reshape(n, 3)
    residual = off + SIGMA * rng.normal(size=(n, 3))
    return LoopEvidence(residual, cov, np.tile(np.diag(SIGMA**2), (n, 1, 1))), drift


def spoilt(clean: LoopEvidence, false: Array, by: Array) -> LoopEvidence:
    residual = clean.residual.copy()
    residual[false] += by
    return LoopEvidence(residual, clean.cov_predicted, clean.cov)


@judges
def test_true_closures_are_believed(judge: Judge) -> None:
    clean, _ = evidence(60, seed=1)
    assert np.mean(judge(clean, 0.9999)) > 0.97


@judges
def test_random_false_ones_are_found_among_as_many_true(judge: Judge) -> None:
    clean, drift = evidence(80, seed=2)
    false = np.random.default_rng(3).permutation(80)[:40]
    by = np.random.default_rng(4).uniform(-1.0, 1.0, size=(40, 3)) * drift
    faulty = spoilt(clean, false, by)
    # alone most of them pass
    assert np.mean(normalised_squares(faulty)[false] < 11.3) > 0.8
    believed = judge(faulty, 0.9999)
    wrong = np.isin(np.arange(80), false)
    assert np.sum(believed & wrong) <= 1  # by chance one may agree
    assert np.mean(believed[~wrong]) > 0.95


@judges
def test_a_group_that_agrees_with_itself_is_outnumbered(judge: Judge) -> None:
    clean, drift = evidence(50, seed=5)
    false = np.arange(20, 30)
    faulty = spoilt(clean, false, np.array([0.4, -0.3, 0.2]) * drift)
    alone = largest_consistent_set(faulty.select(false), 0.9999)
    assert np.all(alone)
    believed = judge(faulty, 0.9999)
    assert not np.any(believed[false])
    assert np.sum(believed) >= 38


def test_pairs_are_symmetric_and_closures_alone_stand_on_the_diagonal() -> None:
    clean, drift = evidence(12, seed=6)
    faulty = spoilt(clean, np.array([4]), 50 * drift)
    passes = consistent_pairs(faulty, 0.999)
    np.testing.assert_array_equal(passes, passes.T)
    assert not np.any(passes[4])
    S = faulty.cov_predicted[7, :, 7] + faulty.cov[7]
    e = faulty.residual[7]
    assert normalised_squares(faulty)[7] == pytest.approx(e @ np.linalg.solve(S, e))


def test_a_closure_is_also_measured_by_those_that_are_believed() -> None:
    """Alone it passes; beside eleven that share its drift it is off by what it was moved."""
    clean, drift = evidence(12, seed=8)
    faulty = spoilt(clean, np.array([5]), 0.3 * drift)
    believed = np.arange(12) != 5
    alone, among = (normalised_squares(faulty, known)[5] for known in (None, believed))
    assert alone < 11.3
    assert among > 100.0
    assert normalised_squares(clean, believed)[5] < 16.3


@judges
def test_a_single_closure_is_judged_by_the_other_sensors(judge: Judge) -> None:
    clean, drift = evidence(1, seed=7, spread=1.0)
    assert judge(clean, 0.999).all()
    assert not judge(spoilt(clean, np.array([0]), 100 * drift), 0.999).any()
