"""The mission folder: every column, and what its description may say."""

from __future__ import annotations

import gzip
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from missions import DEPTH_CSV, make_folder, one_sensor_folder

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Origin, ned_from_geodetic, rotation_from_rpy, rpy_from_rotation
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.readers import open_mission
from gtsam_nav.series import (
    AttitudeSeries,
    DvlSeries,
    GnssSeries,
    HeadingSeries,
    LandmarkSeries,
    OdometrySeries,
    ReferenceSeries,
    ScanSeries,
)
from gtsam_nav.writers.mission_folder import write_mission

TEN = range(10)


def csv(header: str, *row: Any) -> str:
    """A file of ten equal samples at 0, 1, ... 9 s."""
    cells = ",".join(str(cell) for cell in row)
    return f"{header}\n" + "".join(f"{k},{cells}\n" for k in TEN)


def read_one(folder: Path, sensor_type: str, text: str | bytes, **entry: Any) -> Sensor:
    return open_mission(one_sensor_folder(folder, sensor_type, text, **entry)).sensors["x"]


def test_dvl_without_its_optional_columns(tmp_path: Path) -> None:
    text = csv("t,vx,vy,vz,valid", 0.1, 0.2, 0.3, 1)
    series = read_one(tmp_path, "dvl", text, noise={"sigma_m_s": 0.07}).series
    assert isinstance(series, DvlSeries)
    np.testing.assert_array_equal(series.v_d, np.tile([0.1, 0.2, 0.3], (10, 1)))
    np.testing.assert_array_equal(series.sigma, 0.07)
    assert np.all(series.bottom_lock)
    assert series.altitude_m is None


def test_dvl_locks_are_words(tmp_path: Path) -> None:
    text = "t,vx,vy,vz,sigma,valid,lock,altitude\n" + "".join(
        f"{k},0,0,0,0.1,{int(k != 3)},{'water' if k == 5 else 'bottom'},{k}.5\n" for k in TEN
    )
    series = read_one(tmp_path, "dvl", text).series
    assert isinstance(series, DvlSeries)
    np.testing.assert_array_equal(np.flatnonzero(~series.valid), [3])
    np.testing.assert_array_equal(np.flatnonzero(~series.bottom_lock), [5])
    np.testing.assert_array_equal(series.altitude_m, np.arange(10) + 0.5)


def test_a_log_reads_the_water_and_ahead_alone(tmp_path: Path) -> None:
    folder = one_sensor_folder(tmp_path, "dvl", csv("t,vx", 1.5), through_water=True)
    mission = open_mission(folder)
    series = mission.sensors["x"].series
    assert isinstance(series, DvlSeries)
    np.testing.assert_array_equal(series.v_d, np.tile([1.5, 0.0, 0.0], (10, 1)))
    assert not np.any(series.bottom_lock)
    assert np.all(series.valid)
    write_mission(mission, tmp_path / "again")
    again = open_mission(tmp_path / "again").sensors["x"].series
    assert isinstance(again, DvlSeries)
    assert not np.any(again.bottom_lock)


def test_what_odometry_read_of_the_water_is_a_log_by_its_card(tmp_path: Path) -> None:
    text = csv("t,vx,vy,wz", 1.5, 0.1, 0.02)
    series = read_one(tmp_path, "dvl", text, through_water=True).series
    assert isinstance(series, DvlSeries)
    np.testing.assert_array_equal(series.v_d[0], [1.5, 0.1, 0.0])


def test_through_water_is_of_a_dvl(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="through_water is of dvl"):
        read_one(tmp_path, "depth", DEPTH_CSV, through_water=True)


