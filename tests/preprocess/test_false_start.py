"""Fixes with which a receiver begins at a false place."""

from __future__ import annotations

import numpy as np
import pytest

from gtsam_nav.frames import Array
from gtsam_nav.preprocess.false_start import false_start
from gtsam_nav.series import GnssSeries

OFF_N = np.array([35.0, -35.0, 3.0])


def fixes(
    seed: int = 0, sigma: float = 1.0, rate_hz: float = 1.0, duration_s: float = 150.0
) -> GnssSeries:
    """A boat on circles of 25 m at 2.5 m/s."""
    t = 3.0 + np.arange(0.0, duration_s, 1 / rate_hz)
    p_n = 25.0 * np.column_stack([np.sin(t / 10), 1 - np.cos(t / 10), 0 * t])
    p_n += sigma * np.random.default_rng(seed).normal(size=p_n.shape)
    return GnssSeries(t=t, p_n=p_n, sigma=np.full(p_n.shape, sigma))


def moved(series: GnssSeries, which: slice, off_n: Array = OFF_N) -> GnssSeries:
    p_n = series.p_n.copy()
    p_n[which] += off_n
    return GnssSeries(t=series.t, p_n=p_n, sigma=series.sigma)


@pytest.mark.parametrize("n", [1, 2, 5, 12, 40])
@pytest.mark.parametrize("sigma", [0.24, 1.2])
def test_what_a_jump_parts_from_most_fixes_is_no_start(n: int, sigma: float) -> None:
    first, off_m = false_start(moved(fixes(sigma=sigma), slice(0, n)))
    assert first == n
    assert abs(off_m - np.hypot(*OFF_N[:2])) < 10.0


def test_at_a_high_rate_too() -> None:
    first, _ = false_start(moved(fixes(rate_hz=5.0), slice(0, 35)))
    assert 35 <= first <= 37


@pytest.mark.parametrize("seed", range(20))
def test_good_fixes_make_none(seed: int) -> None:
    assert false_start(fixes(seed)) == (0, 0.0)


def test_later_outliers_make_none() -> None:
    burst = moved(moved(fixes(), slice(8, 20)), slice(50, 51), -OFF_N)
    assert false_start(burst) == (0, 0.0)


def test_neither_does_a_gap_in_the_fixes_nor_a_vehicle_that_starts_fast() -> None:
    series = fixes()
    assert false_start(series.select((series.t < 8.0) | (series.t > 40.0))) == (0, 0.0)
    t = series.t - series.t[0]
    along = np.column_stack([np.where(t < 10, 0.0, 25.0 * (t - 10.0)), 0 * t, 0 * t])
    fast = GnssSeries(t=series.t, p_n=series.p_n + along, sigma=series.sigma)
    assert false_start(fast) == (0, 0.0)


def test_outliers_among_the_good_ones_do_not_hide_it() -> None:
    spoiled = moved(moved(fixes(), slice(0, 5)), slice(40, 41), -OFF_N)
    assert false_start(moved(spoiled, slice(70, 72), 2.0 * OFF_N))[0] == 5
    still = fixes(sigma=0.2)
    slow = GnssSeries(t=still.t, p_n=0.2 * still.p_n, sigma=0.2 * still.sigma)
    assert false_start(moved(moved(slow, slice(0, 20)), slice(31, 32), -OFF_N))[0] == 20


def test_few_fixes_tell_nothing() -> None:
    assert false_start(moved(fixes(duration_s=5.0), slice(0, 2))) == (0, 0.0)


@pytest.mark.parametrize("rate_hz", [1.0, 5.0])
@pytest.mark.parametrize("acceleration_m_s2", [2.0, -2.0, 5.0])
def test_neither_does_a_hard_start_or_stop(rate_hz: float, acceleration_m_s2: float) -> None:
    t = np.arange(0.0, 130.0, 1 / rate_hz)
    speed_m_s = np.clip(acceleration_m_s2 * (t - 40.0), -12.0, 12.0) * (t > 40.0)
    north = np.cumsum(speed_m_s - min(0.0, 12.0 * np.sign(acceleration_m_s2))) / rate_hz
    p_n = np.column_stack([north, 0 * t, 0 * t])
    p_n += 0.02 * np.random.default_rng(0).normal(size=p_n.shape)
    assert false_start(GnssSeries(t=t, p_n=p_n, sigma=np.full(p_n.shape, 0.02))) == (0, 0.0)


def test_neither_does_a_dive() -> None:
    """At rest, out of the receiver's sight for 40 s at 3 m/s, and at rest again."""
    t = np.r_[0:20, 60:125].astype(float)
    p_n = np.column_stack([3.0 * np.clip(t - 20.0, 0.0, 40.0), 0 * t, 0 * t])
    p_n += 0.3 * np.random.default_rng(0).normal(size=p_n.shape)
    assert false_start(GnssSeries(t=t, p_n=p_n, sigma=np.full(p_n.shape, 0.3))) == (0, 0.0)
