"""Jumps of fixes that the vehicle did not make."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gtsam_nav.frames import Array
from gtsam_nav.preprocess.antenna_path import AntennaPath
from gtsam_nav.preprocess.fix_steps import shared_offsets, with_fix_steps
from gtsam_nav.series import GnssSeries
from gtsam_nav.simulation import simulate

FLOAT_N = np.array([1.2, -0.9, 0.8])
PER_AXIS_M = 1.5 / np.sqrt(2)


def boat(seed: int, sigma: float = 0.02, rate_hz: float = 1.0) -> tuple[GnssSeries, AntennaPath]:
    """On circles of 25 m at 2.5 m/s for three minutes, beside a motion in a current."""
    t = 3.0 + np.arange(0.0, 180.0, 1 / rate_hz)
    p_n = 25.0 * np.column_stack([np.sin(t / 10), 1 - np.cos(t / 10), 0 * t])
    v = 2.5 * np.column_stack([np.cos(t / 10), np.sin(t / 10)])
    rng = np.random.default_rng(seed)
    walk = np.cumsum(0.02 / np.sqrt(rate_hz) * rng.normal(size=(len(t), 2)), axis=0)
    path = AntennaPath(p_n[:, :2] + walk + np.outer(t, [0.3, -0.2]), v, 0.02**2 * (t - t[0]))
    noisy = p_n + sigma * rng.normal(size=p_n.shape)
    return GnssSeries(t=t, p_n=noisy, sigma=np.full(p_n.shape, sigma)), path


def moved(fixes: GnssSeries, which: slice | Array, off_n: Array = FLOAT_N) -> GnssSeries:
    p_n = fixes.p_n.copy()
    p_n[which] += off_n
    return replace(fixes, p_n=p_n)


@pytest.mark.parametrize("rate_hz", [1.0, 10.0])
def test_the_fewer_fixes_beside_a_jump_share_an_error(rate_hz: float) -> None:
    fixes, path = boat(0, rate_hz=rate_hz)
    n = int(60 * rate_hz)
    offset, said = shared_offsets(moved(fixes, slice(0, n)), path, "gnss")
    assert np.all(offset[n:] == 0.0)
    assert offset[:n] == pytest.approx(np.full(n, PER_AXIS_M), abs=0.1)
    assert len(said) == 1
    assert f"until {fixes.t[n - 1]:.1f} s lie 1." in said[0]


def test_those_with_larger_sigmas_do_however_many() -> None:
    fixes, path = boat(1)
    sigma = fixes.sigma.copy()
    sigma[:120] = 0.05
    offset, said = shared_offsets(moved(replace(fixes, sigma=sigma), slice(0, 120)), path, "gnss")
    assert np.all(offset[120:] == 0.0)
    assert np.all(offset[:120] > 0.9)
    assert "until" in said[0]


def test_a_solution_that_is_lost_and_comes_back_is_right_again() -> None:
    fixes, path = boat(2)
    lost = moved(moved(fixes, slice(50, 80)), slice(110, 140), -FLOAT_N)
    offset, said = shared_offsets(lost, path, "gnss")
    doubted = np.zeros(len(fixes), dtype=bool)
    doubted[50:80] = doubted[110:140] = True
    np.testing.assert_array_equal(offset > 0.0, doubted)
    assert len(said) == 2
    # two losses are two errors
    assert len(np.unique(offset)) == 3


def test_many_losses_are_told_of_at_once() -> None:
    fixes, path = boat(2, rate_hz=5.0)
    for first in range(100, 800, 125):
        fixes = moved(fixes, slice(first, first + 60))
    offset, said = shared_offsets(fixes, path, "gnss")
    assert np.count_nonzero(offset) == 6 * 60
    assert len(said) == 4
    assert said[-1] == "so do those of 3 further stretches of 'gnss'"


@pytest.mark.parametrize("seed", range(20))
def test_good_fixes_have_no_jump(seed: int) -> None:
    for sigma, rate_hz in ((0.02, 1.0), (0.02, 5.0), (1.5, 1.0)):
        fixes, path = boat(seed, sigma, rate_hz)
        assert shared_offsets(fixes, path, "gnss")[1] == ()


def test_outliers_that_come_back_are_none() -> None:
    fixes, path = boat(3)
    burst = moved(moved(fixes, slice(50, 55), 20.0 * FLOAT_N), slice(100, 101))
    assert shared_offsets(burst, path, "gnss")[1] == ()


def test_neither_is_a_fast_turn_of_fixes_that_come_late() -> None:
    """Full ahead and astern at 2 m/s^2, with fixes 0.3 s late."""
    t = np.arange(0.0, 120.0, 0.25)
    v = np.clip(2.0 * (t - 30.0), 0.0, 8.0) - np.clip(2.0 * (t - 80.0), 0.0, 8.0)
    north = np.cumsum(v) * 0.25
    path = AntennaPath(
        np.column_stack([north, 0 * t]), np.column_stack([v, 0 * t]), np.zeros(len(t))
    )
    p_n = np.column_stack([np.interp(t - 0.3, t, north), 0 * t, 0 * t])
    p_n += 0.01 * np.random.default_rng(0).normal(size=p_n.shape)
    fixes = GnssSeries(t=t, p_n=p_n, sigma=np.full(p_n.shape, 0.01))
    assert shared_offsets(fixes, path, "gnss")[1] == ()


def test_neither_is_what_happens_while_the_receiver_is_silent() -> None:
    fixes, path = boat(4)
    seen = (fixes.t < 60.0) | (fixes.t > 90.0)
    after = moved(fixes.select(seen), slice(58, None))
    path = AntennaPath(path.p[seen], path.v[seen], path.variance[seen])
    assert shared_offsets(after, path, "gnss")[1] == ()


def test_a_mission_keeps_its_fixes_and_says_so() -> None:
    mission = simulate("laps", seed=1, duration_s=90.0)
    gnss = mission.first("gnss")
    assert gnss is not None
    series = gnss.series
    assert isinstance(series, GnssSeries)
    assert with_fix_steps(mission) == mission
    jumping = moved(series, slice(0, 30), 20.0 * FLOAT_N)
    mission = mission.with_sensor(replace(gnss, series=jumping))
    found = with_fix_steps(mission)
    doubted = found.first("gnss")
    assert doubted is not None
    assert isinstance(doubted.series, GnssSeries)
    assert doubted.series.offset_sigma is not None
    np.testing.assert_array_equal(np.flatnonzero(doubted.series.offset_sigma), np.arange(30))
    np.testing.assert_allclose(
        doubted.series.sigma**2,
        series.sigma**2 + doubted.series.offset_sigma[:, None] ** 2,
    )
    assert len(found.warnings) == len(mission.warnings) + 1


def test_a_wheel_that_slips_is_no_jump_of_the_fixes() -> None:
    """Only the receiver's own velocities are a witness against its fixes."""
    mission = simulate("marina", seed=1, duration_s=90.0)
    gnss = mission.first("gnss")
    assert gnss is not None
    assert isinstance(gnss.series, GnssSeries)
    jumping = moved(replace(gnss.series, v_n=None), slice(0, 30), 20.0 * FLOAT_N)
    mission = mission.with_sensor(replace(gnss, series=jumping))
    assert with_fix_steps(mission) is mission
