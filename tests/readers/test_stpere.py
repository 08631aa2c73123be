"""The St. Pere logs: invented ones with every fault, and the recorded ones where they are."""

from __future__ import annotations

import gzip
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gtsam_nav.errors import DataError, GtsamNavError
from gtsam_nav.frames import ned_from_geodetic, rotation_from_rpy
from gtsam_nav.readers import open_mission
from gtsam_nav.series import (
    AttitudeSeries,
    BeamSeries,
    DepthSeries,
    DvlSeries,
    GnssSeries,
    HeadingSeries,
    ImuSeries,
)

START = 1093455400.0
PREFIX = "_000000_0000"
N_BINS = 6


def dvl_line(k: int, *, water: str = "10 20 30 1", bottom: str = "40 -50 6 1") -> str:
    rest = "1.8 1.8 1.8 140 140 140 100 207.7 -0.5 1.6 14.2"
    return f"{START + k}\t\t2007 3 16 13 0 {k} {water} {bottom} {rest} 1488 12.8 .5 1.5 .1 .2"


def mti_line(k: int, *, roll: float = 0.5, pitch: float = -2.5, yaw: float = -126.0) -> str:
    return f"{START + k}\t\t{roll}\t{pitch}\t{yaw}\t\t0.1\t0.2\t0.3\t\t-0.4\t-0.1\t-9.8\t\t"


def dgps_line(k: int, *, latitude: str = "4212.2250", status: int = 1) -> str:
    return f"{START + k}\t{latitude}\t306.2832\t{status}\t-2.1\t51.8\t23.6\t24\t0.1\t0.1"


def beam_line(k: int, *, bins: str = "0 10 255 7 8 99") -> str:
    return f"{START + k} {1000 * k} {0.0314 * k:.6f} {bins} "


def log(line: Callable[[int], str]) -> str:
    header = "% ----\r\n% Data columns: \r\n\r\n"
    return header + "".join(line(k) + "\r\n" for k in range(8))


GOOD = {
    "DVL.log": log(dvl_line),
    "MTi.log": log(mti_line),
    "DGPS.log": log(dgps_line).replace("%", "% \xe9"),
    "IS.log": log(beam_line),
}


def logs(folder: Path, **changes: str | bytes | None) -> Path:
    """A folder of good logs, but for what is changed (DVL, MTi, DGPS, IS); None leaves one out."""
    folder.mkdir(parents=True, exist_ok=True)
    contents: dict[str, str | bytes | None] = {**GOOD}
    contents |= {f"{name}.log": text for name, text in changes.items()}
    for name, text in contents.items():
        if text is not None:
            data = text if isinstance(text, bytes) else text.encode("latin-1")
            (folder / f"{PREFIX}_{name}").write_bytes(data)
    return folder


def replaced(name: str, k: int, line: str) -> str:
    """A good log whose line k is another."""
    lines = GOOD[name].split("\r\n")
    lines[3 + k] = line
    return "\r\n".join(lines)


def test_good_logs_open_without_a_word(tmp_path: Path) -> None:
    mission = open_mission(logs(tmp_path))
    assert list(mission.sensors) == ["dvl", "depth", "heading", "attitude", "imu", "gnss", "sonar"]
    assert {len(s.series) for s in mission.sensors.values()} == {8}
    assert mission.warnings == ()
    assert mission.rejections == ()
    assert mission.start_utc == START
    assert mission.sonar_kind == "recorded"


def test_the_dvl_gives_ground_else_water_else_nothing(tmp_path: Path) -> None:
    none = "32767.00 32767.00 32767.00 0"
    lines = {2: dvl_line(2, bottom=none), 5: dvl_line(5, bottom=none, water=none)}
    text = log(lambda k: lines.get(k, dvl_line(k)))
    series = open_mission(logs(tmp_path, DVL=text)).sensors["dvl"].series
    assert isinstance(series, DvlSeries)
    np.testing.assert_allclose(series.v_d[0], [0.4, -0.5, 0.06])
    np.testing.assert_allclose(series.v_d[2], [0.1, 0.2, 0.3])
    np.testing.assert_array_equal(np.flatnonzero(~series.bottom_lock), [2, 5])
    np.testing.assert_array_equal(np.flatnonzero(~series.valid), [5])


