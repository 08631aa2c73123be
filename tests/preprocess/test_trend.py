"""The compiled smoother against dense least squares over all states at once."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gtsam_nav.frames import Array
from gtsam_nav.preprocess._trend import smooth_trend
from gtsam_nav.series import BoolArray

N = 30


def dense(
    t: Array,
    z: Array,
    variance: Array,
    level_density: float,
    trend_density: float,
    trend_variance: float,
    used: BoolArray,
) -> tuple[Array, Array, Array]:
    """Levels, trends and variances of the levels: unknowns l_0, b_0, l_1, b_1, ..."""
    n = len(t)
    information, right = np.zeros((2 * n, 2 * n)), np.zeros(2 * n)
    information[1, 1] = 1 / trend_variance
    for k in np.flatnonzero(used):
        information[2 * k, 2 * k] += 1 / variance[k]
        right[2 * k] += z[k] / variance[k]
    for k, dt in enumerate(np.diff(t)):
        A = np.array([[-1, -dt, 1, 0], [0, -1, 0, 1]])
        Q = trend_density * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
        Q[0, 0] += level_density * dt
        own = slice(2 * k, 2 * k + 4)
        information[own, own] += A.T @ np.linalg.inv(Q) @ A
    cov = np.linalg.inv(information)
    mean = cov @ right
    return mean[0::2], mean[1::2], np.diag(cov)[0::2]


def dense_walk(t: Array, z: Array, variance: Array, density: float) -> tuple[Array, Array]:
    """Levels of a plain random walk, and their variances."""
    D = np.diff(np.eye(len(t)), axis=0)
    information = np.diag(1 / variance) + D.T @ np.diag(1 / (density * np.diff(t))) @ D
    cov = np.linalg.inv(information)
    return cov @ (z / variance), np.diag(cov)


def readings(seed: int) -> tuple[Array, Array, Array]:
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(0.05, 2.0, N))
    return t, np.cumsum(rng.normal(size=N)), rng.uniform(0.05, 1.0, N)


@given(
    st.integers(0, 2**32 - 1),
    *[st.floats(-2, 1).map(lambda e: float(10**e))] * 3,
)
def test_it_is_the_least_squares_solution(
    seed: int, level_density: float, trend_density: float, trend_variance: float
) -> None:
    t, z, variance = readings(seed)
    densities = (level_density, trend_density, trend_variance)
    level, trend, level_variance, used = smooth_trend(t, z, variance, *densities, np.inf)
    assert used.all()
    expected = dense(t, z, variance, *densities, used)
    for found, wanted in zip((level, trend, level_variance), expected, strict=True):
        np.testing.assert_allclose(found, wanted, rtol=1e-6, atol=1e-8)


@given(st.integers(0, 2**32 - 1), st.floats(-3, 1).map(lambda e: float(10**e)))
def test_without_a_trend_it_smooths_a_random_walk(seed: int, density: float) -> None:
    t, z, variance = readings(seed)
    level, trend, level_variance, _ = smooth_trend(t, z, variance, density, 0.0, 0.0, np.inf)
    expected, expected_variance = dense_walk(t, z, variance, density)
    np.testing.assert_allclose(level, expected, atol=1e-9)
    np.testing.assert_allclose(level_variance, expected_variance, rtol=1e-9)
    np.testing.assert_array_equal(trend, 0.0)


def test_a_spike_is_left_out() -> None:
    t, z, variance = np.arange(float(N)), np.zeros(N), np.full(N, 0.01)
    z[[7, 20]] = 5.0, -3.0
    level, trend, level_variance, used = smooth_trend(t, z, variance, 1e-3, 1e-3, 0.1, 16.0)
    np.testing.assert_array_equal(np.flatnonzero(~used), [7, 20])
    expected = dense(t, z, variance, 1e-3, 1e-3, 0.1, used)
    for found, wanted in zip((level, trend, level_variance), expected, strict=True):
        np.testing.assert_allclose(found, wanted, atol=1e-9)
    assert np.abs(level).max() < 1e-9


def test_a_level_that_rises_steadily_is_met_exactly() -> None:
    t = np.cumsum(np.random.default_rng(0).uniform(0.1, 1.0, N))
    level, trend, _, _ = smooth_trend(t, 3 - 0.5 * t, np.full(N, 0.1), 0.0, 1e-6, 1e6, np.inf)
    np.testing.assert_allclose(level, 3 - 0.5 * t, atol=1e-5)
    np.testing.assert_allclose(trend, -0.5, atol=1e-5)


@pytest.mark.parametrize("n", [1, 2])
def test_few_readings(n: int) -> None:
    t, z, variance = np.arange(float(n)), np.ones(n), np.ones(n)
    level, trend, level_variance, used = smooth_trend(t, z, variance, 0.1, 0.1, 0.1, np.inf)
    np.testing.assert_allclose(level, 1.0)
    np.testing.assert_allclose(trend, 0.0, atol=1e-15)
    assert level_variance[0] <= 1.0
    assert used.all()
