"""Steps of a compass that the gyro does not see."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.preprocess.compass_steps import without_compass_steps
from gtsam_nav.sensors.noise import HeadingNoise
from gtsam_nav.series import BoolArray, HeadingSeries, ImuSeries

T = np.arange(0.0, 60.0, 0.1)
RATE = np.where((T > 20.0) & (T < 25.0), np.radians(40.0), np.radians(1.0))
TRUE = np.cumsum(RATE) * 0.1
SIGMA = np.radians(0.3)


def mission(error: Array, *, gyro: bool = True) -> Mission:
    """A vehicle that turns sharply once; gyro and compass with their noise."""
    rng = np.random.default_rng(3)
    reading = wrap_angle(TRUE + error + SIGMA * rng.normal(size=len(T)))
    series = HeadingSeries(t=T, heading=reading, sigma=np.full(len(T), SIGMA))
    sensors = {"heading": Sensor("heading", "heading", series, noise={"bias_sigma_deg": 3.0})}
    if gyro:
        rates = np.column_stack([np.zeros((len(T), 2)), RATE + 0.01 * rng.normal(size=len(T))])
        imu = ImuSeries(t=T, gyro_i=rates, accel_i=np.zeros((len(T), 3)))
        sensors["imu"] = Sensor("imu", "imu", imu)
    return Mission("steps", sensors)


def heading_of(cleaned: Mission) -> Array:
    series = cleaned.sensors["heading"].series
    assert isinstance(series, HeadingSeries)
    return series.heading


def test_a_spell_of_wrong_headings_is_put_back() -> None:
    error = np.where((T >= 30.0) & (T < 45.0), np.radians(15.0), 0.0)
    cleaned, warnings = without_compass_steps(mission(error))
    assert np.max(np.abs(wrap_angle(heading_of(cleaned) - TRUE))) < 6 * SIGMA
    assert len(warnings) == 2
    assert "at 30.0 s" in warnings[0]
    assert "at 45.0 s" in warnings[1]


def test_after_a_step_the_compass_is_trusted_less() -> None:
    """Nobody knows which side of the step was right."""
    cleaned, _ = without_compass_steps(mission(np.where(T > 30.0, np.radians(-20.0), 0.0)))
    noise = HeadingNoise.model_validate(cleaned.sensors["heading"].noise)
    assert noise.bias_sigma_deg == pytest.approx(np.hypot(3.0, 20.0), rel=0.02)


@pytest.mark.parametrize(
    "error",
    [
        np.zeros(len(T)),
        np.radians(20.0) * np.exp(-((T - 40.0) ** 2) / 8.0),
        np.where(np.arange(len(T)) == 400, np.radians(30.0), 0.0),
    ],
    ids=["turn", "slow disturbance", "one bad reading"],
)
def test_what_is_no_step_stays(error: Array) -> None:
    measured = mission(error)
    assert without_compass_steps(measured) == (measured, ())


@pytest.mark.parametrize("silence", [(19.0, 26.0), (19.0, np.inf)], ids=["gap", "early end"])
def test_a_turn_that_the_gyro_could_not_see_is_no_step(silence: tuple[float, float]) -> None:
    """At 40 deg/s each reading is four degrees on from the last one, and at a gap's end all."""
    measured = mission(np.zeros(len(T)))
    gyro = measured.sensors["imu"]
    kept = (gyro.series.t < silence[0]) | (gyro.series.t > silence[1])
    partly = measured.with_sensor(replace(gyro, series=gyro.series.select(kept)))
    assert without_compass_steps(partly) == (partly, ())


def test_a_step_is_found_beside_a_silence_of_the_gyro() -> None:
    measured = mission(np.where(T > 30.0, np.radians(20.0), 0.0))
    gyro = measured.sensors["imu"]
    kept = (gyro.series.t < 19.0) | (gyro.series.t > 26.0)
    partly = measured.with_sensor(replace(gyro, series=gyro.series.select(kept)))
    _, warnings = without_compass_steps(partly)
    assert len(warnings) == 1
    assert "at 30.1 s" in warnings[0]


@pytest.mark.parametrize("kept", [np.arange(len(T)) % 10 == 0, np.abs(T - 40.0) > 0.35])
def test_a_step_is_found_by_a_slow_gyro_and_beside_a_sample_or_two_that_lack(
    kept: BoolArray,
) -> None:
    measured = mission(np.where(T > 40.0, np.radians(20.0), 0.0))
    gyro = measured.sensors["imu"]
    partly = measured.with_sensor(replace(gyro, series=gyro.series.select(kept)))
    warnings = without_compass_steps(partly)[1]
    assert any("at 40.1 s" in said for said in warnings)


def test_without_a_gyro_nothing_is_done() -> None:
    measured = mission(np.where(T > 30.0, 0.5, 0.0), gyro=False)
    assert without_compass_steps(measured) == (measured, ())
