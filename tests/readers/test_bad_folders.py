"""Bad mission folders end in a clear error or in a degradation that the mission records."""

from __future__ import annotations

import gzip
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from missions import DEPTH_CSV, every_sensor_mission, make_folder, one_sensor_folder

from gtsam_nav.errors import DataError, GtsamNavError
from gtsam_nav.readers import _bytes, open_mission
from gtsam_nav.series import DepthSeries
from gtsam_nav.writers.mission_folder import write_mission


def depth_folder(folder: Path, text: str | bytes) -> Path:
    return one_sensor_folder(folder, "depth", text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "the file is empty"),
        ("\n\n", "the file is empty"),
        ("t,sigma\n0,1\n", "column 'depth_m' is missing; needed are t, depth_m"),
        ("0,1.0,0.1\n1,1.0,0.1\n", "column 't' is missing"),
        ("t;depth_m\n0;1\n", "names t;depth_m: the fields must be separated by commas"),
        ("t\tdepth_m\n0\t1\n", ": the fields must be separated by commas"),
        ("t depth_m\n0 1\n", ": the fields must be separated by commas"),
        ('"t","depth_m"\n"0","1"\n', ": without quotation marks"),
        ("T,Depth_m\n0,1\n", "the header names T, Depth_m: capitals are other letters"),
        ("# depths\nt,depth_m\n0,1\n", "the first line must be the header, and no comment"),
        ("0,1.0\n1,1.0\n", "these are numbers, a header is missing"),
        ("t,depth_m\n2024-05-17T09:30:00,1\n1,1\n", "not a number: stamps are seconds, not dates"),
        ("t,depth_m,t\n0,1,2\n", "column 't' is named twice"),
        ("t,depth_m\n0,1\n1,2,3\n2,1\n", "x.csv:3: 3 fields where 2 are needed"),
        ("t,depth_m\n0,1\n1\n2,1\n", "x.csv:3: 1 fields where 2 are needed"),
        ("t,depth_m\n0;1\n1;2\n2;3\n", "x.csv:2: 1 fields where 2 are needed"),
        ("t,depth_m\n0,1\nx,2\n1,1\n", "x.csv:3: t is 'x', not a number"),
        (b"t,depth_m\n\xff\xfe,1\n1,1\n", "x.csv:2: is not utf-8 text"),
        (b"t,\tdepth_m\n0,1\n1,\xb01\n2,\t1\n3,\t1\n", "x.csv:3: is not utf-8 text"),
        (
            gzip.compress(DEPTH_CSV.encode(), mtime=0)[:12],
            "the archive is cut off within",
        ),
        (b"\x1f\x8bnot gzip at all", "the gzip archive is damaged"),
    ],
)
def test_a_malformed_file_is_an_error_that_names_it(
    tmp_path: Path, text: str | bytes, message: str
) -> None:
    with pytest.raises(DataError) as caught:
        open_mission(depth_folder(tmp_path, text))
    assert message in str(caught.value)
    assert "x.csv" in str(caught.value)


