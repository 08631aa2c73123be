"""The smoother that gross errors do not move."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gtsam_nav.frames import Array
from gtsam_nav.preprocess.robust_trend import robust_trend

T = np.arange(0.0, 100.0, 1.0)
TRUTH = np.column_stack([20 * np.sin(T / 15), 0.02 * T**2 - T])


def smoothed(z: Array, sigma: float) -> tuple[Array, Array]:
    return robust_trend(T, z, np.full_like(z, sigma), 0.0, 0.3**2, 10.0**2)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=20)
def test_outliers_alone_and_in_bursts_do_no_harm(seed: int) -> None:
    rng = np.random.default_rng(seed)
    z = TRUTH + rng.normal(size=TRUTH.shape)
    clean, _ = smoothed(z, 1.0)
    hit = np.zeros(len(T), dtype=bool)
    hit[[0, 1, 30, 60, 61, 62, 63, 99]] = True
    jump = np.zeros_like(z)
    jump[hit] = [60.0, -40.0]
    level, _ = smoothed(z + jump, 1.0)
    assert np.max(np.abs(level - clean)[3:-2]) < 2.5
    assert np.sqrt(np.mean((level - TRUTH) ** 2)) < 1.5


def test_fixes_more_exact_than_the_model_are_judged_by_their_neighbours() -> None:
    """A flexible trend passes through any single reading: its own residual shows nothing."""
    z = TRUTH.copy()
    z[50] += [30.0, 0.0]
    level, _ = smoothed(z, 0.01)
    assert np.abs(level[50, 0] - TRUTH[50, 0]) < 1.0


def test_the_trend_is_the_rate_of_the_level() -> None:
    rng = np.random.default_rng(1)
    level, trend = smoothed(TRUTH + 0.1 * rng.normal(size=TRUTH.shape), 0.1)
    np.testing.assert_allclose(trend[5:-5], np.gradient(TRUTH, T, axis=0)[5:-5], atol=0.3)
    assert np.sqrt(np.mean((level - TRUTH) ** 2)) == pytest.approx(0.1, abs=0.05)
