"""Lever arm and clock of a receiver, from what turns do to its fixes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gtsam_nav.audit.antenna import antenna_fit, lever_findings, steady_yaw
from gtsam_nav.audit.courses import Velocity
from gtsam_nav.audit.findings import Finding
from gtsam_nav.audit.lagged_products import Signal
from gtsam_nav.audit.motion import turned
from gtsam_nav.mission import Sensor
from gtsam_nav.series import GnssSeries

T = np.arange(0.0, 600.0, 0.2)
YAW = 0.04 * T + 0.8 * np.sin(T / 9.0)
SPEED = 0.8 + 0.2 * np.sin(T / 15.0)
P_N = np.cumsum(SPEED[:, None] * np.column_stack([np.cos(YAW), np.sin(YAW)]), axis=0) * 0.2
ARM_B = np.array([-1.5, 0.8, -2.0])


def receiver(late_s: float = 0.0, seed: int = 0) -> Sensor:
    """Fixes at 1 Hz of an antenna on a mast at the stern."""
    antenna_n = P_N + turned(np.tile(ARM_B[:2], (len(T), 1)), YAW)
    t = np.arange(5.0, 590.0)
    at = np.stack([np.interp(t, T, axis) for axis in antenna_n.T], axis=1)
    p_n = np.column_stack([at, 0 * t]) + np.random.default_rng(seed).normal(0, 0.2, (len(t), 3))
    series = GnssSeries(t=t + late_s, p_n=p_n, sigma=np.full(p_n.shape, 0.2))
    return Sensor("gnss", "gnss", series, xyz_b=ARM_B)


def log(scale: float = 1.0) -> Velocity:
    v_s = np.column_stack([scale * SPEED, 0 * T, 0 * T])
    v_s += np.random.default_rng(1).normal(0, 0.03, v_s.shape)
    return Velocity("dvl", T, v_s, np.eye(3))


@pytest.mark.parametrize("late_s", [0.0, 0.7, -2.0, 18.0])
def test_arm_and_clock_are_found(late_s: float) -> None:
    for seed in range(3):
        fit = antenna_fit(receiver(late_s, seed), Signal(T, YAW + 0.01), [log(1.05)])
        assert fit is not None
        assert fit.lag.lag_s == pytest.approx(-late_s, abs=5 * fit.lag.sigma_s + 0.02)
        assert np.all(np.abs(fit.lever_b - ARM_B[:2]) < 5 * fit.sigma_lever)
        assert fit.lag.sigma_s < 0.2


def judged(stated_b: list[float]) -> Finding:
    gnss = replace(receiver(), xyz_b=np.array(stated_b))
    fit = antenna_fit(gnss, Signal(T, YAW), [log()])
    assert fit is not None
    (finding,) = lever_findings(gnss, fit)
    return finding


def test_wrong_signs_of_the_arm_are_named() -> None:
    assert judged([-1.5, 0.8, -2.0]).severity == "ok"
    assert judged([1.5, 0.8, -2.0]).fix == "xyz_m: [-1.5, 0.8, -2]"
    assert judged([-1.5, -0.8, -2.0]).fix == "xyz_m: [-1.5, 0.8, -2]"
    assert "sign of x and y" in judged([1.5, -0.8, -2.0]).message


def test_an_arm_that_is_neither_is_no_wrong_sign() -> None:
    assert judged([0.0, 0.0, 0.0]).severity == "ok"
    assert judged([5.0, 0.8, 0.0]).severity == "ok"


def test_outliers_do_not_matter() -> None:
    gnss = receiver()
    series = gnss.series
    assert isinstance(series, GnssSeries)
    jumped = series.p_n.copy()
    jumped[::50, 0] += 30.0
    fit = antenna_fit(replace(gnss, series=replace(series, p_n=jumped)), Signal(T, YAW), [log()])
    assert fit is not None
    assert np.all(np.abs(fit.lever_b - ARM_B[:2]) < 5 * fit.sigma_lever)


def test_too_short_a_mission_says_nothing() -> None:
    gnss = receiver()
    short = replace(gnss, series=gnss.series.crop(0.0, 150.0))
    assert antenna_fit(short, Signal(T, YAW), [log()]) is None
    assert antenna_fit(gnss, Signal(T, YAW), []) is None


def test_the_gyro_carries_the_heading_over_disturbances() -> None:
    disturbed = YAW + 0.3 * np.exp(-(((T - 300.0) / 4.0) ** 2))
    steady = steady_yaw(Signal(T, disturbed), Signal(T, YAW + 0.01 * T))
    middle = np.abs(T - 300.0) < 30.0
    assert np.max(np.abs(steady.values - YAW)[middle]) < 0.06
    assert np.array_equal(steady_yaw(Signal(T, disturbed), None).values, disturbed)