def test_points_of_a_mounted_scanner_read_as_the_body_sees_them(tmp_path: Path) -> None:
    mounting = {"xyz_m": [0.5, 0.1, -0.3], "rpy_deg": [180, 0, 90]}
    placed = {"file": "scans.npz", "scanner_axes": True, **mounting}
    folder = make_folder(tmp_path, {}, {"scans": placed})
    seen = [[2.0, 0.0], [0.0, 3.0]]
    np.savez(folder / "scans.npz", t=np.arange(2.0), first=[0, 1, 2], points=seen)
    mission = open_mission(folder)
    scanner = mission.sensors["scans"]
    assert isinstance(scanner.series, ScanSeries)
    np.testing.assert_allclose(scanner.series.points_b, [[0.5, 2.1], [3.5, 0.1]], atol=1e-12)
    write_mission(mission, tmp_path / "again")
    again = open_mission(tmp_path / "again").sensors["scans"].series
    assert isinstance(again, ScanSeries)
    np.testing.assert_allclose(again.points_b, scanner.series.points_b)


def test_a_column_may_be_two_of_ours(tmp_path: Path) -> None:
    columns = {"sigma_n": "hAcc", "sigma_e": "hAcc", "sigma_d": "vAcc"}
    text = csv("t,n,e,d,hAcc,vAcc", 1, 2, 3, 0.5, 1)
    sensor = read_one(tmp_path, "gnss", text, columns=columns, scale={"sigma_e": 2})
    assert isinstance(sensor.series, GnssSeries)
    np.testing.assert_allclose(sensor.series.sigma[0], [0.5, 1.0, 1.0])


def test_stamps_of_archives_and_lists_have_units_too(tmp_path: Path) -> None:
    ms = {"scale": {"t": 0.001}}
    sensors = {
        "beams": {"file": "b.npz", **ms},
        "scans": {"file": "s.npz", **ms},
        "clouds": {"file": "clouds.csv", **ms},
        "edges": {"file": "e.csv", **ms},
        "depth": {"file": "d.csv"},
    }
    edges = "t_from,t,x,y,yaw_deg,xx,xy,xw,yy,yw,ww\n0,9000,1,0,0,.01,0,0,.01,0,.001\n"
    clouds = "t,file\n" + "".join(f"{1000 * k},c.npy\n" for k in TEN)
    files = {"d.csv": DEPTH_CSV, "e.csv": edges, "clouds.csv": clouds}
    folder = make_folder(tmp_path, files, sensors)
    np.save(folder / "c.npy", np.ones((3, 3)))
    t, n = 1000.0 * np.arange(10), 10
    echoes = np.zeros((n, 4), np.uint8)
    np.savez(folder / "b.npz", t=t, angle=0.1 * t, intensity=echoes, resolution_m=0.1)
    np.savez(folder / "s.npz", t=t, first=np.arange(n + 1), points=np.ones((n, 2)))
    mission = open_mission(folder)
    for sensor in mission.sensors.values():
        np.testing.assert_allclose(sensor.series.t, np.arange(10))
    assert mission.edges is not None
    np.testing.assert_allclose(mission.edges.t, [[0, 9]])


EDGES_CSV = "t_from,t,x,y,yaw_deg,xx,xy,xw,yy,yw,ww\n" + "".join(
    f"{k},{k + 1},{'nan' if k == 3 else 1},0,0,.01,0,0,.01,0,.001\n" for k in range(5)
)


@pytest.mark.parametrize("name", ["edges", "graph"])
def test_edges_have_any_name_and_a_clock(tmp_path: Path, name: str) -> None:
    sensors = {
        name: {"type": "edges", "file": "e.csv", "time_offset_s": 5.0},
        "depth": {"file": "d.csv"},
    }
    mission = open_mission(make_folder(tmp_path, {"e.csv": EDGES_CSV, "d.csv": DEPTH_CSV}, sensors))
    assert mission.edges is not None
    assert mission.edges.span_s == (5.0, 10.0)
    assert [(r.t, r.sensor) for r in mission.rejections] == [(9.0, "edges")]


