"""Ranges to beacons, in m and in other units."""

from __future__ import annotations

import numpy as np
import pytest

from gtsam_nav.audit.courses import Velocity, measured_velocity
from gtsam_nav.audit.findings import Finding
from gtsam_nav.audit.ranges import range_findings
from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.series import LandmarkSeries, OdometrySeries

T = np.arange(0.0, 300.0, 0.5)
BEACONS_N = np.array([[40.0, 10.0], [-20.0, 35.0], [15.0, -30.0]])


def wheels(speed_m_s: float) -> Velocity:
    n = len(T)
    series = OdometrySeries(
        t=T,
        v_b=np.tile([speed_m_s, 0.0], (n, 1)),
        yaw_rate=np.full(n, 0.05),
        sigma_v=np.full(n, 0.02),
        sigma_yaw_rate=np.full(n, 0.02),
    )
    return measured_velocity(Sensor("odometry", "odometry", series))


def beacons(factor: float, speed_m_s: float, of: Array = T) -> Mission:
    rng, k = np.random.default_rng(2), np.arange(len(of)) % len(BEACONS_N)
    course = 0.05 * of
    p_n = speed_m_s / 0.05 * np.column_stack([np.sin(course), 1.0 - np.cos(course)])
    ranges = np.linalg.norm(BEACONS_N[k] - p_n, axis=1) + rng.normal(0.0, 0.1, len(of))
    series = LandmarkSeries(t=of, id=k, range_m=factor * ranges, sigma_range=np.full(len(of), 0.1))
    return Mission("beacons", {"radio": Sensor("radio", "landmarks", series)})


def found(factor: float, speed_m_s: float = 1.0) -> list[Finding]:
    return list(range_findings(beacons(factor, speed_m_s), wheels(speed_m_s)))


@pytest.mark.parametrize("factor", [1.0, 1.1])
def test_nothing_is_said_of_ranges_in_m(factor: float) -> None:
    assert found(factor) == []


@pytest.mark.parametrize(("factor", "m"), [(1 / 0.3048, 0.3048), (1e2, 1e-2), (1e3, 1e-3)])
def test_other_units_are_found(factor: float, m: float) -> None:
    (finding,) = found(factor)
    assert (finding.check, finding.sensor) == ("range unit", "radio")
    assert finding.fix == f"scale: {{range_m: {m:g}}}"


def test_at_rest_nothing_is_said() -> None:
    assert found(1e2, speed_m_s=0.0) == []


def test_straight_away_from_a_beacon_they_change_by_all_of_the_way() -> None:
    of = np.arange(0.0, 300.0, 5.0)
    ranges = 10.0 + 1.0 * of
    series = LandmarkSeries(
        t=of, id=np.zeros(len(of), int), range_m=ranges, sigma_range=np.full(len(of), 0.1)
    )
    mission = Mission("beacons", {"radio": Sensor("radio", "landmarks", series)})
    assert list(range_findings(mission, wheels(0.98))) == []
