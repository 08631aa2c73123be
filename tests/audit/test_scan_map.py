"""To which side a scanner's points lie, and where ahead is, by the map that they draw."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

import gtsam_nav as gn
from gtsam_nav.audit import audit
from gtsam_nav.audit.courses import Velocity, way
from gtsam_nav.audit.findings import Finding
from gtsam_nav.audit.lagged_products import Signal
from gtsam_nav.audit.motion import turned
from gtsam_nav.audit.scan_map import moved_scans, scan_findings
from gtsam_nav.audit.sonar_map import map_likeness
from gtsam_nav.frames import Array, rotation_from_rpy, wrap_angle
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.series import DvlSeries, HeadingSeries, OdometrySeries, ScanSeries

T = np.arange(0.0, 120.0, 0.5)
YAW = 0.15 * T + 0.4 * np.sin(T / 5.0)
SPEED_M_S = 0.4
P_N = way(T, SPEED_M_S * np.column_stack([np.cos(YAW), np.sin(YAW)]))
BEARING = np.radians(np.arange(-90.0, 90.0, 2.0))
LOG = Velocity("odometry", T, np.tile([SPEED_M_S, 0.0, 0.0], (len(T), 1)), np.eye(3))
COMPASS = Signal(T, YAW)


def points(p_n: Array = P_N) -> Array:
    """Of a lopsided room, scan by scan in body axes, (s, b, 2)."""
    bearing = YAW[:, None] + BEARING
    c, s = np.cos(bearing), np.sin(bearing)
    north, east = p_n[:, 0, None], p_n[:, 1, None]
    with np.errstate(divide="ignore"):
        along = np.where(c > 0, 7.0 - north, north + 5.0) / abs(c)
        across = np.where(s > 0, 9.0 - east, east + 4.0) / abs(s)
    range_m = np.minimum(along, across)
    return range_m[..., None] * np.stack([np.cos(BEARING), np.sin(BEARING)], axis=-1)


def scanner(points_b: Array) -> Sensor:
    first = len(BEARING) * np.arange(len(T) + 1)
    return Sensor("scans", "scans", ScanSeries(t=T, first=first, points_b=points_b.reshape(-1, 2)))


def judged(points_b: Array, velocity: Velocity | None = LOG) -> Finding:
    scans = moved_scans(scanner(points_b), COMPASS, velocity)
    assert scans is not None
    (finding,) = scan_findings(scanner(points_b), map_likeness(scans, scans.knows_way), ())
    return finding


def turned_by(points_b: Array, deg: float) -> Array:
    flat = points_b.reshape(-1, 2)
    return turned(flat, np.full(len(flat), np.radians(deg)))


def test_points_in_body_axes_are_fine() -> None:
    assert judged(points()).severity == "ok"


def test_port_for_starboard_is_found() -> None:
    found = judged(points() * [1.0, -1.0])
    assert (found.check, found.severity) == ("scan axes", "warning")
    assert found.fix.startswith("rpy_deg: [180, 0, 0]")


@pytest.mark.parametrize("velocity", [None, replace(LOG, v_s=0.0 * LOG.v_s)])
def test_a_turn_in_place_tells_the_side_as_well(velocity: Velocity | None) -> None:
    here = points(0.0 * P_N)
    assert judged(here, velocity).severity == "ok"
    assert "port and starboard" in judged(here * [1.0, -1.0], velocity).message


@pytest.mark.parametrize("deg", [-40.0, 90.0, 180.0])
def test_a_wrong_ahead_is_measured(deg: float) -> None:
    found = judged(turned_by(points(), deg))
    yaw_deg = float(found.fix.split("]")[0].split(",")[-1])
    assert (
        abs(np.degrees(wrap_angle(np.radians(yaw_deg + deg)))) < 6.0
    )  # a way of .4 m and cells of .3 m


def test_the_fix_mends_both() -> None:
    found = judged(turned_by(points() * [1.0, -1.0], 60.0))
    rpy_deg = np.array(yaml.safe_load(found.fix.split(" (")[0])["rpy_deg"])
    R = rotation_from_rpy(np.radians(rpy_deg))[:2, :2]
    assert judged(turned_by(points() * [1.0, -1.0], 60.0) @ R.T).severity == "ok"


def test_a_vehicle_at_rest_shows_neither() -> None:
    still = replace(LOG, v_s=0.0 * LOG.v_s)
    assert moved_scans(scanner(points()), Signal(T, 0.0 * T), still) is None


def test_scans_without_points_tell_nothing() -> None:
    empty = ScanSeries(t=T, first=np.zeros(len(T) + 1, dtype=int), points_b=np.empty((0, 2)))
    assert moved_scans(Sensor("scans", "scans", empty), COMPASS, LOG) is None


@pytest.mark.parametrize("has_compass", [True, False])
def test_the_audit_asks_compass_or_odometry(has_compass: bool) -> None:
    sigma = np.full(len(T), 0.01)
    wheels = OdometrySeries(
        t=T,
        v_b=np.tile([SPEED_M_S, 0.0], (len(T), 1)),
        yaw_rate=np.gradient(YAW, T),
        sigma_v=sigma,
        sigma_yaw_rate=sigma,
    )
    compass = HeadingSeries(t=T, heading=wrap_angle(YAW), sigma=sigma)
    sensors = {
        "odometry": Sensor("odometry", "odometry", wheels),
        "scans": scanner(points() * [1.0, -1.0]),
        "heading": Sensor("heading", "heading", compass, noise={"magnetic": False}),
    }
    mission = Mission("room", sensors if has_compass else dict(list(sensors.items())[:2]))
    (found,) = (f for f in audit(mission).findings if f.check == "scan axes")
    assert found.severity == "warning"
    assert "unless odometry is wrong" in found.message


def test_a_compass_that_nothing_bears_out_may_be_at_fault() -> None:
    """It counts the other way round, and the points are drawn by it alone."""
    every, sigma = np.ones(len(T), dtype=bool), np.full(len(T), 0.01)
    v_d = LOG.v_s + 0.001 * np.sin(np.arange(3) + T[:, None])  # what never changes is stuck
    log = DvlSeries(t=T, v_d=v_d, sigma=sigma, valid=every, bottom_lock=every)
    compass = HeadingSeries(t=T, heading=wrap_angle(-YAW), sigma=sigma)
    sensors = {
        "dvl": Sensor("dvl", "dvl", log),
        "scans": scanner(points()),
        "heading": Sensor("heading", "heading", compass),
    }
    (found,) = (f for f in audit(Mission("room", sensors)).findings if f.check == "scan axes")
    assert "unless dvl or heading is wrong" in found.message


@pytest.mark.realdata
def test_a_recorded_laser(recorded_data: Path) -> None:
    mission = gn.open_mission(recorded_data / "carmen" / "fr079.clf.bz2")
    (found,) = (f for f in audit(mission).findings if f.check == "scan axes")
    assert found.severity == "ok"
    laser = mission.sensors["scans"]
    assert isinstance(laser.series, ScanSeries)
    series = replace(laser.series, points_b=laser.series.points_b * [1.0, -1.0])
    mirrored = mission.with_sensor(replace(laser, series=series))
    (found,) = (f for f in audit(mirrored).findings if f.check == "scan axes")
    assert found.fix.startswith("rpy_deg: [180, 0, 0]")