@pytest.mark.parametrize(
    ("sensor_type", "entry", "message"),
    [
        ("beams", {"columns": {"t": "ms"}}, "columns means nothing for a sensor of type beams"),
        ("scans", {"scale": {"angle": 2}}, "a scans has no column 'angle'; the choices are: t"),
        ("edges", {"rpy_deg": [0, 0, 1]}, "rpy_deg means nothing for a sensor of type edges"),
        ("landmark_map", {"time_offset_s": 1}, "time_offset_s means nothing"),
    ],
)
def test_a_key_that_nothing_is_made_of_is_refused(
    tmp_path: Path, sensor_type: str, entry: dict[str, Any], message: str
) -> None:
    with pytest.raises(DataError, match=message):
        read_one(tmp_path, sensor_type, "", **entry)


def test_points_in_body_axes_stay_where_they_are(tmp_path: Path) -> None:
    """What mounts the scanner says where it is, and nothing of its points."""
    stated = {"file": "scans.npz", "xyz_m": [0.5, 0.1, -0.3], "rpy_deg": [0, 0, 90]}
    folder = make_folder(tmp_path, {}, {"scans": stated})
    np.savez(folder / "scans.npz", t=[0.0, 1.0], first=[0, 1, 2], points=[[2.0, 0.0], [0.0, 3.0]])
    scanner = open_mission(folder).sensors["scans"]
    assert isinstance(scanner.series, ScanSeries)
    np.testing.assert_array_equal(scanner.series.points_b, [[2.0, 0.0], [0.0, 3.0]])
    np.testing.assert_array_equal(scanner.xyz_b, [0.5, 0.1, -0.3])


def test_points_at_a_mounted_scanner_are_none(tmp_path: Path) -> None:
    """A laser that hears nothing back may say a range of zero."""
    placed = {"file": "scans.npz", "xyz_m": [0.5, 0.1, -0.3], "scanner_axes": True}
    folder = make_folder(tmp_path, {}, {"scans": placed})
    seen = [[2.0, 0.0], [0.0, 0.0], [0.0, 0.0], [0.0, 3.0]]
    np.savez(folder / "scans.npz", t=np.arange(3.0), first=[0, 2, 3, 4], points=seen)
    mission = open_mission(folder)
    series = mission.sensors["scans"].series
    assert isinstance(series, ScanSeries)
    np.testing.assert_array_equal(series.first, [0, 1, 1, 2])
    np.testing.assert_allclose(series.points_b, [[2.5, 0.1], [0.5, 3.1]])
    (said,) = (w for w in mission.warnings if "scanner itself" in w)
    assert said == "sensor 'scans': 2 points at the scanner itself are left out"


def test_columns_come_in_any_order_and_unknown_ones_are_named(tmp_path: Path) -> None:
    rows = [f"fine {k},0.3,0.2,0.1,{k}" for k in TEN]
    text = "\n".join(["comment,wz,vy,vx,t", *rows])
    mission = open_mission(one_sensor_folder(tmp_path, "odometry", text))
    series = mission.sensors["x"].series
    assert isinstance(series, OdometrySeries)
    np.testing.assert_array_equal(series.v_b[0], [0.1, 0.2])
    np.testing.assert_array_equal(series.yaw_rate, 0.3)
    assert any("unknown columns: comment" in w for w in mission.warnings)


def test_columns_that_another_sensor_takes_are_not_unknown(tmp_path: Path) -> None:
    rows = [f"{k},0.3,{k},fine" for k in TEN]
    (tmp_path / "log.csv").write_text("\n".join(["t,depth_m,yaw,comment", *rows]), encoding="utf-8")
    entries = ["depth: {file: log.csv}", "heading: {file: log.csv, columns: {heading_deg: yaw}}"]
    described = "\n  ".join(["name: x\nsensors:", *entries])
    (tmp_path / "mission.yaml").write_text(described, encoding="utf-8")
    (said,) = (w for w in open_mission(tmp_path).warnings if "unknown columns" in w)
    assert said == "sensors 'depth', 'heading': log.csv has unknown columns: comment"


