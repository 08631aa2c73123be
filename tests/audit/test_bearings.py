"""The sign and the units of sightings, told by landmarks that stand still."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gtsam_nav.audit.bearings import bearing_findings
from gtsam_nav.audit.findings import Finding
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.series import LandmarkSeries, OdometrySeries

LANDMARKS_N = np.array([[12.0, 4.0], [-5.0, 9.0], [6.0, -10.0]])


def driven(yaw_rate: float, sign: float = 1.0) -> Mission:
    """A robot that goes ahead and turns steadily among three landmarks."""
    rng = np.random.default_rng(3)
    t = np.arange(0.0, 200.0, 0.1)
    n = len(t)
    course = yaw_rate * t
    p_n = 0.05 * np.cumsum(np.column_stack([np.cos(course), np.sin(course)]), axis=0)
    odometry = OdometrySeries(
        t=t,
        v_b=np.tile([0.5, 0.0], (n, 1)),
        yaw_rate=np.full(n, yaw_rate),
        sigma_v=np.full(n, 0.01),
        sigma_yaw_rate=np.full(n, 0.01),
    )
    k = np.arange(0, n, 20)
    seen = k % len(LANDMARKS_N)
    away = LANDMARKS_N[seen] - p_n[k]
    bearing = np.arctan2(away[:, 1], away[:, 0]) - course[k] + rng.normal(0.0, 0.03, len(k))
    landmarks = LandmarkSeries(
        t=t[k],
        id=seen,
        range_m=np.hypot(*away.T) + rng.normal(0.0, 0.1, len(k)),
        bearing=sign * np.angle(np.exp(1j * bearing)),
        sigma_range=np.full(len(k), 0.1),
        sigma_bearing=np.full(len(k), 0.03),
    )
    sensors = (Sensor("odometry", "odometry", odometry), Sensor("eye", "landmarks", landmarks))
    return Mission("driven", {s.name: s for s in sensors})


def in_units(mission: Mission, bearing: float, distance: float) -> Mission:
    """Sightings that are multiplied."""
    eye = mission.sensors["eye"]
    assert isinstance(eye.series, LandmarkSeries)
    assert eye.series.range_m is not None
    assert eye.series.bearing is not None
    series = replace(
        eye.series, range_m=distance * eye.series.range_m, bearing=bearing * eye.series.bearing
    )
    return mission.with_sensor(replace(eye, series=series))


def found(mission: Mission) -> Finding:
    (finding,) = bearing_findings(mission)
    return finding


def test_bearings_that_count_clockwise_are_in_order() -> None:
    finding = found(driven(0.1))
    assert (finding.severity, finding.fix) == ("ok", "")
    assert "shows in none" not in finding.message


@pytest.mark.parametrize("yaw_rate", [0.1, -0.05])
def test_reversed_bearings_are_found(yaw_rate: float) -> None:
    finding = found(driven(yaw_rate, sign=-1.0))
    assert (finding.check, finding.sensor, finding.severity) == ("bearing sign", "eye", "warning")
    assert finding.fix == "scale: {bearing_deg: -1}"


@pytest.mark.parametrize(
    ("check", "bearing", "distance", "fix"),
    [
        ("bearing unit", np.radians(1.0), 1.0, "scale: {bearing_deg: 57.29578}"),
        ("bearing unit", -np.radians(1.0), 1.0, "scale: {bearing_deg: -57.29578}"),
        ("bearing unit", np.degrees(1.0), 1.0, "scale: {bearing_deg: 0.01745329}"),
        ("range unit", 1.0, 1 / 0.3048, "scale: {range_m: 0.3048}"),
        ("range unit", 1.0, 1e2, "scale: {range_m: 0.01}"),
        ("range unit", 1.0, 1e3, "scale: {range_m: 0.001}"),
    ],
)
def test_other_units_are_found(check: str, bearing: float, distance: float, fix: str) -> None:
    finding = found(in_units(driven(0.1), bearing, distance))
    assert (finding.check, finding.severity, finding.fix) == (check, "warning", fix)


def test_a_small_unit_does_not_explain_sightings_at_rest() -> None:
    resting = driven(0.1).crop(0.0, 150.0)
    wheels, eye = resting.sensors["odometry"].series, resting.sensors["eye"].series
    assert isinstance(wheels, OdometrySeries)
    assert isinstance(eye, LandmarkSeries)
    still = replace(wheels, v_b=0 * wheels.v_b, yaw_rate=0 * wheels.yaw_rate)
    rng = np.random.default_rng(5)
    seen = replace(
        eye,
        range_m=10.0 + rng.normal(0.0, 0.1, len(eye)),
        bearing=0.3 * eye.id + rng.normal(0.0, 0.03, len(eye)),
    )
    sensors = (Sensor("odometry", "odometry", still), Sensor("eye", "landmarks", seen))
    assert found(Mission("at rest", {s.name: s for s in sensors})).severity == "ok"


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_straight_way_does_not_tell(sign: float) -> None:
    assert "shows in none" in found(driven(0.0, sign)).message


def test_without_ids_ranges_or_motion_nothing_is_said() -> None:
    mission = driven(0.1, sign=-1.0)
    eye = mission.sensors["eye"]
    nameless = replace(eye.series, id=np.full(len(eye.series), -1))  # type: ignore[call-arg]
    assert not list(bearing_findings(mission.with_sensor(replace(eye, series=nameless))))
    assert not list(bearing_findings(mission.without("odometry")))
