"""The gate: single outliers and bursts stay out, a filter that is lost gets back in."""

from __future__ import annotations

import numpy as np
import pytest

from gtsam_nav.ekf.error_state import Update
from gtsam_nav.ekf.gate import RUN_MEASUREMENTS, RUN_S, Gate, Verdict
from gtsam_nav.frames import Array

SIGMA = 2.0


def update(residual: Array) -> Update:
    R = SIGMA**2 * np.eye(len(residual))
    S_inverse = np.linalg.inv(2 * R)
    return Update(
        residual, np.eye(len(residual)), R, S_inverse, float(residual @ S_inverse @ residual)
    )


def judged(residuals: Array, step_s: float = 1.0, gate: Gate | None = None) -> list[Verdict]:
    gate = gate or Gate(0.999)
    return [gate.judge(k * step_s, update(r)) for k, r in enumerate(residuals)]


def test_noise_passes_and_outliers_do_not() -> None:
    rng = np.random.default_rng(0)
    residuals = rng.normal(scale=SIGMA, size=(200, 2))
    residuals[50] = [40.0, 0.0]
    verdicts = judged(residuals)
    assert verdicts[50] == "reject"
    assert verdicts.count("accept") == 199


@pytest.mark.parametrize("length", [5, 10, 40])
def test_a_burst_that_disagrees_with_itself_stays_out(length: int) -> None:
    rng = np.random.default_rng(length)
    size, angle = rng.uniform(20, 100, length), rng.uniform(0, 2 * np.pi, length)
    burst = size[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    good = rng.normal(scale=SIGMA, size=(20, 2))
    verdicts = judged(np.concatenate([good, burst, good]))
    assert verdicts == ["accept"] * 20 + ["reject"] * length + ["accept"] * 20


def test_five_that_agree_are_not_enough() -> None:
    verdicts = judged(np.tile([30.0, 40.0], (5, 1)))
    assert verdicts == ["reject"] * 5


@pytest.mark.parametrize("step_s", [0.25, 1.0])
def test_a_long_run_that_agrees_opens_it_again(step_s: float) -> None:
    rng = np.random.default_rng(1)
    k = np.arange(60)
    lost = np.column_stack([30 + 0.8 * k * step_s, -20 + 0.02 * (k * step_s) ** 2])
    gate = Gate(0.999)
    residuals = lost + rng.normal(scale=SIGMA, size=lost.shape)
    verdicts = judged(residuals, step_s, gate)
    first = verdicts.index("reopen")
    assert first + 1 >= RUN_MEASUREMENTS
    assert first * step_s >= RUN_S
    assert first * step_s < 2 * RUN_S


def test_the_offset_is_that_of_the_run_by_now() -> None:
    gate = Gate(0.999)
    residuals = np.column_stack([30.0 + 2.0 * np.arange(13), np.zeros(13)])
    assert judged(residuals, 1.0, gate)[-1] == "reopen"
    offset, rate = gate.offset()
    np.testing.assert_allclose(offset, [54.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(rate, [2.0, 0.0], atol=1e-9)


def test_without_a_probability_everything_passes() -> None:
    assert judged(np.full((3, 2), 1e6), gate=Gate(None)) == ["accept"] * 3


@pytest.mark.parametrize("seed", range(5))
def test_a_lost_filter_gets_back_although_outliers_go_on(seed: int) -> None:
    rng = np.random.default_rng(seed)
    lost = np.tile([50.0, -20.0], (60, 1)) + rng.normal(scale=SIGMA, size=(60, 2))
    outliers = rng.random(60) < 0.1
    lost[outliers] += rng.uniform(-100, 100, size=(outliers.sum(), 2))
    assert "reopen" in judged(lost)


def test_outliers_of_long_ago_do_not_lock_it() -> None:
    rng = np.random.default_rng(3)
    burst = rng.uniform(-100, 100, size=(15, 2))
    lost = np.tile([50.0, -20.0], (30, 1)) + rng.normal(scale=SIGMA, size=(30, 2))
    assert "reopen" in judged(np.concatenate([burst, lost]))
