"""Gain and lag of two signals that see the same motion."""

from __future__ import annotations

import numpy as np
import pytest

from gtsam_nav.audit.agreement import agreement
from gtsam_nav.audit.lagged_products import Signal, integrated
from gtsam_nav.frames import Array

FINE_T = np.arange(0.0, 300.0, 0.02)
RNG = np.random.default_rng(8)
MOTION = np.cumsum(np.convolve(RNG.normal(size=len(FINE_T)), np.ones(50) / 50, "same")) * 0.02


def seen(rate_hz: float, late_s: float = 0.0, gain: float = 1.0, noise: float = 0.01) -> Signal:
    """The motion by a sensor that stamps its samples late."""
    t = np.arange(0.3, 299.0, 1 / rate_hz)
    values = gain * np.interp(t, FINE_T, MOTION) + np.random.default_rng(1).normal(0, noise, len(t))
    return Signal(t + late_s, values)


@pytest.mark.parametrize("late_s", [0.0, 0.37, -1.2])
@pytest.mark.parametrize("gain", [1.0, -57.3])
def test_gain_and_lag_are_found(late_s: float, gain: float) -> None:
    found = agreement(seen(5.0, late_s, gain, noise=0.01 * abs(gain)), Signal(FINE_T, MOTION))
    assert found is not None
    assert found.gain == pytest.approx(gain, abs=5 * found.gain_sigma + 0.05 * abs(gain))
    assert found.lag_s == pytest.approx(-late_s, abs=5 * found.lag_sigma_s)
    assert found.lag_sigma_s < 0.1


@pytest.mark.parametrize("late_s", [8.0, -18.0, 30.0])
def test_clocks_that_are_far_apart_are_found(late_s: float) -> None:
    found = agreement(seen(5.0, late_s), seen(50.0))
    assert found is not None
    assert found.gain == pytest.approx(1.0, abs=0.05)
    assert found.lag_s == pytest.approx(-late_s, abs=5 * found.lag_sigma_s)
    assert found.lag_sigma_s < 0.1


def test_a_lag_beyond_the_farthest_is_not_taken_for_a_short_one() -> None:
    found = agreement(seen(5.0, 60.0), seen(50.0))
    assert found is None or abs(found.lag_s) > 5.0


def test_drift_of_either_does_not_matter() -> None:
    y, x = seen(5.0, 0.4), seen(10.0)
    drifting = Signal(y.t, y.values + 0.05 * y.t + 20.0)
    found, plain = agreement(drifting, x), agreement(y, x)
    assert found is not None
    assert plain is not None
    assert found.lag_s == pytest.approx(plain.lag_s, abs=1e-6)


def test_signals_that_have_nothing_in_common_say_nothing() -> None:
    noise = Signal(FINE_T[::10], np.random.default_rng(5).normal(size=len(FINE_T[::10])))
    assert agreement(noise, Signal(FINE_T, MOTION)) is None
    still = Signal(FINE_T[::10], np.zeros(len(FINE_T[::10])))
    assert agreement(still, Signal(FINE_T, MOTION)) is None


def test_too_little_overlap_says_nothing() -> None:
    short = seen(5.0)
    assert agreement(Signal(short.t[:100], short.values[:100]), seen(10.0)) is None
    assert agreement(Signal(short.t[:1], short.values[:1]), seen(10.0)) is None


def swell(t: Array) -> Array:
    """One wave, and no end of it."""
    return np.asarray(np.sin(2 * np.pi * t / 4.0))


@pytest.mark.parametrize("seed", range(5))
def test_a_steady_wave_never_passes_for_a_lag_of_its_period(seed: int) -> None:
    t = np.arange(0.0, 300.0, 0.2)
    noisy = swell(t) + np.random.default_rng(seed).normal(0, 0.3, len(t))
    found = agreement(Signal(t, noisy), Signal(FINE_T, swell(FINE_T)))
    assert found is None or (found.gain > 0 and abs(found.lag_s) < 0.1)