def test_files_that_the_description_has_lost_are_named(tmp_path: Path) -> None:
    folder = one_sensor_folder(tmp_path, "depth", DEPTH_CSV)
    assert not any("does not name" in w for w in open_mission(folder).warnings)
    for name in ("heading.csv", "imu.csv.gz", "beams.npz", "notes.txt", "rejections.csv"):
        (folder / name).write_text("t,sensor,index,reason\n", encoding="utf-8")
    (warning,) = (w for w in open_mission(folder).warnings if "does not name" in w)
    assert warning == "mission.yaml does not name beams.npz, heading.csv, imu.csv.gz: left out"


def test_fixes_in_degrees_become_local(tmp_path: Path) -> None:
    text = csv(
        "t,lat_deg,lon_deg,h_m,sigma_n,sigma_e,sigma_d,vn,ve,vd", 42.001, 3.002, 7, 1, 2, 3, 4, 5, 6
    )
    folder = one_sensor_folder(tmp_path, "gnss", text)
    origin = Origin(42.0, 3.0, 5.0)
    described = (folder / "mission.yaml").read_text()
    (folder / "mission.yaml").write_text(
        described + "origin: {latitude_deg: 42.0, longitude_deg: 3.0, height_m: 5.0}\n"
    )
    mission = open_mission(folder)
    series = mission.sensors["x"].series
    assert isinstance(series, GnssSeries)
    assert mission.origin == origin
    np.testing.assert_array_equal(series.p_n[0], ned_from_geodetic(42.001, 3.002, 7.0, origin))
    assert 105 < series.p_n[0, 0] < 115
    assert 160 < series.p_n[0, 1] < 170
    np.testing.assert_array_equal(series.sigma[0], [1, 2, 3])
    assert series.v_n is not None
    np.testing.assert_array_equal(series.v_n[0], [4, 5, 6])


@pytest.mark.parametrize(
    "origin", ["", "origin: {latitude_deg: 42, longitude_deg: 3, height_m: 50}"]
)
@pytest.mark.parametrize(
    ("columns", "values"),
    [
        ("lat_deg,lon_deg", (42, 3)),
        ("lat_deg,lon_deg,h_m", (42, 3, "")),
        ("n,e,lat_deg,lon_deg", (7, 8, 42, 3)),
    ],
    ids=["none", "empty", "beside local ones"],
)
def test_fixes_without_heights_tell_north_and_east(
    tmp_path: Path, origin: str, columns: str, values: tuple[object, ...]
) -> None:
    text = csv(f"t,{columns},sigma_n,sigma_e,sigma_d", *values, 1, 2, 3)
    folder = one_sensor_folder(tmp_path, "gnss", text)
    with (folder / "mission.yaml").open("a") as described:
        described.write(origin)
    mission = open_mission(folder)
    series = mission.sensors["x"].series
    assert isinstance(series, GnssSeries)
    np.testing.assert_allclose(series.p_n[0], 0.0, atol=1e-9)
    np.testing.assert_array_equal(series.sigma[0], [1, 2, 100])
    assert any("x.csv have no heights" in warning for warning in mission.warnings)


def test_a_card_may_say_how_well_the_height_is_known(tmp_path: Path) -> None:
    text, noise = csv("t,lat_deg,lon_deg", 42, 3), {"sigma_vertical_m": 0.5}
    folder = one_sensor_folder(tmp_path, "gnss", text, noise=noise)
    series = open_mission(folder).sensors["x"].series
    assert isinstance(series, GnssSeries)
    assert series.sigma[0, 2] == 0.5


@pytest.mark.parametrize(
    ("fix", "line"),
    [
        ("114.2,3.5", "columns: {lat_deg: lon_deg, lon_deg: lat_deg}"),
        ("425000000,35000000", "scale: {lat_deg: 1.0e-7, lon_deg: 1.0e-7}"),
    ],
)
def test_fixes_off_the_globe_name_what_mends_them(tmp_path: Path, fix: str, line: str) -> None:
    text = f"t,lat_deg,lon_deg,h_m\n0,{fix},8\n1,{fix},8\n"
    left_out = open_mission(one_sensor_folder(tmp_path / "a", "gnss", text))
    assert any("'x' is left out" in w and line in w for w in left_out.warnings)
    card: dict[str, Any] = yaml.safe_load(line)
    mended = open_mission(one_sensor_folder(tmp_path / "b", "gnss", text, **card))
    assert len(mended.sensors["x"].series) == 2


