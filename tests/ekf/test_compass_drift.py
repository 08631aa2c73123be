"""What is stated of a compass's drift against many drawn ones."""

from __future__ import annotations

import numpy as np
import pytest

from gtsam_nav.ekf.compass_drift import CompassDrift
from gtsam_nav.frames import Array
from gtsam_nav.simulation.processes import gauss_markov

DRIFT = CompassDrift(sigma=0.05, time_s=60.0)
STEP_S, ELAPSED_S = 0.25, 30.0
STEPS = round(ELAPSED_S / STEP_S)


@pytest.fixture(scope="module")
def drawn() -> Array:
    """Many drifts over the while, shape (runs, n)."""
    rng = np.random.default_rng(0)
    return gauss_markov(rng, STEPS + 1, STEP_S, DRIFT.sigma, DRIFT.time_s, 6000).T


def mean_and_end(drawn: Array) -> Array:
    middle = 0.5 * (drawn[:, 1:] + drawn[:, :-1])
    return np.column_stack([middle.mean(axis=1), drawn[:, -1]])


def test_mean_and_end_are_those_of_drawn_drifts(drawn: Array) -> None:
    elapsed_s, found = np.array(ELAPSED_S), mean_and_end(drawn)
    begun = drawn[:, :1]
    for stated, seen in (
        (DRIFT.whole(elapsed_s), found),
        (DRIFT.change(elapsed_s), found - begun),
        (DRIFT.gained(elapsed_s), found - begun * DRIFT.kept(elapsed_s)),
    ):
        np.testing.assert_allclose(stated, np.cov(seen.T), rtol=0.06, atol=1e-5)


def test_what_is_kept_tells_nothing_of_what_is_gained(drawn: Array) -> None:
    gained = mean_and_end(drawn) - drawn[:, :1] * DRIFT.kept(np.array(ELAPSED_S))
    shared = gained.T @ drawn[:, 0] / len(drawn)
    np.testing.assert_allclose(shared, 0.0, atol=0.03 * DRIFT.sigma**2)


def test_the_middle_differs_from_the_mean_as_drawn(drawn: Array) -> None:
    seen = np.var(drawn[:, STEPS // 2] - mean_and_end(drawn)[:, 0])
    assert DRIFT.middle_variance(ELAPSED_S) == pytest.approx(seen, rel=0.08)


def test_the_mean_over_a_span_is_as_far_off_as_drawn(drawn: Array) -> None:
    seen = np.var(mean_and_end(drawn)[:, 0])
    assert DRIFT.mean_variance(ELAPSED_S) == pytest.approx(seen, rel=0.06)
    assert DRIFT.mean_variance(0.0) == pytest.approx(DRIFT.sigma**2, rel=1e-3)


def test_times_may_come_in_any_shape_and_none_may_pass() -> None:
    many = np.array([[0.0, 1e-9, 1.0], [10.0, 100.0, 1e5]])
    assert DRIFT.change(many).shape == (2, 3, 2, 2)
    for stated in (DRIFT.change(many), DRIFT.gained(many), DRIFT.whole(many)):
        assert np.linalg.eigvalsh(stated).min() >= 0.0
    np.testing.assert_allclose(DRIFT.change(many)[0, 0], 0.0, atol=1e-6)
    np.testing.assert_allclose(DRIFT.whole(many)[1, 2, 1, 1], DRIFT.sigma**2)
    assert DRIFT.middle_variance(0.0) == 0.0