@pytest.mark.parametrize("seed", [4, 5])
def test_a_group_of_waves_is_not_taken_for_the_one_before(seed: int) -> None:
    heave = np.convolve(np.random.default_rng(seed).normal(size=len(FINE_T)), swell(FINE_T[:1000]))
    heave = heave[: len(FINE_T)] / np.std(heave)
    t = np.arange(0.0, 299.0, 0.2)
    found = agreement(Signal(t + 8.0, np.interp(t, FINE_T, heave)), Signal(FINE_T, heave))
    assert found is None or found.lag_s == pytest.approx(-8.0, abs=0.1)


def waves(t: Array, seed: int) -> Array:
    """A narrow sea, that nearly repeats itself after some tens of seconds."""
    rng = np.random.default_rng(seed)
    periods_s, phases = rng.uniform(3.6, 4.6, 4), rng.uniform(0.0, 2 * np.pi, 4)
    return np.asarray(np.sin(2 * np.pi * t[:, None] / periods_s + phases).sum(axis=1))


def heave(seed: int, late_s: float, gain: float, until_s: float) -> tuple[Signal, Signal]:
    """The sea by a noisy sensor that falls silent at times, and by a fine one."""
    t = np.arange(0.0, until_s, 0.2)
    t = t[(t % 60.0 < 50.0) | (t % 60.0 > 54.0)]
    noisy = gain * waves(t, seed) + np.random.default_rng(seed).normal(0.0, 0.8, len(t))
    fine_t = np.arange(0.0, until_s, 0.05)
    return Signal(t + late_s, noisy), Signal(fine_t, waves(fine_t, seed))


@pytest.mark.parametrize("late_s", [6.0, -8.0, 12.0, 18.0])
@pytest.mark.parametrize("seed", range(6))
def test_waves_never_give_a_wrong_lag_or_sign(late_s: float, seed: int) -> None:
    found = agreement(*heave(seed, late_s, 1.0, 200.0))
    if found is not None:
        assert found.gain > 0
        assert found.lag_s == pytest.approx(-late_s, abs=0.1)


@pytest.mark.parametrize(("late_s", "gain"), [(0.0, 1.0), (0.0, -1.0), (1.0, 1.0)])
@pytest.mark.parametrize("seed", range(2))
def test_waves_of_a_long_record_tell_sign_and_clock(late_s: float, gain: float, seed: int) -> None:
    found = agreement(*heave(seed, late_s, gain, 600.0))
    assert found is not None
    assert found.gain == pytest.approx(gain, abs=0.1)
    assert found.lag_s == pytest.approx(-late_s, abs=0.1)


def test_a_clock_far_off_is_found_in_spite_of_silences() -> None:
    y = seen(5.0, 18.0)
    there = (y.t % 60.0 < 50.0) | (y.t % 60.0 > 54.0)
    x, lacking = seen(10.0), Signal(y.t[there], y.values[there])
    for pair, lag_s in (((lacking, x), -18.0), ((x, lacking), 18.0)):
        found = agreement(*pair)
        assert found is not None
        assert found.lag_s == pytest.approx(lag_s, abs=0.1)


def test_a_silence_is_not_compared() -> None:
    y = seen(5.0)
    there = (y.t < 100.0) | (y.t > 150.0)
    found = agreement(Signal(y.t[there], y.values[there]), seen(10.0))
    assert found is not None
    assert found.gain == pytest.approx(1.0, abs=0.1)


def test_the_integral_is_by_the_trapezoidal_rule() -> None:
    found = integrated(np.array([0.0, 1.0, 3.0]), np.array([0.0, 2.0, 0.0]))
    assert found.values.tolist() == [0.0, 1.0, 3.0]


@pytest.mark.parametrize("seed", range(12))
def test_noise_on_slow_motion_is_no_lag(seed: int) -> None:
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 400.0, 0.2)
    rate, noise = 0.03 * np.cos(t / 30.0), rng.normal(size=len(t))
    compass = Signal(t[::2], (0.9 * np.sin(t / 30.0) + 0.017 * noise)[::2])
    found = agreement(compass, integrated(t, rate + 0.01 * rng.normal(size=len(t))))
    assert found is None or found.is_no_fault
