"""Latitude and longitude under each other's names."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gtsam_nav.audit import audit
from gtsam_nav.audit.exchanged import exchanged_findings
from gtsam_nav.audit.findings import Finding
from gtsam_nav.frames import Array, Origin, geodetic_from_ned, ned_from_geodetic, wrap_angle
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.series import DvlSeries, GnssSeries, HeadingSeries

T = np.arange(0.0, 600.0, 0.5)
HEADING = 0.03 * T + 0.8 * np.sin(T / 25.0)
FIX = "columns: {lat_deg: lon_deg, lon_deg: lat_deg}"


def outing(origin: Origin, *, dvl: bool = True) -> Mission:
    """Wobbling circles by compass, fixes and perhaps a DVL."""
    rng, n = np.random.default_rng(4), len(T)
    v_n = np.column_stack([np.cos(HEADING), np.sin(HEADING), 0.0 * T])
    p_n = (0.5 * np.cumsum(v_n, axis=0) + rng.normal(0.0, 0.2, (n, 3)))[::2]
    heading = wrap_angle(HEADING + rng.normal(0.0, 0.02, n))
    v_d = np.tile([1.0, 0.0, 0.0], (n, 1)) + rng.normal(0.0, 0.02, (n, 3))
    good = np.ones(n, dtype=bool)
    sensors = [
        Sensor("heading", "heading", HeadingSeries(t=T, heading=heading, sigma=np.full(n, 0.02))),
        Sensor("gnss", "gnss", GnssSeries(t=T[::2], p_n=p_n, sigma=np.full(p_n.shape, 0.2))),
    ]
    if dvl:
        series = DvlSeries(t=T, v_d=v_d, sigma=np.full(n, 0.02), valid=good, bottom_lock=good)
        sensors.append(Sensor("dvl", "dvl", series))
    return Mission("outing", {s.name: s for s in sensors}, origin=origin)


def swapped(mission: Mission) -> Mission:
    """The origin as the first fix has it."""
    gnss, origin = mission.sensors["gnss"], mission.origin
    assert isinstance(gnss.series, GnssSeries)
    assert origin is not None
    lat, lon, height = geodetic_from_ned(gnss.series.p_n, origin)
    there = Origin(float(lon[0]), float(lat[0]))
    p_n = ned_from_geodetic(lon, lat, height, there)
    return replace(
        mission.with_sensor(replace(gnss, series=replace(gnss.series, p_n=p_n))), origin=there
    )


def with_headings(mission: Mission, heading: Array) -> Mission:
    compass = mission.sensors["heading"]
    series = replace(compass.series, heading=heading)  # type: ignore[call-arg]
    return mission.with_sensor(replace(compass, series=series))


def warnings(mission: Mission) -> list[Finding]:
    return [f for f in audit(mission).findings if f.severity == "warning"]


@pytest.mark.parametrize("place", [Origin(43.1, 5.9), Origin(60.2, 24.9), Origin(-33.9, 18.4)])
@pytest.mark.parametrize("dvl", [True, False])
def test_exchanged_degrees_are_told_by_how_they_stretch_the_way(place: Origin, dvl: bool) -> None:
    (finding,) = warnings(swapped(outing(place, dvl=dvl)))
    assert (finding.check, finding.sensor, finding.fix) == ("fixes mirrored", "gnss", FIX)


@pytest.mark.parametrize("place", [Origin(43.1, 5.9), Origin(60.2, 24.9), Origin(10.0, 170.0)])
def test_nothing_is_said_of_what_is_in_order(place: Origin) -> None:
    assert list(exchanged_findings(outing(place))) == []
    assert list(exchanged_findings(outing(place, dvl=False))) == []


def test_a_compass_that_counts_from_east_is_none() -> None:
    mission = outing(Origin(60.2, 24.9))
    from_east = with_headings(mission, wrap_angle(0.5 * np.pi - HEADING))
    assert list(exchanged_findings(from_east)) == []


def test_near_the_equator_both_mends_are_offered() -> None:
    (finding,) = warnings(swapped(outing(Origin(2.0, 9.0))))
    assert finding.check == "heading against course"
    assert "scale: {heading_deg: -1}" in finding.fix
    assert f"in that of gnss: columns: {{n: e, e: n}} (in a file of degrees {FIX})" in finding.fix
