"""What is written reads back equal, and nothing half-written stays behind."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from missions import every_sensor_mission, every_series

from gtsam_nav.errors import DataError, OutputError
from gtsam_nav.frames import Origin, rotation_from_rpy
from gtsam_nav.mission import Mission, Rejection, Sensor
from gtsam_nav.readers import open_mission
from gtsam_nav.series import (
    CloudSeries,
    DepthSeries,
    ImuSeries,
    ReferenceSeries,
    ScanSeries,
    Series,
)
from gtsam_nav.writers.mission_folder import write_mission

GEODETIC_TOLERANCE_M = 1e-7
"""A step of a latitude in float64 is about a nanometre; the conversion adds a few."""


def assert_same_series(read: Series, written: Series, shift_s: float, tolerance: float) -> None:
    assert type(read) is type(written)
    np.testing.assert_allclose(read.t + shift_s, written.t, rtol=0, atol=1e-12)
    for name in written.column_specs():
        expected, actual = getattr(written, name), getattr(read, name)
        if expected is None or name in ("t", "row"):
            assert (actual is None) == (expected is None)
        else:
            np.testing.assert_allclose(actual, expected, rtol=1e-14, atol=tolerance, err_msg=name)
    if isinstance(written, ScanSeries):
        assert isinstance(read, ScanSeries)
        np.testing.assert_array_equal(read.first, written.first)
        np.testing.assert_array_equal(read.points_b, written.points_b)
    if isinstance(written, CloudSeries):
        assert isinstance(read, CloudSeries)
        for copy, original in zip(read.clouds, written.clouds, strict=True):
            assert isinstance(copy, Path)
            assert isinstance(original, Path)
            assert copy.read_bytes() == original.read_bytes()
    if isinstance(written, ReferenceSeries):
        assert isinstance(read, ReferenceSeries)
        assert read.vertical_usable == written.vertical_usable


def assert_same_mission(read: Mission, written: Mission) -> None:
    shift_s = min(float(s.series.t[0]) for s in written.sensors.values())
    assert list(read.sensors) == list(written.sensors)
    for name, sensor in written.sensors.items():
        copy = read.sensors[name]
        geodetic = sensor.type == "gnss" and written.origin is not None
        tolerance = GEODETIC_TOLERANCE_M if geodetic else 1e-15
        assert_same_series(copy.series, sensor.series, shift_s, tolerance)
        assert (copy.type, copy.noise, copy.simulated) == (
            sensor.type,
            sensor.noise,
            sensor.simulated,
        )
        np.testing.assert_array_equal(copy.xyz_b, sensor.xyz_b)
        np.testing.assert_allclose(copy.R_bs, sensor.R_bs, rtol=0, atol=1e-14)
    assert (read.name, read.origin) == (written.name, written.origin)
    assert read.constraints == written.constraints
    if written.start_utc is None:
        assert read.start_utc is None
    else:
        assert read.start_utc == written.start_utc + shift_s
    assert read.rejections == ()


def test_a_mission_with_every_sensor_reads_back_equal(tmp_path: Path) -> None:
    mission = every_sensor_mission(tmp_path)
    write_mission(mission, tmp_path / "out" / "mission")
    read = open_mission(tmp_path / "out" / "mission")
    assert_same_mission(read, mission)
    assert read.initial.p_n is not None
    assert mission.initial.p_n is not None
    np.testing.assert_array_equal(read.initial.p_n, mission.initial.p_n)
    assert read.initial.sigma_p == mission.initial.sigma_p
    assert read.initial.heading == pytest.approx(mission.initial.heading, rel=1e-15)
    assert read.initial.sigma_heading == pytest.approx(mission.initial.sigma_heading, rel=1e-15)
    assert read.landmark_map is not None
    assert mission.landmark_map is not None
    for name in ("id", "p_n", "sigma"):
        np.testing.assert_array_equal(
            getattr(read.landmark_map, name), getattr(mission.landmark_map, name)
        )


def test_points_of_scans_are_written_in_body_axes(tmp_path: Path) -> None:
    scans = Sensor("scans", "scans", every_series(tmp_path)["scans"], xyz_b=np.ones(3))
    write_mission(Mission("room", {"scans": scans}), tmp_path / "mission")
    read = open_mission(tmp_path / "mission").sensors["scans"].series
    assert_same_series(read, scans.series, 0.0, 1e-15)


def test_a_figure_may_be_none(tmp_path: Path) -> None:
    noise = {"sound_speed_m_s": None, "sigma_m_s": 0.02}
    dvl = Sensor("dvl", "dvl", every_series(tmp_path)["dvl"], noise=noise)
    write_mission(Mission("pool", {"dvl": dvl}), tmp_path / "mission")
    assert open_mission(tmp_path / "mission").sensors["dvl"].noise == noise


def test_what_the_source_lost_is_remembered(tmp_path: Path) -> None:
    depth = Sensor("depth", "depth", every_series(tmp_path)["depth"])
    lost = (
        Rejection(1.25, "depth", 7, "non-finite depth_m"),
        Rejection(float("nan"), "two\nlines, quoted", 0, "no stamp"),
    )
    write_mission(Mission("lossy", {"depth": depth}, rejections=lost), tmp_path / "mission")
    read = open_mission(tmp_path / "mission")
    shift_s = float(depth.series.t[0])
    assert read.rejections[0] == replace(lost[0], t=1.25 - shift_s)
    assert [r.sensor for r in read.rejections] == [r.sensor for r in lost]
    assert np.isnan(read.rejections[1].t)
    # again and again
    write_mission(read, tmp_path / "mission")
    assert open_mission(tmp_path / "mission").dropped == read.dropped
    (tmp_path / "mission" / "rejections.csv").write_text("t,sensor,index,reason\n1,depth,x,y\n")
    with pytest.raises(DataError, match=r"rejections\.csv:2: not a rejected sample"):
        open_mission(tmp_path / "mission")


def test_files_beside_those_of_a_mission_are_kept(tmp_path: Path) -> None:
    mission = Mission("m", {"depth": Sensor("depth", "depth", every_series(tmp_path)["depth"])})
    write_mission(mission, tmp_path / "mission")
    notes = tmp_path / "mission" / "depth" / "notes.txt"
    notes.parent.mkdir()
    notes.write_text("calibrated in May")
    with pytest.raises(OutputError, match="is no mission folder"):
        write_mission(mission, tmp_path / "mission")
    assert notes.read_text() == "calibrated in May"


@pytest.mark.parametrize("name", ["\x85", "a\u2028b", "\u2029", "P\xeache n\xb0 1", "two\nlines"])
def test_odd_names_survive(tmp_path: Path, name: str) -> None:
    mission = Mission(name, {name: Sensor(name, "depth", every_series(tmp_path)["depth"])})
    write_mission(mission, tmp_path / "mission")
    assert_same_mission(open_mission(tmp_path / "mission"), mission)


def test_a_ranger_stays_one(tmp_path: Path) -> None:
    series = every_series(tmp_path)["landmarks"]
    away = dict.fromkeys(("bearing", "sigma_bearing", "elevation"))
    mission = Mission("r", {"r": Sensor("r", "landmarks", replace(series, **away))})
    write_mission(mission, tmp_path / "mission")
    header = (tmp_path / "mission" / "r.csv").read_text().splitlines()[0]
    assert header == "t,id,range_m,sigma_range"
    assert_same_mission(open_mission(tmp_path / "mission"), mission)


def test_a_local_mission_keeps_its_fixes_in_metres(tmp_path: Path) -> None:
    series = every_series(tmp_path)["gnss"]
    mission = Mission(name="local", sensors={"g": Sensor("g", "gnss", series)})
    write_mission(mission, tmp_path / "mission")
    header = (tmp_path / "mission" / "g.csv").read_text().splitlines()[0]
    assert header == "t,n,e,d,sigma_n,sigma_e,sigma_d,vn,ve,vd"
    assert_same_mission(open_mission(tmp_path / "mission"), mission)


@pytest.mark.parametrize("pitch_deg", [90.0, -90.0, 89.999999])
def test_mountings_that_point_straight_up_survive(tmp_path: Path, pitch_deg: float) -> None:
    R_bs = rotation_from_rpy(np.radians([20.0, pitch_deg, 35.0]))
    series = every_series(tmp_path)["beams"]
    mission = Mission(name="up", sensors={"s": Sensor("s", "beams", series, R_bs=R_bs)})
    write_mission(mission, tmp_path / "mission")
    assert_same_mission(open_mission(tmp_path / "mission"), mission)


finite = st.floats(-1e3, 1e3)


@st.composite
def missions(draw: st.DrawFn) -> Mission:
    def sensor(name: str, sensor_type: str, series: Series) -> Sensor:
        return Sensor(
            name=name,
            type=sensor_type,
            series=series,
            xyz_b=np.array(draw(st.tuples(finite, finite, finite))),
            R_bs=rotation_from_rpy(draw(st.tuples(*[st.floats(-3.1, 3.1)] * 3))),
            simulated=draw(st.booleans()),
        )

    def stamps() -> Any:
        steps = draw(st.lists(st.floats(1e-3, 100.0), min_size=1, max_size=6))
        return draw(finite) + np.cumsum(steps)

    def table(n: int, k: int) -> Any:
        cells = st.lists(finite, min_size=k, max_size=k)
        return np.array(draw(st.lists(cells, min_size=n, max_size=n)))

    t_imu, t_depth, t_truth = stamps(), stamps(), stamps()
    imu = table(len(t_imu), 6)
    sensors = [
        sensor(
            draw(st.text(min_size=1, max_size=8)),
            "imu",
            ImuSeries(t=t_imu, gyro_i=imu[:, :3] / 10, accel_i=imu[:, 3:]),
        ),
        sensor(
            "depth",
            "depth",
            DepthSeries(
                t=t_depth,
                depth_m=np.abs(table(len(t_depth), 1)[:, 0]),
                sigma=np.full(len(t_depth), draw(st.floats(1e-6, 1e3))),
            ),
        ),
        sensor("truth", "reference", ReferenceSeries(t=t_truth, p_n=table(len(t_truth), 3))),
    ]
    origin = draw(st.none() | st.builds(Origin, st.floats(-90, 90), st.floats(-180, 360), finite))
    return Mission(
        name=draw(st.text(min_size=1, max_size=20)),
        sensors={s.name: s for s in sensors},
        origin=origin,
        start_utc=draw(st.none() | st.floats(0, 2e9)),
    )


@settings(max_examples=40)
@given(mission=missions())
def test_any_mission_reads_back_equal(
    mission: Mission, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("round_trip") / "mission"
    write_mission(mission, folder)
    assert_same_mission(open_mission(folder), mission)


def test_the_same_mission_gives_the_same_bytes(tmp_path: Path) -> None:
    mission = every_sensor_mission(tmp_path)
    write_mission(mission, tmp_path / "a")
    write_mission(mission, tmp_path / "b")
    files = sorted(p.relative_to(tmp_path / "a") for p in (tmp_path / "a").rglob("*.*"))
    assert len(files) > 12
    for name in files:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes(), name


def test_an_earlier_mission_is_replaced_whole(tmp_path: Path) -> None:
    mission = every_sensor_mission(tmp_path)
    write_mission(mission, tmp_path / "mission")
    write_mission(mission.without("beams", "clouds"), tmp_path / "mission")
    names = {p.name for p in (tmp_path / "mission").iterdir()}
    assert {"beams.npz", "clouds", "clouds.csv"}.isdisjoint(names)
    assert [p for p in tmp_path.iterdir() if p.name.startswith(".")] == []


@pytest.mark.parametrize("other", ["notes.txt", "clouds/notes/deep.txt"])
def test_a_folder_with_anything_else_is_left_alone(tmp_path: Path, other: str) -> None:
    mission = every_sensor_mission(tmp_path)
    write_mission(mission, tmp_path / "mission")
    foreign = tmp_path / "mission" / other
    foreign.parent.mkdir(parents=True, exist_ok=True)
    foreign.write_text("mine")
    with pytest.raises(OutputError, match="no mission folder"):
        write_mission(mission, tmp_path / "mission")
    assert foreign.read_text() == "mine"


def test_a_file_in_the_way_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "mission").write_text("a file")
    with pytest.raises(OutputError, match="no mission folder"):
        write_mission(every_sensor_mission(tmp_path), tmp_path / "mission")
    with pytest.raises(OutputError, match="cannot be written"):
        write_mission(every_sensor_mission(tmp_path), tmp_path / "mission" / "below")


def test_a_failure_leaves_nothing_behind(tmp_path: Path) -> None:
    mission = every_sensor_mission(tmp_path)
    clouds = mission.sensors["clouds"]
    assert isinstance(clouds.series, CloudSeries)
    gone = replace(clouds.series, clouds=(tmp_path / "gone.npy",) * 3)
    (tmp_path / "out").mkdir()
    with pytest.raises(OutputError, match=r"gone\.npy"):
        write_mission(
            mission.with_sensor(replace(clouds, series=gone)), tmp_path / "out" / "mission"
        )
    assert list((tmp_path / "out").iterdir()) == []
