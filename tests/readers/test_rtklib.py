"""RTKLIB positions with an IMU's log: invented ones with round numbers, and the recorded drive."""

from __future__ import annotations

import gzip
import struct
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gtsam_nav.cards import load_card
from gtsam_nav.errors import DataError, GtsamNavError
from gtsam_nav.frames import ned_from_geodetic, rotation_from_rpy
from gtsam_nav.mission import Mission
from gtsam_nav.readers import open_mission
from gtsam_nav.sensors.noise import GnssNoise
from gtsam_nav.series import GnssSeries, ImuSeries

GPST = 1_752_003_258.0  # 2025/07/08 19:34:18
CLOCK_OFFSET_S = load_card("rtk_mems_car").sensors["imu"].time_offset_s

HEADER = (
    "% program   : RTKLIB\n"
    "%  GPST            latitude(deg) longitude(deg) height(m) Q ns sdn(m) sde(m) sdu(m) sdne(m)"
    " sdeu(m) sdun(m) age(s) ratio vn(m/s) ve(m/s) vu(m/s) sdvn sdve sdvu sdvne sdveu sdvun\n"
)
PLAIN = HEADER[: HEADER.index(" vn(m/s)")] + "\n"


def epoch(
    k: int,
    *,
    stamp: str | None = None,
    latitude: str = "40.0",
    quality: str = "1",
    sigma: str = "0.02 0.03 0.05",
    velocity: str | None = "1.0 2.0 3.0",
) -> str:
    when = stamp or f"2025/07/08 19:34:{18 + k}.500"
    line = f"{when} {latitude} -105.0 1600.0 {quality} 21 {sigma} 0 0 0 0 0"
    return line if velocity is None else f"{line} {velocity} 0.05 0.05 0.05 0 0 0"


POS = HEADER + "".join(epoch(k) + "\n" for k in range(6))


def imu_line(k: int) -> str:
    return f"0.5,0.0,1.0,90.0,0.0,-180.0,{1000 + 100 * k}"


CSV = "".join(imu_line(k) + "\n" for k in range(51))


def time_tag(
    ticks: tuple[int, ...] = (131, 200, 5131), *, start: float = GPST + 0.25, n_header: int = 60
) -> bytes:
    header = b"TIMETAG RTKLIB demo5".ljust(n_header, b"\0")
    begin = struct.pack("<IId", 77, int(start), start % 1)
    return header + begin + b"".join(struct.pack("<II", tick, 10 * tick) for tick in ticks)


GOOD: dict[str, str | bytes] = {
    "drive_gnss_7.pos": POS,
    "drive_imu_7.csv": CSV,
    "drive_imu_7.csv.tag": time_tag(),
}


def log(folder: Path, changes: dict[str, str | bytes | None] | None = None) -> Path:
    """A folder with a good drive, but for what is changed; None leaves a file out."""
    folder.mkdir(parents=True, exist_ok=True)
    contents: dict[str, str | bytes | None] = {**GOOD, **(changes or {})}
    for name, text in contents.items():
        if text is not None:
            (folder / name).write_bytes(text if isinstance(text, bytes) else text.encode())
    return folder


def fixes(mission: Mission) -> GnssSeries:
    series = mission.sensors["gnss"].series
    assert isinstance(series, GnssSeries)
    return series


def gps_time(mission: Mission, t: float) -> float:
    """GPS time of a mission time; 18 s ahead of UTC in 2025."""
    assert mission.start_utc is not None
    return mission.start_utc + 18.0 + t


def test_the_time_tag_stamps_the_imu(tmp_path: Path) -> None:
    """The first sample comes at the first tick, the last at the last."""
    mission = open_mission(log(tmp_path))
    imu = mission.sensors["imu"].series
    assert isinstance(imu, ImuSeries)
    first = GPST + 0.25 + 0.131 + CLOCK_OFFSET_S
    assert gps_time(mission, imu.t[0]) == pytest.approx(first, abs=1e-6)
    assert gps_time(mission, imu.t[-1]) == pytest.approx(first + 5.0, abs=1e-6)
    assert gps_time(mission, fixes(mission).t[0]) == pytest.approx(GPST + 0.5, abs=1e-6)
    assert mission.start_utc == pytest.approx(first - 18.0, abs=1e-6)


def test_a_clock_that_runs_fast_is_stretched(tmp_path: Path) -> None:
    mission = open_mission(log(tmp_path, {"drive_imu_7.csv.tag": time_tag((131, 5151))}))
    np.testing.assert_allclose(np.diff(mission.sensors["imu"].series.t), 0.1004, atol=1e-6)


