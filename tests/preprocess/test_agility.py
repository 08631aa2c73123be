"""Brisk vehicles: accelerations beyond the default model are found, and nothing else is."""

from __future__ import annotations

import numpy as np
import pytest

from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.preprocess.agility import fitted_to
from gtsam_nav.preprocess.settings import MotionSettings
from gtsam_nav.series import HeadingSeries, OdometrySeries

T = np.arange(0.0, 120.0, 0.05)


def mission(speed: Array, heading: Array | None = None, sigma_v: float = 0.03) -> Mission:
    n = len(T)
    odometry = OdometrySeries(
        t=T,
        v_b=np.column_stack([speed, np.zeros(n)]),
        yaw_rate=np.zeros(n),
        sigma_v=np.full(n, sigma_v),
        sigma_yaw_rate=np.full(n, 0.1),
    )
    sensors = {"odometry": Sensor("odometry", "odometry", odometry)}
    if heading is not None:
        series = HeadingSeries(t=T, heading=heading, sigma=np.full(n, 0.005))
        sensors["heading"] = Sensor("heading", "heading", series)
    return Mission("test", sensors)


def noise(sigma: float) -> Array:
    return np.random.default_rng(0).normal(0.0, sigma, len(T))


def test_a_calm_vehicle_keeps_the_settings() -> None:
    settings = MotionSettings()
    calm = mission(1.0 + 0.2 * np.sin(0.05 * T) + noise(0.03), 0.1 * T)
    assert fitted_to(calm, settings) == (settings, ())


def test_noise_that_the_sensor_does_not_state_is_no_manoeuvre() -> None:
    settings = MotionSettings()
    assert fitted_to(mission(1.0 + noise(0.5), sigma_v=0.03), settings) == (settings, ())


def test_a_driver_raises_the_accelerations_to_its_strongest() -> None:
    # between 1 and -1 m/s at 1 m/s^2, back and forth
    speed = 1.0 - np.abs((T % 4.0) - 2.0)
    settings, notes = fitted_to(mission(speed), MotionSettings())
    assert settings.sigma_accel_m_s2 == pytest.approx(1.0, rel=0.05)
    share = settings.sigma_vertical_accel_m_s2 / settings.sigma_accel_m_s2
    assert share == pytest.approx(0.02 / 0.05)
    assert settings.sigma_yaw_accel_rad_s2 == MotionSettings().sigma_yaw_accel_rad_s2
    assert "motion.sigma_accel_m_s2" in notes[0]


def test_sharp_turns_raise_the_yaw_acceleration_alone() -> None:
    rate = np.where(T % 6.0 < 3.0, 1.0, -1.0)
    settings, notes = fitted_to(mission(np.ones(len(T)), np.cumsum(rate) * 0.05), MotionSettings())
    assert settings.sigma_yaw_accel_rad_s2 > 1.0
    assert settings.sigma_accel_m_s2 == MotionSettings().sigma_accel_m_s2
    assert notes


def test_what_is_stated_stays() -> None:
    settings = MotionSettings(fit_accelerations=False)
    assert fitted_to(mission(1.0 - np.abs((T % 4.0) - 2.0)), settings) == (settings, ())