def test_without_an_origin_the_first_fix_is_taken_and_said(tmp_path: Path) -> None:
    rows = ["t,lat_deg,lon_deg,h_m", "0,0,0,0", "1,95,3,0", "2,42.5,3.5,8", "3,42.6,3.5,8"]
    mission = open_mission(one_sensor_folder(tmp_path, "gnss", "\n".join(rows) + "\n"))
    series = mission.sensors["x"].series
    assert isinstance(series, GnssSeries)
    assert mission.origin == Origin(42.5, 3.5, 8.0)
    np.testing.assert_allclose(series.p_n[0], 0, atol=1e-6)
    assert any("states no origin" in w for w in mission.warnings)
    assert [(r.index, r.reason) for r in mission.rejections] == [
        (0, "no fix"),
        (1, "latitude or longitude out of range"),
    ]


def test_metres_need_no_origin(tmp_path: Path) -> None:
    mission = open_mission(one_sensor_folder(tmp_path, "gnss", csv("t,n,e,d", 1, 2, 3)))
    assert mission.origin is None
    assert mission.warnings == ()


def test_a_turned_compass_reads_as_the_body(tmp_path: Path) -> None:
    text = csv("t,heading_deg,sigma_deg", 170, 2)
    sensor = read_one(tmp_path, "heading", text, rpy_deg=[0, 0, -30])
    assert isinstance(sensor.series, HeadingSeries)
    np.testing.assert_allclose(np.degrees(sensor.series.heading), -160)
    np.testing.assert_allclose(np.degrees(sensor.series.sigma), 2)
    np.testing.assert_array_equal(sensor.R_bs, np.eye(3))


def test_a_heading_that_is_no_angle_is_not_wrapped_into_one(tmp_path: Path) -> None:
    text = csv("t,heading_deg", 10).replace("4,10", "4,65535")
    mission = open_mission(one_sensor_folder(tmp_path, "heading", text, rpy_deg=[0, 0, 5]))
    assert [(r.index, r.reason) for r in mission.rejections] == [(4, "implausible heading")]


def test_a_turned_attitude_sensor_reads_as_the_body(tmp_path: Path) -> None:
    R_nb = rotation_from_rpy([0.1, -0.2, 0.7])
    R_bs = rotation_from_rpy(np.radians([180.0, 5.0, 86.0]))
    roll, pitch, _ = np.degrees(rpy_from_rotation(R_nb @ R_bs))
    text = csv("t,roll_deg,pitch_deg", roll, pitch)
    sensor = read_one(tmp_path, "attitude", text, rpy_deg=[180, 5, 86])
    assert isinstance(sensor.series, AttitudeSeries)
    np.testing.assert_allclose(sensor.series.roll, 0.1)
    np.testing.assert_allclose(sensor.series.pitch, -0.2)


def test_landmarks_and_their_map(tmp_path: Path) -> None:
    rows = ["t,id,range_m,bearing_deg,elevation_deg,sigma_range,sigma_bearing_deg"]
    rows += [f"{k // 2},{k - 1},5.5,90,10,0.1,1" for k in TEN]
    files = {"l.csv": "\n".join(rows), "map.csv": "id,n,e,sigma\n4,1,2,0.1\n5,nan,2,0.1\n"}
    sensors = {
        "landmarks": {"file": "l.csv"},
        "buoys": {"type": "landmark_map", "file": "map.csv"},
    }
    mission = open_mission(make_folder(tmp_path, files, sensors))
    series = mission.sensors["landmarks"].series
    assert isinstance(series, LandmarkSeries)
    assert series.id[0] == -1
    np.testing.assert_allclose(series.bearing, np.pi / 2)
    assert series.elevation is not None
    np.testing.assert_allclose(np.degrees(series.elevation), 10)
    assert mission.landmark_map is not None
    np.testing.assert_array_equal(mission.landmark_map.id, [4])
    np.testing.assert_array_equal(mission.landmark_map.p_n, [[1, 2, 0]])
    assert any("1 unusable landmarks" in w for w in mission.warnings)