def test_a_reading_of_32767_is_none_even_with_good_status(tmp_path: Path) -> None:
    text = replaced("DVL.log", 3, dvl_line(3, bottom="32767 1 1 1", water="0 0 0 0"))
    series = open_mission(logs(tmp_path, DVL=text)).sensors["dvl"].series
    assert isinstance(series, DvlSeries)
    np.testing.assert_array_equal(np.flatnonzero(~series.valid), [3])


def test_depth_comes_from_the_pressure(tmp_path: Path) -> None:
    series = open_mission(logs(tmp_path)).sensors["depth"].series
    assert isinstance(series, DepthSeries)
    np.testing.assert_allclose(series.depth_m, 0.003772250 * 48)


def test_one_mounting_turns_compass_attitude_and_imu(tmp_path: Path) -> None:
    """What gravity and the compass say must agree in vehicle axes."""
    gravity = 9.8
    attitude_m = np.radians([0.5, -2.5, -126.0])
    f = rotation_from_rpy(attitude_m).T @ [0, 0, -gravity]

    def line(k: int) -> str:
        return mti_line(k).replace("-0.4\t-0.1\t-9.8", "\t".join(str(x) for x in f))

    mission = open_mission(logs(tmp_path, MTi=log(line)))
    heading, attitude, imu = (mission.sensors[name] for name in ("heading", "attitude", "imu"))
    assert isinstance(heading.series, HeadingSeries)
    assert isinstance(attitude.series, AttitudeSeries)
    assert isinstance(imu.series, ImuSeries)
    np.testing.assert_allclose(np.degrees(heading.series.heading), 360 - 126 - 86)
    # near a quarter turn: vehicle roll = -MTi pitch, vehicle pitch = MTi roll, to the 4 degrees
    np.testing.assert_allclose(np.degrees(attitude.series.roll), 2.5, atol=0.1)
    np.testing.assert_allclose(np.degrees(attitude.series.pitch), 0.5, atol=0.2)
    tilt = [attitude.series.roll[0], attitude.series.pitch[0], 0.0]
    levelled = rotation_from_rpy(tilt) @ imu.R_bs @ imu.series.accel_i[0]
    np.testing.assert_allclose(levelled, [0, 0, -gravity], atol=1e-9)
    # vehicle x is about -MTi y, vehicle y about MTi x
    gyro_b = imu.R_bs @ imu.series.gyro_i[0]
    np.testing.assert_allclose(gyro_b, [-0.2, 0.1, 0.3], atol=0.02)


def test_the_first_fix_is_the_origin_on_the_water(tmp_path: Path) -> None:
    text = log(lambda k: dgps_line(k, latitude="4212.2350" if k else "4212.2250"))
    mission = open_mission(logs(tmp_path, DGPS=text))
    series = mission.sensors["gnss"].series
    assert isinstance(series, GnssSeries)
    assert mission.origin is not None
    assert mission.origin.latitude_deg == pytest.approx(42 + 12.225 / 60)
    assert mission.origin.longitude_deg == pytest.approx(3 + 6.2832 / 60)
    assert mission.origin.height_m == 0
    np.testing.assert_allclose(series.p_n[0], [0, 0, 2.1], atol=1e-6)
    expected = ned_from_geodetic(42 + 12.235 / 60, 3 + 6.2832 / 60, -2.1, mission.origin)
    np.testing.assert_allclose(series.p_n[1], expected, atol=1e-6)


def test_what_is_no_fix_is_rejected_and_no_origin(tmp_path: Path) -> None:
    text = log(lambda k: dgps_line(k, status=int(k > 1), latitude=f"4212.22{k}0"))
    mission = open_mission(logs(tmp_path, DGPS=text))
    assert [(r.index, r.reason) for r in mission.rejections] == [(0, "no fix"), (1, "no fix")]
    assert mission.origin is not None
    assert mission.origin.latitude_deg == pytest.approx(42 + 12.222 / 60)