def test_units_and_mounting_of_the_imu(tmp_path: Path) -> None:
    mission = open_mission(log(tmp_path))
    imu = mission.sensors["imu"]
    assert isinstance(imu.series, ImuSeries)
    np.testing.assert_allclose(imu.series.accel_i[0], [0.5 * 9.80665, 0, 9.80665])
    np.testing.assert_allclose(imu.series.gyro_i[0], [np.pi / 2, 0, -np.pi])
    turned = rotation_from_rpy(np.radians([180, 0, 180]))
    misaligned = rotation_from_rpy(np.radians([0, -6.79, 5.35]))
    np.testing.assert_allclose(imu.R_bs, misaligned @ turned, atol=1e-12)
    np.testing.assert_array_equal(imu.xyz_b, [0, 0, -0.65])
    np.testing.assert_array_equal(mission.sensors["gnss"].xyz_b, [0, -0.05, -0.65])


def test_fixes_are_local_from_the_first(tmp_path: Path) -> None:
    text = (
        HEADER + epoch(0, quality="0") + "\n" + epoch(1) + "\n" + epoch(2, latitude="40.001") + "\n"
    )
    mission = open_mission(log(tmp_path, {"drive_gnss_7.pos": text}))
    assert mission.origin is not None
    assert (mission.origin.latitude_deg, mission.origin.longitude_deg) == (40.0, -105.0)
    assert mission.origin.height_m == 1600.0
    assert [(r.index, r.reason) for r in mission.rejections] == [(0, "no fix")]
    expected = ned_from_geodetic(40.001, -105.0, 1600.0, mission.origin)
    np.testing.assert_allclose(fixes(mission).p_n, [np.zeros(3), expected], atol=1e-6)
    np.testing.assert_array_equal(fixes(mission).sigma[0], [0.02, 0.03, 0.05])
    v_n = fixes(mission).v_n
    assert v_n is not None
    np.testing.assert_array_equal(v_n[0], [1.0, 2.0, -3.0])


def test_zero_sigmas_are_the_card_s(tmp_path: Path) -> None:
    text = HEADER + epoch(0, sigma="0 0.03 0") + "\n" + epoch(1, sigma="-1 1 1") + "\n"
    mission = open_mission(log(tmp_path, {"drive_gnss_7.pos": text}))
    noise = GnssNoise.model_validate(mission.sensors["gnss"].noise)
    expected = [noise.sigma_horizontal_m, 0.03, noise.sigma_vertical_m]
    np.testing.assert_array_equal(fixes(mission).sigma, [expected])
    assert [r.reason for r in mission.rejections] == ["implausible sigma"]


@pytest.mark.parametrize("velocity", [None, "0 0 0"])
def test_without_velocities_there_are_none(tmp_path: Path, velocity: str | None) -> None:
    header = PLAIN if velocity is None else HEADER
    text = header + "".join(epoch(k, velocity=velocity) + "\n" for k in range(3))
    assert fixes(open_mission(log(tmp_path, {"drive_gnss_7.pos": text}))).v_n is None


def test_weeks_and_utc_are_understood(tmp_path: Path) -> None:
    week, second = divmod(GPST + 0.5 - 315_964_800, 604_800)
    in_weeks = HEADER + epoch(0, stamp=f"{week:.0f} {second:.3f}") + "\n"
    mission = open_mission(log(tmp_path / "week", {"drive_gnss_7.pos": in_weeks}))
    assert gps_time(mission, fixes(mission).t[0]) == pytest.approx(GPST + 0.5, abs=1e-6)
    in_utc = HEADER.replace("GPST", "UTC ") + epoch(0, stamp="2025/07/08 19:34:00.5") + "\n"
    mission = open_mission(log(tmp_path / "utc", {"drive_gnss_7.pos": in_utc}))
    assert gps_time(mission, fixes(mission).t[0]) == pytest.approx(GPST + 0.5, abs=1e-6)


def test_the_card_says_how_a_car_moves(tmp_path: Path) -> None:
    constraints = open_mission(log(tmp_path)).constraints
    assert constraints.nonholonomic
    assert constraints.zero_velocity


def test_gzipped_logs_and_the_name_of_the_positions(tmp_path: Path) -> None:
    changes: dict[str, str | bytes | None] = {
        "drive_gnss_7.pos": None,
        "drive_imu_7.csv": None,
        "drive_gnss_7.pos.gz": gzip.compress(POS.encode()),
        "drive_imu_7.csv.gz": gzip.compress(CSV.encode()),
    }
    folder = log(tmp_path, changes)
    for path in (folder, folder / "drive_gnss_7.pos.gz"):
        mission = open_mission(path)
        assert mission.name == "drive_gnss_7"
        assert {name: len(s.series) for name, s in mission.sensors.items()} == {
            "imu": 51,
            "gnss": 6,
        }