def test_ranges_alone_and_bearings_alone(tmp_path: Path) -> None:
    ranges = read_one(tmp_path / "r", "landmarks", csv("t,id,range_m,bearing_deg", 7, 5.5, "nan"))
    assert isinstance(ranges.series, LandmarkSeries)
    np.testing.assert_array_equal(ranges.series.range_m, 5.5)
    assert (ranges.series.bearing, ranges.series.sigma_bearing) == (None, None)
    text = csv("t,id,bearing_deg,elevation_deg,sigma_bearing_deg", 7, 180, 90, 45)
    bearings = read_one(tmp_path / "b", "landmarks", text)
    assert isinstance(bearings.series, LandmarkSeries)
    np.testing.assert_allclose(bearings.series.bearing, np.pi)
    np.testing.assert_allclose(bearings.series.sigma_bearing, np.pi / 4)
    np.testing.assert_allclose(bearings.series.elevation, np.pi / 2)
    assert (bearings.series.range_m, bearings.series.sigma_range) == (None, None)


def test_sightings_without_range_and_bearing(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"x\.csv:1: column 'range_m' or 'bearing_deg' is needed"):
        read_one(tmp_path / "a", "landmarks", csv("t,id,range", 7, 5.5))
    folder = one_sensor_folder(tmp_path / "b", "landmarks", csv("t,id,range_m", 7, "nan"))
    mission = open_mission(folder)
    assert list(mission.sensors) == ["always"]
    assert {r.reason for r in mission.rejections} == {"no range, no bearing"}


def test_a_range_without_its_bearing_is_rejected_where_others_have_one(tmp_path: Path) -> None:
    text = csv("t,id,range_m,bearing_deg", 7, 5.5, 20) + "10,7,5.5,nan\n"
    mission = open_mission(one_sensor_folder(tmp_path, "landmarks", text))
    assert [(r.index, r.reason) for r in mission.rejections] == [(10, "non-finite bearing")]


def test_the_attitude_of_a_turned_reference_is_the_body_s(tmp_path: Path) -> None:
    R_nb, R_bs = rotation_from_rpy([0.1, -0.2, 0.7]), rotation_from_rpy([0.0, 0.0, np.pi / 2])
    rpy_deg = np.degrees(rpy_from_rotation(R_nb @ R_bs))
    text = csv("t,n,e,d,roll_deg,pitch_deg,yaw_deg", 1, 2, 3, *rpy_deg)
    sensor = read_one(tmp_path, "reference", text, rpy_deg=[0, 0, 90])
    assert isinstance(sensor.series, ReferenceSeries)
    assert sensor.series.rpy is not None
    np.testing.assert_allclose(sensor.series.rpy, np.tile([0.1, -0.2, 0.7], (10, 1)))
    np.testing.assert_array_equal(sensor.R_bs, np.eye(3))


def test_a_reference_states_its_antenna_and_its_vertical(tmp_path: Path) -> None:
    text = csv("t,n,e,d,roll_deg,pitch_deg,yaw_deg,sigma", 1, 2, 3, 0, 0, 90, 0)
    sensor = read_one(tmp_path, "reference", text, xyz_m=[0, 0, -2], vertical_usable=False)
    assert isinstance(sensor.series, ReferenceSeries)
    np.testing.assert_array_equal(sensor.xyz_b, [0, 0, -2])
    assert not sensor.series.vertical_usable
    assert sensor.series.rpy is not None
    np.testing.assert_allclose(sensor.series.rpy[:, 2], np.pi / 2)
    np.testing.assert_array_equal(sensor.series.sigma, 0.0)