@pytest.mark.parametrize("ending", ["_IS.log", "_IS.log.gz"])
def test_recorded_sonar_is_preferred(tmp_path: Path, ending: str) -> None:
    folder = logs(tmp_path, IS=None)
    simulated = log(lambda k: beam_line(k, bins="1 1 1 1 1 1")).encode()
    (folder / f"{PREFIX}_IS.simulated.log.gz").write_bytes(gzip.compress(simulated))
    mission = open_mission(folder)
    assert mission.sonar_kind == "simulated"
    assert any("simulated sonar" in w for w in mission.warnings)

    recorded = GOOD["IS.log"].encode()
    (folder / f"{PREFIX}{ending}").write_bytes(
        gzip.compress(recorded) if ending.endswith("gz") else recorded
    )
    mission = open_mission(folder)
    assert mission.sonar_kind == "recorded"
    series = mission.sensors["sonar"].series
    assert isinstance(series, BeamSeries)
    np.testing.assert_array_equal(series.intensity, np.tile([0, 10, 255, 7, 8, 99], (8, 1)))
    np.testing.assert_allclose(series.angle, 0.0314 * np.arange(8))


def test_without_a_sonar_the_rest_opens_and_says_so(tmp_path: Path) -> None:
    mission = open_mission(logs(tmp_path, IS=None))
    assert mission.sonar_kind is None
    assert any("no sonar log" in w for w in mission.warnings)


@pytest.mark.parametrize("name", ["DVL", "MTi", "DGPS"])
def test_a_missing_log_is_named(tmp_path: Path, name: str) -> None:
    with pytest.raises(DataError, match=rf"no file \*_{name}\.log"):
        open_mission(logs(tmp_path, **{name: None}))


def test_two_missions_in_one_folder_are_an_error(tmp_path: Path) -> None:
    (logs(tmp_path) / "_1_DVL.log").write_text(GOOD["DVL.log"])
    with pytest.raises(DataError, match="several missions in one folder"):
        open_mission(tmp_path)


@pytest.mark.parametrize(
    ("name", "sensors"),
    [
        ("DVL", {"dvl", "depth"}),
        ("MTi", {"heading", "attitude", "imu"}),
        ("DGPS", {"gnss"}),
        ("IS", {"sonar"}),
    ],
)
@pytest.mark.parametrize("text", ["", "% header\r\n% only\r\n"])
def test_an_empty_log_leaves_its_sensors_out(
    tmp_path: Path, name: str, sensors: set[str], text: str
) -> None:
    mission = open_mission(logs(tmp_path, **{name: text}))
    everything = {"dvl", "depth", "heading", "attitude", "imu", "gnss", "sonar"}
    assert set(mission.sensors) == everything - sensors
    for sensor in sensors:
        assert any(f"'{sensor}' is left out" in w for w in mission.warnings)