def test_two_drives_in_a_folder_are_told_apart_by_their_number(tmp_path: Path) -> None:
    folder = log(log(tmp_path), {name.replace("_7", "_8"): text for name, text in GOOD.items()})
    with pytest.raises(DataError, match=r"several files with positions.*_7\.pos.*_8\.pos"):
        open_mission(folder)
    sources = [path.name for path in open_mission(folder / "drive_gnss_8.pos").sources]
    assert sources == ["drive_gnss_8.pos", "drive_imu_8.csv", "drive_imu_8.csv.tag"]


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("drive_gnss_7.pos", r"no file with positions, \*\.pos"),
        ("drive_imu_7.csv", r"no single IMU log \*\.csv .*drive_gnss_7\.pos; csv files: none"),
        ("drive_imu_7.csv.tag", r"no time tag drive_imu_7\.csv\.tag beside drive_imu_7\.csv"),
    ],
)
def test_a_missing_file_is_named(tmp_path: Path, name: str, message: str) -> None:
    with pytest.raises(DataError, match=message):
        open_mission(log(tmp_path, {name: None}))


@pytest.mark.parametrize(
    ("tag", "message"),
    [
        (b"", "is no time tag of RTKLIB"),
        (b"\0" * 200, "is no time tag of RTKLIB"),
        (time_tag((131,)), "cut off: it holds no two ticks"),
        (time_tag()[:70], "cut off: it holds no two ticks"),
        (time_tag((5131, 131)), "the ticks do not increase"),
        (time_tag((131, 131)), "the ticks do not increase"),
        (time_tag((131, 9131)), r"spans 9\.0 s, but drive_imu_7\.csv spans 5\.0 s"),
        (time_tag(n_header=61), "fraction of the start's second"),
    ],
)
def test_a_bad_time_tag_is_an_error(tmp_path: Path, tag: bytes, message: str) -> None:
    with pytest.raises(DataError, match=message) as caught:
        open_mission(log(tmp_path, {"drive_imu_7.csv.tag": tag}))
    assert "drive_imu_7.csv.tag" in str(caught.value)


def test_a_last_pair_that_was_cut_does_not_matter(tmp_path: Path) -> None:
    mission = open_mission(log(tmp_path, {"drive_imu_7.csv.tag": time_tag() + b"\1\2\3"}))
    assert len(mission.sensors["imu"].series) == 51


@pytest.mark.parametrize(
    "cut", ["0.5,0.0,1.0,90.0,0.0,-180.0,61", "0.5,0.0", "0.5,0.0,1.0,90.0,0.0,-180.0,"]
)
def test_the_imu_s_first_and_last_lines_may_be_cut(tmp_path: Path, cut: str) -> None:
    text = CSV[CSV.index(",") + 4 :] + cut
    mission = open_mission(log(tmp_path, {"drive_imu_7.csv": text}))
    assert len(mission.sensors["imu"].series) == 50
    assert [(r.index, r.reason) for r in mission.rejections] == [
        (0, "truncated line"),
        (51, "truncated line"),
    ]


@pytest.mark.parametrize("last", [epoch(6)[:60], "2025/07/08", "2025/07/08 19:34:24.500 40.0 -1"])
def test_the_positions_first_and_last_lines_may_be_cut(tmp_path: Path, last: str) -> None:
    text = POS.removeprefix(HEADER)[15:] + last
    mission = open_mission(log(tmp_path, {"drive_gnss_7.pos": text}))
    assert len(fixes(mission)) == 5
    assert [(r.sensor, r.index, r.reason) for r in mission.rejections] == [
        ("gnss", 0, "truncated line"),
        ("gnss", 6, "truncated line"),
    ]


def test_a_header_that_was_cut_is_a_cut_line(tmp_path: Path) -> None:
    text = HEADER.splitlines()[1][40:] + "\n" + POS.removeprefix(HEADER)
    mission = open_mission(log(tmp_path, {"drive_gnss_7.pos": text}))
    assert len(fixes(mission)) == 6
    assert [(r.index, r.reason) for r in mission.rejections] == [(0, "truncated line")]


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("drive_imu_7.csv", "1,2,3"),
        ("drive_imu_7.csv", "1,2,3,4,5,6,7,8"),
        ("drive_imu_7.csv", "0.5,0.0,x,90.0,0.0,-180.0,1200"),
        ("drive_gnss_7.pos", "2025/07/08 19:34:20 40.0 -105.0"),
        ("drive_gnss_7.pos", epoch(3, stamp="2025/13/08 19:34:20.0")),
        ("drive_gnss_7.pos", epoch(3, stamp="yesterday noon")),
        ("drive_gnss_7.pos", epoch(3, latitude="north")),
    ],
)
def test_a_malformed_line_is_named(tmp_path: Path, name: str, line: str) -> None:
    good = GOOD[name]
    assert isinstance(good, str)
    lines = good.splitlines()
    lines[4] = line
    with pytest.raises(DataError, match=rf"{name}:5: ") as caught:
        open_mission(log(tmp_path, {name: "\n".join(lines) + "\n"}))
    assert caught.value.line == 5