def test_two_of_a_type_are_two_names_and_gz_reads_as_it_is(tmp_path: Path) -> None:
    files = {"a.csv.gz": gzip.compress(DEPTH_CSV.encode()), "b.csv": DEPTH_CSV}
    sensors = {"depth": {"file": "a.csv.gz"}, "aft": {"type": "depth", "file": "b.csv"}}
    mission = open_mission(make_folder(tmp_path, files, sensors))
    assert [s.name for s in mission.of_type("depth")] == ["depth", "aft"]
    series = [s.series for s in mission.of_type("depth")]
    np.testing.assert_array_equal(series[0].t, series[1].t)


def two_depths(folder: Path, first: Any, second: Any, **offset: Any) -> Mission:
    def text(stamps: Any) -> str:
        return "t,depth_m,sigma\n" + "".join(f"{t!r},1,0.1\n" for t in stamps)

    files = {"a.csv": text(first), "b.csv": text(second)}
    sensors = {
        "a": {"type": "depth", "file": "a.csv"},
        "b": {"type": "depth", "file": "b.csv", **offset},
    }
    description = {"start_utc": "2024-05-17T09:30:00Z", "name": "two"}
    return open_mission(make_folder(folder, files, sensors, **description))


def test_time_zero_is_the_earliest_sample_after_offsets(tmp_path: Path) -> None:
    mission = two_depths(tmp_path, [100.0, 101.0], [110.0, 111.0], time_offset_s=-15.0)
    np.testing.assert_array_equal(mission.sensors["a"].series.t, [5, 6])
    np.testing.assert_array_equal(mission.sensors["b"].series.t, [0, 1])
    assert mission.start_utc == 1_715_938_200 + 95


def test_a_doubted_clock_is_moved_and_its_doubt_kept(tmp_path: Path) -> None:
    doubt = {"value_s": -15.0, "sigma_s": 0.2, "estimate": True}
    mission = two_depths(tmp_path, [100.0, 101.0], [110.0, 111.0], time_offset=doubt)
    np.testing.assert_array_equal(mission.sensors["b"].series.t, [0, 1])
    assert mission.sensors["b"].time_offset_sigma_s == 0.2
    assert mission.sensors["a"].time_offset_sigma_s == 0.0
    write_mission(mission, tmp_path / "copy")
    copy = open_mission(tmp_path / "copy")
    assert copy.sensors["b"].time_offset_sigma_s == 0.2
    np.testing.assert_array_equal(copy.sensors["b"].series.t, [0, 1])


@pytest.mark.parametrize(
    ("offset", "message"),
    [
        (
            {"time_offset_s": 1.0, "time_offset": {"estimate": True}},
            "time_offset_s or time_offset, not both",
        ),
        ({"time_offset": {"sigma_s": 0.0, "estimate": True}}, "time_offset.sigma_s"),
        ({"time_offset": {"guess": True}}, "unknown key 'guess'"),
    ],
)
def test_a_bad_time_offset_is_refused(tmp_path: Path, offset: dict[str, Any], message: str) -> None:
    with pytest.raises(DataError, match=message):
        two_depths(tmp_path, [0.0, 1.0], [0.0, 1.0], **offset)


def test_the_clock_jump_of_one_sensor_never_defines_zero(tmp_path: Path) -> None:
    mission = two_depths(
        tmp_path, [float(k) for k in range(9000, 9100)], [5.0, 6.0, *range(9000, 9100)]
    )
    assert mission.start_utc == 1_715_938_200 + 9000
    assert mission.sensors["b"].series.t[0] == 0
    assert [(r.sensor, r.index, r.reason, r.t) for r in mission.rejections] == [
        ("b", 0, "clock jump", -8995.0),
        ("b", 1, "clock jump", -8994.0),
    ]


def test_a_sensor_on_another_clock_is_left_out_and_named(tmp_path: Path) -> None:
    mission = two_depths(tmp_path, [float(k) for k in TEN], [1e9, 1e9 + 1])
    assert list(mission.sensors) == ["a"]
    assert any("'b'" in w and "never overlap" in w for w in mission.warnings)
    assert [r.reason for r in mission.rejections] == ["no overlap in time"] * 2


