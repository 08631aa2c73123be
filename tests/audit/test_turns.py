"""Units and signs of what sees turns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gtsam_nav.audit.agreement import Agreement
from gtsam_nav.audit.compass_unit import compasses_in_radians
from gtsam_nav.audit.findings import Finding
from gtsam_nav.audit.turns import (
    TurnPair,
    in_radians,
    turn_findings,
    turn_pairs,
    turns_of,
    unit_ratio,
    wrong_signs,
)
from gtsam_nav.frames import Array, rotation_from_rpy, wrap_angle
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.series import HeadingSeries, ImuSeries, OdometrySeries

T = np.arange(0.0, 200.0, 0.1)
YAW = 0.04 * T + 0.8 * np.sin(T / 6.0) + 0.1 * np.sin(T * 1.7)
RATE = np.gradient(YAW, T)
RNG = np.random.default_rng(9)


@pytest.fixture(autouse=True)
def same_noise(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever tests ran before."""
    monkeypatch.setitem(globals(), "RNG", np.random.default_rng(9))


def imu(rate: Array = RATE, accel_z: float = -9.8) -> Sensor:
    noise = RNG.normal(0.0, 1e-3, (len(T), 3))
    series = ImuSeries(
        t=T,
        gyro_i=noise + np.outer(rate, [0.0, 0.0, 1.0]),
        accel_i=noise + np.array([0.0, 0.0, accel_z]),
    )
    return Sensor("imu", "imu", series)


def compass(yaw: Array = YAW) -> Sensor:
    heading = wrap_angle(yaw + RNG.normal(0.0, 0.01, len(T)))
    series = HeadingSeries(t=T, heading=heading, sigma=np.full(len(T), 0.01))
    return Sensor("heading", "heading", series)


def wheels(rate: Array = RATE) -> Sensor:
    sigma = np.full(len(T), 0.02)
    series = OdometrySeries(
        t=T,
        v_b=np.ones((len(T), 2)),
        yaw_rate=rate + RNG.normal(0.0, 0.02, len(T)),
        sigma_v=sigma,
        sigma_yaw_rate=sigma,
    )
    return Sensor("odometry", "odometry", series)


def found_of(*sensors: Sensor) -> list[Finding]:
    mission = Mission("turns", {s.name: s for s in sensors})
    turns = turns_of(mission)
    pairs = turn_pairs(turns)
    radians = compasses_in_radians(mission, pairs, ())
    return list(turn_findings(turns, pairs, wrong_signs(pairs, (), ()), radians))


def warned(*sensors: Sensor) -> dict[str, Finding]:
    return {f.check: f for f in found_of(*sensors) if f.severity == "warning"}


def test_sensors_that_agree_are_not_warned_of() -> None:
    assert warned(imu(), compass(), wheels()) == {}
    assert warned(imu()) == {}


def test_units_are_told_by_the_nearest_ratio() -> None:
    assert unit_ratio(0.7) == unit_ratio(-1.4) == 1.0
    assert unit_ratio(-50.0) == pytest.approx(np.degrees(1.0))
    assert unit_ratio(0.02) == pytest.approx(np.radians(1.0))


def test_gyro_in_degrees() -> None:
    found = warned(imu(np.degrees(RATE)), compass())
    assert list(found) == ["gyro unit"]
    assert found["gyro unit"].fix == "gyro_unit: deg/s"


def test_gyro_that_was_converted_twice() -> None:
    found = warned(imu(np.radians(RATE)), compass(), wheels())
    assert found["gyro unit"].fix == "scale: {gx: 57.29578, gy: 57.29578, gz: 57.29578}"


def test_odometry_in_degrees_or_converted_twice() -> None:
    series = wheels().series
    assert isinstance(series, OdometrySeries)
    for convert, factor in ((np.degrees, "0.01745329"), (np.radians, "57.29578")):
        spoilt = replace(wheels(), series=replace(series, yaw_rate=convert(series.yaw_rate)))
        found = warned(imu(), compass(), spoilt)
        assert list(found) == ["gyro unit"]
        assert found["gyro unit"].sensor == "odometry"
        assert found["gyro unit"].fix == f"scale: {{wz: {factor}}}"


def test_a_third_sensor_tells_who_is_reversed() -> None:
    assert list(warned(imu(-RATE), compass(), wheels())) == ["gyro sign"]
    assert list(warned(imu(), compass(-YAW), wheels())) == ["heading sign"]


def test_odometry_that_is_reversed() -> None:
    found = {(f.check, f.sensor): f for f in found_of(imu(), compass(), wheels(-RATE))}
    reversed_rate = found["yaw rate sign", "odometry"]
    assert reversed_rate.severity == "warning"
    assert reversed_rate.message.startswith("turns the other way than imu and heading")
    assert reversed_rate.fix == "scale: {wz: -1}"
    assert found["heading sign", "heading"].text == "turns the same way as imu"
    assert found["gyro unit", "imu"].message.startswith("heading turns 1.01 times")
    assert [f.severity for f in found.values()].count("warning") == 1


def test_whom_a_reversed_sensor_alone_contradicts_is_not_said_to_agree() -> None:
    turns = turns_of(Mission("turns", {s.name: s for s in (compass(), wheels(-RATE))}))
    pairs = turn_pairs(turns)
    by_fixes = wrong_signs(pairs, (), [("gnss", "heading")])
    (found,) = turn_findings(turns, pairs, by_fixes, {})
    assert (found.check, found.sensor) == ("yaw rate sign", "odometry")


def test_two_alone_are_both_named() -> None:
    found = warned(imu(-RATE), compass())
    assert set(found) == {"gyro sign", "heading sign"}
    assert "or that of heading" in found["gyro sign"].message


def test_all_axes_are_turned_only_where_gravity_says_so() -> None:
    assert warned(imu(-RATE), compass(), wheels())["gyro sign"].fix == "scale: {gz: -1}"
    upside_down = warned(imu(-RATE, accel_z=9.8), compass(), wheels())
    assert upside_down["gyro sign"].fix == "rpy_deg: [180, 0, 0]"
    on_its_side = replace(imu(), R_bs=rotation_from_rpy([np.pi / 2, 0.0, 0.0]))
    turned = replace(on_its_side.series, gyro_i=-imu().series.gyro_i[:, [0, 2, 1]])  # type: ignore[attr-defined]
    found = warned(replace(on_its_side, series=turned), compass(), wheels())
    assert found["gyro sign"].fix == "scale: {gy: -1}"


def test_headings_in_radians() -> None:
    radians = compass(np.radians(1.0) * wrap_angle(YAW))
    narrow = replace(radians.series, heading=np.radians(wrap_angle(YAW)))
    found = warned(imu(), replace(radians, series=narrow))
    assert list(found) == ["heading unit"]
    assert found["heading unit"].fix == "scale: {heading_deg: 57.29578}"


def test_a_way_straight_north_is_not_in_radians() -> None:
    narrow = HeadingSeries(t=T, heading=0.05 * np.sin(T), sigma=np.full(len(T), 0.01))
    assert not in_radians(narrow)


def test_pairs_know_their_signs() -> None:
    told = Agreement(-0.02, 1e-3, 0.0, 0.01, -0.9, 0.1, 20)
    pair = TurnPair("heading", "imu", told)
    assert pair.opposed
    assert pair.unit == pytest.approx(np.radians(1.0))
    assert wrong_signs((pair,), (), [("gnss", "heading")]) == ("imu",)