@pytest.mark.parametrize(
    ("old", "new"),
    [("latitude(deg)", "x-ecef(m)"), ("latitude(deg)", "lat(d'\")"), ("GPST", "JST")],
)
def test_other_solution_formats_are_refused(tmp_path: Path, old: str, new: str) -> None:
    with pytest.raises(DataError, match=r"\.pos:2: .*needed are GPST or UTC and latitude\(deg\)"):
        open_mission(log(tmp_path, {"drive_gnss_7.pos": POS.replace(old, new)}))


@pytest.mark.parametrize(
    ("name", "text", "sensor"),
    [("drive_imu_7.csv", "", "imu"), ("drive_gnss_7.pos", HEADER, "gnss")],
)
def test_an_empty_log_leaves_its_sensor_out(
    tmp_path: Path, name: str, text: str, sensor: str
) -> None:
    mission = open_mission(log(tmp_path, {name: text}))
    assert set(mission.sensors) == {"imu", "gnss"} - {sensor}
    assert any(f"'{sensor}' is left out" in w for w in mission.warnings)


@settings(max_examples=100)
@given(data=st.data())
def test_damaged_logs_never_crash_the_reader(tmp_path: Path, data: st.DataObject) -> None:
    name = data.draw(st.sampled_from(sorted(GOOD)))
    good = GOOD[name]
    text = bytearray(good if isinstance(good, bytes) else good.encode())
    start = data.draw(st.integers(0, len(text) - 1))
    stop = data.draw(st.integers(start, min(start + 20, len(text))))
    text[start:stop] = data.draw(st.binary(max_size=8))
    if data.draw(st.booleans()):
        del text[data.draw(st.integers(0, len(text))) :]
    contents = bytes(text)
    if data.draw(st.booleans()):
        contents = gzip.compress(contents)[: data.draw(st.integers(1, 2000))]
    with suppress(GtsamNavError):
        assert open_mission(log(tmp_path, {name: contents})).sensors


@pytest.fixture(scope="session")
def drive(recorded_data: Path) -> Mission:
    folder = recorded_data / "rtk_mems_car"
    if not folder.is_dir():
        pytest.skip("the car's drive is not among the recorded missions")
    return open_mission(folder)


@pytest.mark.realdata
def test_the_recorded_drive_opens_whole(drive: Mission) -> None:
    assert {name: len(s.series) for name, s in drive.sensors.items()} == {
        "imu": 54_860,
        "gnss": 2197,
    }
    assert drive.rejections == ()
    assert drive.warnings == ()
    path = np.diff(fixes(drive).p_n[:, :2], axis=0)
    assert np.sum(np.hypot(*path.T)) == pytest.approx(4050, abs=30)


@pytest.mark.realdata
def test_the_recorded_mounting_makes_sense(drive: Mission) -> None:
    """At rest gravity points down; on the road the car turns and speeds up as the fixes say."""
    imu, gnss = drive.sensors["imu"], fixes(drive)
    assert isinstance(imu.series, ImuSeries)
    t = imu.series.t
    f_b, w_b = imu.series.accel_i @ imu.R_bs.T, imu.series.gyro_i @ imu.R_bs.T
    resting = t < 33.0
    np.testing.assert_allclose(np.mean(f_b[resting], axis=0), [0, 0, -9.8], atol=0.35)

    velocity = np.diff(gnss.p_n, axis=0) / np.diff(gnss.t)[:, None]
    middle = (gnss.t[1:] + gnss.t[:-1]) / 2
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    course = np.unwrap(np.arctan2(velocity[:, 1], velocity[:, 0]))
    moving = (speed[1:] > 3) & (speed[:-1] > 3)

    def increments(rate: np.ndarray, shift_s: float = 0.0) -> np.ndarray:
        total = np.concatenate([[0.0], np.cumsum(rate[:-1] * np.diff(t))])
        return np.diff(np.interp(middle - shift_s, t, total))[moving]

    turned = np.diff(course)[moving]
    own = increments(w_b[:, 2] - np.mean(w_b[resting, 2]))
    plausible = np.abs(turned) < 0.25
    assert np.corrcoef(own[plausible], turned[plausible])[0, 1] > 0.9
    assert np.polyfit(own[plausible], turned[plausible], 1)[0] == pytest.approx(1.0, abs=0.05)
    sped_up = np.diff(speed)[moving]
    agreement = {s: np.corrcoef(increments(f_b[:, 0], s), sped_up)[0, 1] for s in (-0.3, 0, 0.3)}
    assert agreement[0] > 0.8
    assert agreement[0] == max(agreement.values())