def test_a_sensor_that_ends_before_the_others_begin_is_named(tmp_path: Path) -> None:
    mission = two_depths(tmp_path, [0.0, 1.0], [20.0, 21.0])
    assert list(mission.sensors) == ["a", "b"]
    assert sum("never overlaps in time" in w for w in mission.warnings) == 2


def test_samples_out_of_order_are_sorted_and_said(tmp_path: Path) -> None:
    mission = two_depths(tmp_path, [0.0, 2.0, 1.0, 3.0], [0.0])
    np.testing.assert_array_equal(mission.sensors["a"].series.t, [0, 1, 2, 3])
    assert any("'a': 1 samples were out of order" in w for w in mission.warnings)


@pytest.mark.parametrize(
    ("start_utc", "expected"),
    [
        ("2024-05-17T09:30:00Z", 1_715_938_200),
        ("2024-05-17 11:30:00+02:00", 1_715_938_200),
        ("2024-05-17T09:30:00.5", 1_715_938_200.5),
        ("2024-05-17", 1_715_904_000),
        (1_715_938_200, 1_715_938_200),
    ],
)
@pytest.mark.parametrize("quoted", [True, False])
def test_start_utc_may_be_a_date_or_a_number(
    tmp_path: Path, start_utc: str | float, expected: float, quoted: bool
) -> None:
    folder = make_folder(tmp_path, {"d.csv": DEPTH_CSV}, {"depth": {"file": "d.csv"}})
    text = repr(start_utc) if quoted else str(start_utc)
    with (folder / "mission.yaml").open("a") as stream:
        stream.write(f"start_utc: {text}\n")
    assert open_mission(folder).start_utc == expected


def test_the_start_state_may_be_geodetic(tmp_path: Path) -> None:
    folder = make_folder(
        tmp_path,
        {"d.csv": DEPTH_CSV},
        {"depth": {"file": "d.csv"}},
        origin={"latitude_deg": 42.0, "longitude_deg": 3.0},
        initial={
            "position_geodetic": {"latitude_deg": 42.001, "longitude_deg": 3.0},
            "heading_deg": -90,
            "sigma_position_m": 4,
            "sigma_heading_deg": 10,
        },
    )
    initial = open_mission(folder).initial
    assert initial.p_n is not None
    np.testing.assert_allclose(initial.p_n, [111.1, 0, 0], atol=0.1)
    assert initial.heading == pytest.approx(-np.pi / 2)
    assert (initial.sigma_p, initial.sigma_heading) == (4, pytest.approx(np.radians(10)))


def test_simulated_sensors_inside_a_recorded_mission_are_labelled(tmp_path: Path) -> None:
    folder = tmp_path / "m"
    folder.mkdir()
    np.savez(
        folder / "s.npz",
        t=np.arange(3.0),
        angle=np.zeros(3),
        intensity=np.ones((3, 4), np.uint8),
        resolution_m=0.1,
    )
    sensors = {"sonar": {"type": "beams", "file": "s.npz", "simulated": True}}
    mission = open_mission(make_folder(folder, {}, sensors))
    assert mission.sonar_kind == "simulated"
    assert any("simulated sonar" in w for w in mission.warnings)


def test_progress_ends_at_one(tmp_path: Path) -> None:
    told: list[float] = []
    folder = make_folder(tmp_path, {"d.csv": DEPTH_CSV}, {"depth": {"file": "d.csv"}})
    open_mission(folder, lambda _stage, fraction: told.append(fraction))
    assert told == sorted(told)
    assert told[-1] == 1.0


def test_an_error_names_the_line_of_the_file(tmp_path: Path) -> None:
    text = csv("t,depth_m", 1.0).replace("4,1.0", "4,one")
    with pytest.raises(DataError, match=r"x\.csv:6: depth_m is 'one', not a number") as caught:
        open_mission(one_sensor_folder(tmp_path, "depth", text))
    assert caught.value.line == 6