def test_only_empty_logs_are_an_error(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no usable sensor"):
        open_mission(logs(tmp_path, DVL="", MTi="", DGPS="", IS=""))


@pytest.mark.parametrize(
    ("name", "sensors"),
    [
        ("DVL", ["dvl", "depth"]),
        ("MTi", ["heading", "attitude", "imu"]),
        ("DGPS", ["gnss"]),
        ("IS", ["sonar"]),
    ],
)
@pytest.mark.parametrize("end", ["\r\n", ""])
def test_a_last_line_that_was_cut_off_is_rejected(
    tmp_path: Path, name: str, sensors: list[str], end: str
) -> None:
    text = GOOD[f"{name}.log"].rstrip()
    fields = text.split()
    cut = text[: text.rindex(fields[-3])].rstrip() + end
    mission = open_mission(logs(tmp_path, **{name: cut}))
    for sensor in sensors:
        assert len(mission.sensors[sensor].series) == 7
    assert [(r.sensor, r.index, r.reason, r.t) for r in mission.rejections] == [
        (sensor, 7, "truncated line", 7.0) for sensor in sensors
    ]


@pytest.mark.parametrize("name", ["DVL", "MTi", "DGPS", "IS"])
@pytest.mark.parametrize("end", ["\0\0\0\0", "8.0 x", "7.5 ÿþ\x01\r\n"])
def test_a_last_line_that_is_damaged_is_rejected(tmp_path: Path, name: str, end: str) -> None:
    text = GOOD[f"{name}.log"].rstrip() + "\r\n" + end
    mission = open_mission(logs(tmp_path, **{name: text}))
    assert {(r.index, r.reason) for r in mission.rejections} == {(8, "truncated line")}


@pytest.mark.parametrize("name", ["DVL", "MTi", "DGPS", "IS"])
@pytest.mark.parametrize("line", ["1 2 3", "a b c d e f g h i", "%s 1"])
def test_a_malformed_line_is_named(tmp_path: Path, name: str, line: str) -> None:
    good = GOOD[f"{name}.log"].split("\r\n")[6]
    text = replaced(f"{name}.log", 3, line % good if "%s" in line else line)
    with pytest.raises(DataError, match=rf"_{name}\.log:7: ") as caught:
        open_mission(logs(tmp_path, **{name: text}))
    assert caught.value.line == 7


def test_nan_fields_are_rejected_by_sensor(tmp_path: Path) -> None:
    text = replaced("MTi.log", 2, mti_line(2, yaw=float("nan")))
    mission = open_mission(logs(tmp_path, MTi=text))
    assert [(r.sensor, r.index, r.reason) for r in mission.rejections] == [
        ("heading", 2, "non-finite heading")
    ]


def test_stamps_back_in_time_and_repeated(tmp_path: Path) -> None:
    order = [0, 2, 1, 3, 3, 4, 5, 6]
    mission = open_mission(logs(tmp_path, MTi=log(lambda k: mti_line(order[k]))))
    assert {(r.sensor, r.index, r.reason) for r in mission.rejections} == {
        (sensor, 4, "repeated sample") for sensor in ("heading", "attitude", "imu")
    }
    assert sum("out of order" in w for w in mission.warnings) == 3


def test_a_clock_jump_never_defines_zero(tmp_path: Path) -> None:
    text = replaced("DGPS.log", 0, dgps_line(-7200))
    mission = open_mission(logs(tmp_path, DGPS=text))
    assert mission.start_utc == START
    assert [(r.sensor, r.index, r.reason) for r in mission.rejections] == [
        ("gnss", 0, "clock jump")
    ]


@pytest.mark.parametrize("bins", ["0 10 256 7 8 9", "0 10 -5 7 8 9", "0 10 99999 7 8 9"])
def test_echoes_beyond_a_byte_drop_the_beam(tmp_path: Path, bins: str) -> None:
    text = replaced("IS.log", 2, beam_line(2, bins=bins))
    mission = open_mission(logs(tmp_path, IS=text))
    assert [(r.sensor, r.index, r.reason) for r in mission.rejections] == [
        ("sonar", 2, "echo outside 0..255")
    ]
    series = mission.sensors["sonar"].series
    assert isinstance(series, BeamSeries)
    np.testing.assert_array_equal(series.intensity[2], [0, 10, 255, 7, 8, 99])


def test_blank_lines_and_comments_between_beams_do_not_matter(tmp_path: Path) -> None:
    text = GOOD["IS.log"].replace("\r\n", "\n\n% remark\n").replace(" ", "\t ")
    series = open_mission(logs(tmp_path, IS=text)).sensors["sonar"].series
    assert isinstance(series, BeamSeries)
    np.testing.assert_array_equal(series.intensity, np.tile([0, 10, 255, 7, 8, 99], (8, 1)))


def test_beams_across_many_chunks_are_parsed_as_they_stand(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gtsam_nav.readers._bytes.CHUNK_BYTES", 97)
    rng = np.random.default_rng(3)
    expected = rng.integers(0, 256, (8, 50))
    text = log(lambda k: beam_line(k, bins=" ".join(map(str, expected[k]))))
    told: list[float] = []
    for contents in (text.encode(), gzip.compress(text.encode())):
        folder = logs(tmp_path, IS=contents)
        mission = open_mission(folder, lambda _stage, fraction: told.append(fraction))
        series = mission.sensors["sonar"].series
        assert isinstance(series, BeamSeries)
        np.testing.assert_array_equal(series.intensity, expected)
    assert len(told) > 10
    assert told[-1] == 1.0


@settings(max_examples=80)
@given(data=st.data())
def test_damaged_logs_never_crash_the_reader(tmp_path: Path, data: st.DataObject) -> None:
    name = data.draw(st.sampled_from(["DVL", "MTi", "DGPS", "IS"]))
    text = bytearray(GOOD[f"{name}.log"].encode("latin-1"))
    start = data.draw(st.integers(0, len(text) - 1))
    stop = data.draw(st.integers(start, min(start + 20, len(text))))
    text[start:stop] = data.draw(st.binary(max_size=8))
    if data.draw(st.booleans()):
        del text[data.draw(st.integers(0, len(text))) :]
    contents = bytes(text)
    if data.draw(st.booleans()):
        contents = gzip.compress(contents)[: data.draw(st.integers(1, 2000))]
    with suppress(GtsamNavError):
        assert open_mission(logs(tmp_path, **{name: contents})).sensors


@pytest.mark.realdata
def test_the_recorded_mission_opens_whole(stpere_folder: Path) -> None:
    begin = time.perf_counter()
    mission = open_mission(stpere_folder)
    assert time.perf_counter() - begin < 10  # 55 MB of beams: about 2 s on two cores
    counts = {name: len(sensor.series) for name, sensor in mission.sensors.items()}
    assert counts["dvl"] == counts["depth"] == 5045
    assert counts["imu"] == counts["heading"] == counts["attitude"] == 33_457
    assert counts["gnss"] == 3342
    assert 43_600 <= counts["sonar"] <= 43_640
    dvl = mission.sensors["dvl"].series
    assert isinstance(dvl, DvlSeries)
    assert np.sum(~dvl.bottom_lock) == 84
    assert mission.rejections == ()
    assert mission.start_utc == 1093455407.042
    assert mission.span_s[1] == pytest.approx(3346, abs=1)
    assert mission.sensors["sonar"].series.t[-1] == pytest.approx(3020, abs=1)


@pytest.mark.realdata
def test_the_recorded_mission_makes_sense(stpere_folder: Path) -> None:
    mission = open_mission(stpere_folder)
    assert mission.sonar_kind == "simulated"
    assert any("simulated sonar" in w for w in mission.warnings)
    gnss, depth, sonar = (mission.sensors[name].series for name in ("gnss", "depth", "sonar"))
    assert isinstance(gnss, GnssSeries)
    assert isinstance(depth, DepthSeries)
    assert isinstance(sonar, BeamSeries)
    extent = np.ptp(gnss.p_n, axis=0)
    assert 150 < extent[0] < 250
    assert 50 < extent[1] < 130
    assert len(np.unique(depth.depth_m)) == 2
    assert sonar.intensity.shape[1] == 500
    steps = np.unwrap(sonar.angle[:2000])
    np.testing.assert_allclose(np.diff(steps), np.radians(1.8), atol=1e-5)
    imu = mission.sensors["imu"]
    assert isinstance(imu.series, ImuSeries)
    # both are turned by the same mounting: the vehicle's own gravity must point down
    attitude = mission.sensors["attitude"].series
    assert isinstance(attitude, AttitudeSeries)
    R_nb = rotation_from_rpy(
        np.column_stack([attitude.roll, attitude.pitch, np.zeros(len(attitude))])
    )
    f_n = np.einsum("nij,jk,nk->ni", R_nb, imu.R_bs, imu.series.accel_i)
    np.testing.assert_allclose(np.mean(f_n, axis=0), [0, 0, -9.78], atol=0.05)