def test_an_archive_that_is_cut_off_is_read_as_far_as_it_goes(tmp_path: Path) -> None:
    rows = [f"{0.1 * k:.1f},{np.random.default_rng(k).uniform():.6f}" for k in range(5000)]
    packed = gzip.compress("\n".join(["t,depth_m", *rows, ""]).encode())
    mission = open_mission(depth_folder(tmp_path, packed[: len(packed) // 2]))
    depth = mission.sensors["x"].series
    assert isinstance(depth, DepthSeries)
    assert 1000 < len(depth) < 4000
    assert depth.depth_m.tolist() == [float(row.split(",")[1]) for row in rows[: len(depth)]]
    assert any("the archive is cut off there" in warning for warning in mission.warnings)


def test_garbage_at_the_end_costs_no_good_line_behind_a_byte_order_mark(tmp_path: Path) -> None:
    text = b"\xef\xbb\xbft,depth_m\n0,1\n1,1\n2,1\n\xff\xfe\x00\n"
    mission = open_mission(depth_folder(tmp_path, text))
    assert len(mission.sensors["x"].series) == 3
    assert any("x.csv:5: the last line is damaged" in w for w in mission.warnings)


def test_what_is_not_finite_in_a_vector_is_named_as_the_file_names_it(tmp_path: Path) -> None:
    text = "t,vx,vy,vz\n0,1,nan,0\n1,nan,inf,nan\n2,1,0,nan\n3,1,0,0\n"
    mission = open_mission(one_sensor_folder(tmp_path, "dvl", text))
    reasons = [r.reason for r in mission.rejections]
    assert reasons == ["non-finite vy", "non-finite v_d", "non-finite vz"]


@pytest.mark.parametrize(
    ("text", "reasons"),
    [
        ("t,depth_m\n", []),
        ("t,depth_m\nnan,1\n1,nan\n2,inf\n", ["non-finite t"] + ["non-finite depth_m"] * 2),
        ("t,depth_m\n,\n", ["non-finite t"]),
        ("t,depth_m,sigma\n0,1,-1\n1,1,-1\n", ["implausible sigma"] * 2),
    ],
)
def test_a_sensor_without_a_valid_sample_is_left_out_and_said(
    tmp_path: Path, text: str, reasons: list[str]
) -> None:
    mission = open_mission(depth_folder(tmp_path, text))
    assert list(mission.sensors) == ["always"]
    assert any("sensor 'x' is left out" in w for w in mission.warnings)
    assert [r.reason for r in mission.rejections] == reasons
    assert {r.sensor for r in mission.rejections} <= {"x"}


def test_the_commonest_reason_is_given_for_a_sensor_that_is_left_out(tmp_path: Path) -> None:
    text = "t,depth_m,sigma\n0,1,-1\n1,1,-1\nnan,1,1\n"
    (warning,) = open_mission(depth_folder(tmp_path, text)).warnings
    assert "(3 dropped, mostly for: implausible sigma)" in warning


@pytest.mark.parametrize(
    ("kind", "text", "usual"),
    [
        ("gnss", "t,n,e,d,sigma_n,sigma_e,sigma_d\n0,1,2,0,0,0,0\n1,2,2,0,0,0,0\n", [1.5, 1.5, 3]),
        ("gnss", "t,n,e,d,sigma_n,sigma_e,sigma_d\n0,1,2,0,2,2,0\n1,2,2,0,2,2,0\n", [2, 2, 3]),
        ("depth", "t,depth_m,sigma\n0,1,0\n1,1,0\n", 0.1),
        ("heading", "t,heading_deg,sigma_deg\n0,1,0\n1,1,0\n", np.radians(0.5)),
        ("attitude", "t,roll_deg,pitch_deg,sigma_deg\n0,1,0,0\n1,1,0,0\n", np.radians(0.5)),
        ("dvl", "t,vx,vy,vz,sigma,valid\n0,1,0,0,0,1\n1,1,0,0,0,1\n", 0.05),
    ],
)
def test_sigmas_of_zero_throughout_are_the_cards(
    tmp_path: Path, kind: str, text: str, usual: Any
) -> None:
    mission = open_mission(one_sensor_folder(tmp_path, kind, text))
    assert not mission.rejections
    series: Any = mission.sensors["x"].series
    np.testing.assert_allclose(series.sigma, np.broadcast_to(usual, series.sigma.shape))
    (warning,) = mission.warnings
    assert "of zero throughout: the noise figures serve instead (sigma" in warning


def test_the_same_of_odometry_and_sightings(tmp_path: Path) -> None:
    odometry = "t,vx,vy,wz,sigma_v,sigma_w\n0,1,0,0,0,0.1\n1,1,0,0,0,0.1\n"
    seen = "t,id,range_m,bearing_deg,sigma_range,sigma_bearing_deg\n0,1,5,9,0,0\n1,1,5,8,0,0\n"
    moved: Any = open_mission(one_sensor_folder(tmp_path / "a", "odometry", odometry))
    assert (moved.sensors["x"].series.sigma_v == 0.1).all()
    sighted: Any = open_mission(one_sensor_folder(tmp_path / "b", "landmarks", seen))
    assert (sighted.sensors["x"].series.sigma_range == 0.5).all()
    np.testing.assert_allclose(sighted.sensors["x"].series.sigma_bearing, np.radians(2.0))


def test_a_sigma_of_zero_among_others_is_a_rejection(tmp_path: Path) -> None:
    mission = open_mission(depth_folder(tmp_path, "t,depth_m,sigma\n0,1,0\n1,1,0.1\n"))
    assert [r.reason for r in mission.rejections] == ["implausible sigma"]


@pytest.mark.parametrize("text", ["t,depth_m\n", "t,depth_m\nnan,1\n"])
def test_a_mission_without_any_usable_sensor_is_an_error(tmp_path: Path, text: str) -> None:
    folder = make_folder(tmp_path, {"d.csv": text}, {"depth": {"file": "d.csv"}})
    with pytest.raises(DataError, match=r"no usable sensor.*'depth' is left out"):
        open_mission(folder)


def test_a_reference_alone_is_no_mission(tmp_path: Path) -> None:
    folder = make_folder(
        tmp_path, {"r.csv": "t,n,e,d\n0,0,0,0\n"}, {"reference": {"file": "r.csv"}}
    )
    with pytest.raises(DataError, match="no usable sensor"):
        open_mission(folder)


@pytest.mark.parametrize(
    ("last_line", "stamp"), [("10,1.5", 10.0), ("10,1.5,", 10.0), ("1", np.nan), ("10,1\n", 10.0)]
)
def test_a_last_line_that_was_cut_off_is_dropped_with_its_reason(
    tmp_path: Path, last_line: str, stamp: float
) -> None:
    mission = open_mission(depth_folder(tmp_path, DEPTH_CSV + last_line))
    assert len(mission.sensors["x"].series) == 10
    (rejection,) = mission.rejections
    expected = "non-finite sigma" if last_line.endswith(",") else "truncated line"
    assert (rejection.sensor, rejection.index, rejection.reason) == ("x", 10, expected)
    np.testing.assert_equal(rejection.t, stamp)


def test_a_number_that_was_cut_off_is_a_cut_line(tmp_path: Path) -> None:
    mission = open_mission(depth_folder(tmp_path, DEPTH_CSV + "10,1.5,1e-"))
    assert [r.reason for r in mission.rejections] == ["truncated line"]


@pytest.mark.parametrize(
    "end",
    [
        *(b"10,1.5,0.1xx\n", b"10,1.5,0.1,7,8\n", b"Segmentation fault\n", b"10,1.", b"1,x,0.1\n"),
        *(b"\xff\xfe\x01\x80", b"10,1\xff\n\xfe\n\x80\n", b"\0" * 512, b"10,1.5" + b"\0" * 512),
    ],
)
def test_whatever_a_loss_of_power_leaves_at_the_end_is_left_out(tmp_path: Path, end: bytes) -> None:
    mission = open_mission(depth_folder(tmp_path, DEPTH_CSV.encode() + end))
    assert len(mission.sensors["x"].series) == 10
    assert [(r.index, r.reason) for r in mission.rejections] == [(10, "truncated line")]
    assert any("x.csv:12: the last line is damaged" in w for w in mission.warnings)


@pytest.mark.parametrize(
    "damage", [b"x,1,0.1\n", b"1\n", b"\xff\xfe\n", b"\xff\xfe\x80", b"\0" * 9]
)
def test_damage_in_the_middle_is_refused_with_its_line(tmp_path: Path, damage: bytes) -> None:
    text = DEPTH_CSV.encode()
    middle = text.index(b"\n5") + 1
    with pytest.raises(DataError, match=r"x\.csv:7: "):
        open_mission(depth_folder(tmp_path, text[:middle] + damage + text[middle:]))


def test_a_last_line_without_its_break_counts(tmp_path: Path) -> None:
    mission = open_mission(depth_folder(tmp_path, DEPTH_CSV + "10,1.5,0.1"))
    assert len(mission.sensors["x"].series) == 11
    assert mission.rejections == ()


def test_a_dvl_without_a_single_valid_sample_is_left_out(tmp_path: Path) -> None:
    text = "t,vx,vy,vz,sigma,valid\n" + "".join(f"{k},nan,nan,nan,nan,0\n" for k in range(5))
    mission = open_mission(one_sensor_folder(tmp_path, "dvl", text))
    assert list(mission.sensors) == ["always"]
    assert [r.reason for r in mission.rejections] == ["no valid sample"] * 5
    assert any("sensor 'x' is left out" in w for w in mission.warnings)


@pytest.mark.parametrize(
    "name", ["../d.csv", "/etc/hostname", "link.csv", "a/../../d.csv", "x\0y", "y" * 5000]
)
def test_no_path_leaves_the_folder(tmp_path: Path, name: str) -> None:
    (tmp_path / "d.csv").write_text(DEPTH_CSV)
    folder = make_folder(tmp_path / "mission", {}, {"depth": {"file": name}})
    (folder / "link.csv").symlink_to(tmp_path / "d.csv")
    with pytest.raises(DataError, match=r"leads out of the mission folder|no name of a file"):
        open_mission(folder)


def test_clouds_do_not_leave_the_folder_either(tmp_path: Path) -> None:
    np.save(tmp_path / "cloud.npy", np.zeros((2, 3)))
    files = {"clouds.csv": "t,file\n0,../cloud.npy\n", "d.csv": DEPTH_CSV}
    sensors = {"clouds": {"file": "clouds.csv"}, "depth": {"file": "d.csv"}}
    with pytest.raises(DataError, match="leads out of the mission folder"):
        open_mission(make_folder(tmp_path / "mission", files, sensors))


def test_a_cloud_that_is_missing_is_rejected(tmp_path: Path) -> None:
    files = {
        "clouds.csv": "t,file\n0,here.npy\n1,gone.npy\n2,",
        "here.npy": b"",
        "d.csv": DEPTH_CSV,
    }
    sensors = {"clouds": {"file": "clouds.csv"}, "depth": {"file": "d.csv"}}
    mission = open_mission(make_folder(tmp_path, files, sensors))
    assert len(mission.sensors["clouds"].series) == 1
    assert [(r.index, r.reason) for r in mission.rejections] == [
        (1, "missing file"),
        (2, "truncated line"),
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "must be a map with the keys name, origin, start_utc, initial, constraints, sensors"),
        ("[1, 2]", "must be a map"),
        ("sensors: {depth: {file: d.csv}", "mission.yaml:1: not YAML"),
        ("a: b: c", "mission.yaml:1: not YAML"),
        ("sensors: {}", "sensors: {} must hold at least 1"),
        ("name: x", "sensors: is missing"),
        ("sensors: {depth: {file: d.csv}}\nsensor: 1", "unknown key 'sensor'; the choices are"),
        (
            "sensors: {depth: {file: d.csv, xyz: [0, 0, 0]}}",
            "sensors.depth: unknown key 'xyz'; the choices are: type, xyz_m, rpy_deg",
        ),
        ("sensors: {bow: {file: d.csv}}", "sensors.bow: unknown sensor type 'bow'; the choices"),
        ("sensors: {depth: {file: gone.csv}}", "file 'gone.csv' is missing"),
        ("sensors: {depth: d.csv}", 'sensors.depth: "d.csv" stands where a map of keys belongs'),
        ("sensors: {depth: {}}", "sensors.depth.file: is missing"),
        ("sensors: {depth: {file: d.csv, xyz_m: [0, 0]}}", "sensors.depth.xyz_m"),
        ("sensors: {depth: {file: d.csv, xyz_m: [0, 0, .nan]}}", "sensors.depth.xyz_m.2"),
        (
            "sensors: {depth: {file: d.csv, noise: {sigma: 1}}}",
            "sensors.depth: noise.sigma: unknown; the choices are: sigma_m",
        ),
        (
            "sensors: {imu: {file: d.csv, noise: {gyro_noise_density_deg_sqrth: 0.3}}}",
            "gyro_noise_density_rad_s_sqrt_hz, gyro_noise_density_deg_sqrt_h,"
            " gyro_noise_density_deg_s_sqrt_hz, accel_noise_density_m_s2_sqrt_hz,",
        ),
        (
            "sensors: {imu: {file: d.csv, noise: {accel_bias_sigma_mg: 1,"
            " accel_bias_sigma_ug: 2}}}",
            "noise: give one of accel_bias_sigma_ug and accel_bias_sigma_mg",
        ),
        (
            "sensors: {depth: {file: d.csv, noise: {sigma_m: -1}}}",
            "sensors.depth: noise.sigma_m: -1 must be above 0",
        ),
        (
            "sensors: {depth: {file: d.csv}, depth: {file: e.csv}}",
            "the key 'depth' is given twice",
        ),
        (
            "sensors: {depth: {file: d.csv}}\norigin: {latitude_deg: 91, longitude_deg: 0}",
            "origin.latitude_deg",
        ),
        (
            "sensors: {depth: {file: d.csv}}\ninitial: {heading: 1}",
            "initial: unknown key 'heading'; the choices are: position_ned_m, position_geodetic",
        ),
        (
            "sensors: {depth: {file: d.csv}}\n"
            "initial: {position_geodetic: {latitude_deg: 1, longitude_deg: 2}}",
            "initial.position_geodetic needs an origin",
        ),
        ("sensors: {depth: {file: d.csv}}\nstart_utc: soon", "start_utc"),
        ("sensors: {depth: {file: d.csv}}\nname: !!python/name:os.system", "not YAML"),
        ("x: !!timestamp nonsense", "not readable as YAML"),
        ("[" * 600, "not readable as YAML"),
    ],
)
def test_a_bad_description_names_the_file_the_key_and_the_choices(
    tmp_path: Path, text: str, message: str
) -> None:
    (tmp_path / "d.csv").write_text(DEPTH_CSV)
    (tmp_path / "mission.yaml").write_text(text)
    with pytest.raises(DataError) as caught:
        open_mission(tmp_path)
    assert message in str(caught.value)
    assert str(tmp_path) in str(caught.value)


def test_yaml_may_share_what_sensors_have_in_common(tmp_path: Path) -> None:
    (tmp_path / "d.csv").write_text(DEPTH_CSV)
    (tmp_path / "mission.yaml").write_text(
        "sensors:\n"
        "  depth: &depth {file: d.csv, xyz_m: [1, 2, 3]}\n"
        "  spare: {<<: *depth, type: depth}\n"
    )
    np.testing.assert_array_equal(open_mission(tmp_path).sensors["spare"].xyz_b, [1, 2, 3])


def test_an_archive_that_unpacks_without_end_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(_bytes, "MAX_BYTES", 1_000_000)
    bomb = gzip.compress(b"t,depth_m\n" + b"0" * 50_000_000)
    with pytest.raises(DataError, match="holds more than 1000000 bytes"):
        open_mission(depth_folder(tmp_path, bomb))


def beams(**changes: Any) -> dict[str, Any]:
    good = {
        "t": np.arange(4.0),
        "angle": np.zeros(4),
        "intensity": np.zeros((4, 3), np.uint8),
        "resolution_m": np.array(0.1),
    }
    return {name: a for name, a in {**good, **changes}.items() if a is not None}


@pytest.mark.parametrize(
    ("sensor_type", "arrays", "message"),
    [
        ("beams", beams(angle=None), "array 'angle' is missing"),
        ("beams", beams(angle=np.zeros(3)), "do not fit"),
        ("beams", beams(t=np.zeros((4, 1))), "do not fit"),
        ("beams", beams(intensity=np.zeros((4, 3))), "uint8 is needed"),
        ("beams", beams(resolution_m=np.array(-1.0)), "one positive number"),
        ("beams", beams(t=np.array(["a"] * 4)), "not numbers"),
        ("beams", beams(t=np.array([{}] * 4)), "not a readable .npz archive"),
        ("scans", {"t": np.arange(2.0), "first": np.array([0, 5]), "points": np.zeros((5, 2))},
         "one rising offset a scan"),
        ("scans", {"t": np.arange(1.0), "first": np.array([0, 4]), "points": np.zeros((5, 2))},
         "as first says"),
    ],
)  # fmt: skip
def test_archives_that_do_not_fit_are_errors(
    tmp_path: Path, sensor_type: str, arrays: dict[str, Any], message: str
) -> None:
    np.savez(tmp_path / "x.npz", **arrays)
    sensors = {"x": {"type": sensor_type, "file": "x.npz"}, "depth": {"file": "d.csv"}}
    with pytest.raises(DataError) as caught:
        open_mission(make_folder(tmp_path, {"d.csv": DEPTH_CSV}, sensors))
    assert message in str(caught.value)


def test_bad_beams_and_scans_are_dropped_one_by_one(tmp_path: Path) -> None:
    np.savez(tmp_path / "b.npz", **beams(t=np.array([0.0, np.nan, 2.0, 2.0])))
    points = np.zeros((5, 2))
    points[3] = np.nan
    np.savez(tmp_path / "s.npz", t=np.arange(3.0), first=np.array([0, 2, 4, 5]), points=points)
    sensors = {"beams": {"file": "b.npz"}, "scans": {"file": "s.npz"}}
    mission = open_mission(make_folder(tmp_path, {}, sensors))
    assert len(mission.sensors["beams"].series) == 2
    assert len(mission.sensors["scans"].series) == 2
    assert sorted((r.sensor, r.index, r.reason) for r in mission.rejections) == [
        ("beams", 1, "non-finite t"),
        ("beams", 3, "repeated sample"),
        ("scans", 1, "non-finite points"),
    ]


def test_ids_and_flags_are_whole_numbers(tmp_path: Path) -> None:
    text = "t,id,range_m,bearing_deg\n0,1,5,0\n1,1.5,5,0\n"
    mission = open_mission(one_sensor_folder(tmp_path, "landmarks", text))
    assert [(r.index, r.reason) for r in mission.rejections] == [(1, "fractional id")]


@pytest.fixture(scope="module")
def good_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("good")
    write_mission(every_sensor_mission(place), place / "mission")
    return place / "mission"


def opened_or_refused(folder: Path) -> None:
    with suppress(GtsamNavError):
        assert open_mission(folder).sensors


@settings(max_examples=40)
@given(data=st.data())
def test_damaged_files_never_crash_the_reader(good_folder: Path, data: st.DataObject) -> None:
    """Cut off, with flipped bits, or with a piece that repeats."""
    files = sorted(p for p in good_folder.rglob("*") if p.is_file())
    path = data.draw(st.sampled_from(files))
    whole = path.read_bytes()
    damaged = bytearray(whole)
    place = data.draw(st.integers(0, len(whole) - 1))
    damage = data.draw(st.sampled_from(["cut", "flip", "repeat", "swap"]))
    if damage == "cut":
        del damaged[place:]
    elif damage == "flip":
        for _ in range(data.draw(st.integers(1, 5))):
            damaged[data.draw(st.integers(0, len(whole) - 1))] ^= 1 << data.draw(st.integers(0, 7))
    elif damage == "repeat":
        damaged[place:place] = whole[: data.draw(st.integers(0, 200))]
    else:
        damaged[place : place + 1] = data.draw(st.binary(max_size=6))
    try:
        path.write_bytes(damaged)
        opened_or_refused(good_folder)
    finally:
        path.write_bytes(whole)


cells = st.one_of(
    st.floats().map(repr),
    st.integers(-5, 5).map(str),
    st.sampled_from(
        ["", "nan", "bottom", "water", "1e400", "-inf", "0x1", "1_0", " 2 ", "ü", "\0"]
    ),
)
HEADERS = {
    "dvl": "t,vx,vy,vz,sigma,valid,lock,altitude",
    "gnss": "t,lat_deg,lon_deg,h_m,sigma_n,sigma_e,sigma_d",
    "landmarks": "t,id,range_m,bearing_deg,elevation_deg",
    "attitude": "t,roll_deg,pitch_deg,sigma_deg",
    "odometry": "t,vx,vy,wz",
    "reference": "t,n,e,d,sigma",
    "clouds": "t,file",
    "landmark_map": "id,n,e,sigma",
}


@settings(max_examples=60)
@given(
    sensor_type=st.sampled_from(sorted(HEADERS)),
    rows=st.lists(st.lists(cells, min_size=1, max_size=8), max_size=8),
    fitting=st.booleans(),
    offset=st.sampled_from([0.0, 1e9, -1e-7]),
)
def test_invented_files_never_crash_the_reader(
    tmp_path: Path, sensor_type: str, rows: list[list[str]], fitting: bool, offset: float
) -> None:
    header = HEADERS[sensor_type]
    width = header.count(",") + 1
    if fitting:
        rows = [(row * width)[:width] for row in rows]
    text = "\n".join([header, *(",".join(row) for row in rows)])
    opened_or_refused(one_sensor_folder(tmp_path, sensor_type, text, time_offset_s=offset))


@settings(max_examples=40)
@given(text=st.text(max_size=60) | st.binary(max_size=60))
def test_invented_descriptions_never_crash_the_reader(tmp_path: Path, text: str | bytes) -> None:
    contents = text if isinstance(text, bytes) else text.encode("utf-8", "surrogatepass")
    (tmp_path / "mission.yaml").write_bytes(contents)
    opened_or_refused(tmp_path)


def test_fixes_without_a_longitude_lack_it_and_no_local_coordinates(tmp_path: Path) -> None:
    folder = one_sensor_folder(tmp_path, "gnss", "t,lat_deg,h_m\n0,42,3\n")
    with pytest.raises(DataError, match="column 'lon_deg' is missing"):
        open_mission(folder)
