"""MRCLAM robots: an invented one with round numbers and every fault, and the recorded ones."""

from __future__ import annotations

import gzip
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gtsam_nav.errors import DataError, GtsamNavError
from gtsam_nav.mission import Mission
from gtsam_nav.readers import open_mission
from gtsam_nav.series import LandmarkSeries, OdometrySeries, ReferenceSeries

START = 1248444000.0

HEADER = "# UTIAS Multi-Robot Data Set\n# Data Format:\n"
BARCODES = HEADER + "  1 \t   5 \n  2 \t  14 \n  6 \t  63 \n 17 \t  16 \n"
SURVEY = HEADER + " 6 \t 2.0 \t -3.0 \t 0.002 \t 0.004 \n 17 \t -1.0 \t 4.0 \t 0.0 \t 0.0 \n"
ODOMETRY = HEADER + "".join(f"{START + k / 10:.3f} \t 0.5 \t -0.25 \n" for k in range(11))
MEASUREMENT = HEADER + "".join(
    f"{START + t:.3f} \t {barcode} \t {range_m} \t {bearing} \n"
    for t, barcode, range_m, bearing in (
        (0.2, 63, 3.0, 0.5),
        (0.2, 16, 4.0, -0.25),
        (0.4, 14, 1.5, 0.1),
        (0.6, 99, 2.0, 0.0),
        (0.8, 63, 2.5, 0.75),
    )
)
TRUTH = HEADER + "".join(f"{START + k / 4:.3f} \t {k}.0 \t 2.0 \t 0.5 \n" for k in range(-2, 7))

GOOD = {
    "Barcodes": BARCODES,
    "Landmark_Groundtruth": SURVEY,
    "Robot3_Odometry": ODOMETRY,
    "Robot3_Measurement": MEASUREMENT,
    "Robot3_Groundtruth": TRUTH,
}


def files(folder: Path, prefix: str = "", **changes: str | bytes | None) -> Path:
    """A folder with one good robot, but for what is changed; None leaves a file out."""
    folder.mkdir(parents=True, exist_ok=True)
    contents: dict[str, str | bytes | None] = {**GOOD, **changes}
    for name, text in contents.items():
        if text is not None:
            data = text if isinstance(text, bytes) else text.encode()
            (folder / f"{prefix}{name}.dat").write_bytes(data)
    return folder


def sightings(mission: Mission) -> LandmarkSeries:
    series = mission.sensors["landmarks"].series
    assert isinstance(series, LandmarkSeries)
    return series


def test_left_positive_becomes_clockwise(tmp_path: Path) -> None:
    mission = open_mission(files(tmp_path))
    assert mission.warnings == ()
    assert (mission.origin, mission.start_utc) == (None, START)
    odometry = mission.sensors["odometry"].series
    assert isinstance(odometry, OdometrySeries)
    np.testing.assert_allclose(odometry.t, np.arange(11) / 10, atol=1e-6)
    np.testing.assert_array_equal(odometry.v_b, np.tile([0.5, 0.0], (11, 1)))
    np.testing.assert_array_equal(odometry.yaw_rate, 0.25)
    seen = sightings(mission)
    np.testing.assert_array_equal(seen.id, [6, 17, 6])
    np.testing.assert_array_equal(seen.range_m, [3.0, 4.0, 2.5])
    np.testing.assert_allclose(seen.bearing, [-0.5, 0.25, -0.75])
    np.testing.assert_allclose(seen.t, [0.2, 0.2, 0.8], atol=1e-6)


def test_x_is_north_and_y_is_west(tmp_path: Path) -> None:
    mission = open_mission(files(tmp_path))
    survey, truth = mission.landmark_map, mission.sensors["reference"].series
    assert survey is not None
    assert isinstance(truth, ReferenceSeries)
    np.testing.assert_array_equal(survey.id, [6, 17])
    np.testing.assert_array_equal(survey.p_n, [[2.0, 3.0, 0.0], [-1.0, -4.0, 0.0]])
    np.testing.assert_array_equal(survey.sigma, [0.004, 0.001])
    np.testing.assert_allclose(truth.p_n[0], [0.0, -2.0, 0.0])
    assert truth.rpy is not None
    np.testing.assert_allclose(truth.rpy, np.tile([0.0, 0.0, -0.5], (len(truth), 1)))
    assert not truth.vertical_usable


def test_the_truth_starts_no_estimate(tmp_path: Path) -> None:
    assert open_mission(files(tmp_path)).initial.p_n is None
    assert open_mission(files(tmp_path)).initial.heading is None


def test_truth_outside_what_was_measured_is_rejected(tmp_path: Path) -> None:
    mission = open_mission(files(tmp_path))
    truth = mission.sensors["reference"].series
    np.testing.assert_allclose(truth.t, [0.0, 0.25, 0.5, 0.75, 1.0], atol=1e-6)
    rejected = [r for r in mission.rejections if r.sensor == "reference"]
    assert [(r.index, r.reason) for r in rejected] == [
        (k, "while nothing was measured") for k in (0, 1, 7, 8)
    ]


def test_robots_and_unknown_barcodes_are_rejected(tmp_path: Path) -> None:
    rejections = open_mission(files(tmp_path)).rejections
    assert [(r.index, r.reason) for r in rejections if r.sensor == "landmarks"] == [
        (2, "another robot"),
        (3, "unknown barcode 99"),
    ]


def test_without_truth_and_survey_the_rest_opens(tmp_path: Path) -> None:
    mission = open_mission(files(tmp_path, Landmark_Groundtruth=None, Robot3_Groundtruth=None))
    assert list(mission.sensors) == ["odometry", "landmarks"]
    assert mission.landmark_map is None


@pytest.mark.parametrize("name", ["Barcodes", "Robot3_Odometry", "Robot3_Measurement"])
def test_a_missing_file_is_named(tmp_path: Path, name: str) -> None:
    folder = files(tmp_path, **{name: None})
    with pytest.raises(DataError, match=rf"no file {name}\.dat or {name}\.dat\.gz"):
        open_mission(folder / "Robot3")


@pytest.mark.parametrize(
    "typed",
    ["", "Robot3", "D6_Robot3", "D6_Robot3_Odometry.dat", "D6_Robot3_Groundtruth.dat.gz"],
)
def test_a_robot_by_file_stem_or_folder(tmp_path: Path, typed: str) -> None:
    folder = files(tmp_path / "run", "D6_", Robot3_Groundtruth=None)
    (folder / "D6_Robot3_Groundtruth.dat.gz").write_bytes(gzip.compress(TRUTH.encode()))
    mission = open_mission(folder / typed)
    assert mission.name == "D6_Robot3"
    assert len(mission.sensors["reference"].series) == 5
    assert {path.name for path in mission.sources} == {
        "D6_Barcodes.dat",
        "D6_Landmark_Groundtruth.dat",
        "D6_Robot3_Odometry.dat",
        "D6_Robot3_Measurement.dat",
        "D6_Robot3_Groundtruth.dat.gz",
    }


def test_a_folder_names_robots_without_a_prefix(tmp_path: Path) -> None:
    assert open_mission(files(tmp_path / "set9")).name == "set9_Robot3"


def test_several_robots_are_choices(tmp_path: Path) -> None:
    folder = files(tmp_path, "D6_")
    (folder / "D6_Robot12_Odometry.dat").write_text(ODOMETRY)
    with pytest.raises(DataError, match="several robots") as caught:
        open_mission(folder)
    assert str(folder / "D6_Robot12") in str(caught.value)
    assert str(folder / "D6_Robot3") in str(caught.value)
    with pytest.raises(DataError, match=r"no robot of that name; the choices are: .*D6_Robot12"):
        open_mission(folder / "Robot4")
    assert open_mission(folder / "Robot3").name == "D6_Robot3"


def test_one_robot_of_two_sets_is_ambiguous(tmp_path: Path) -> None:
    folder = files(files(tmp_path, "D6_"), "D7_")
    with pytest.raises(DataError, match=r"several robots.*D6_Robot3.*D7_Robot3"):
        open_mission(folder / "Robot3")
    assert open_mission(folder / "D7_Robot3").name == "D7_Robot3"


def test_a_path_that_is_nothing_is_said_to_be_missing(tmp_path: Path) -> None:
    for name in ("Robot3", "anything"):
        with pytest.raises(DataError, match="no such file or folder"):
            open_mission(tmp_path / name)


@pytest.mark.parametrize(
    ("name", "sensor", "n"),
    [
        ("Robot3_Odometry", "odometry", 11),
        ("Robot3_Measurement", "landmarks", 5),
        ("Robot3_Groundtruth", "reference", 9),
    ],
)
def test_first_and_last_lines_may_be_cut(tmp_path: Path, name: str, sensor: str, n: int) -> None:
    lines = GOOD[name].removeprefix(HEADER).splitlines()
    text = "\n".join([" \t ".join(lines[0].split()[2:]), *lines[1:-1], lines[-1].split()[0]])
    mission = open_mission(files(tmp_path, **{name: text}))
    cut = [(r.index, r.reason) for r in mission.rejections if "truncated" in r.reason]
    assert cut == [(0, "truncated line"), (n - 1, "truncated line")]
    assert {r.sensor for r in mission.rejections if "truncated" in r.reason} == {sensor}


@pytest.mark.parametrize("name", ["Robot3_Odometry", "Robot3_Measurement", "Robot3_Groundtruth"])
@pytest.mark.parametrize("line", ["1 2 3 4 5 6", "a b c d", "1"])
def test_a_malformed_line_is_named(tmp_path: Path, name: str, line: str) -> None:
    lines = GOOD[name].splitlines()
    lines[4] = line
    with pytest.raises(DataError, match=rf"{name}\.dat:5: ") as caught:
        open_mission(files(tmp_path, **{name: "\n".join(lines)}))
    assert caught.value.line == 5


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("Barcodes", BARCODES + " 7 \t 63 \n", "one barcode that no other has"),
        ("Barcodes", HEADER, "one barcode that no other has"),
        ("Barcodes", BARCODES + " 7.5 \t 64 \n", "with a fraction"),
        ("Barcodes", BARCODES + " 7", "the last line is cut off"),
        ("Barcodes", BARCODES + " 7 nan \n", "no numbers"),
        ("Landmark_Groundtruth", SURVEY + " 6 1 1 0 0 \n", "a landmark is given twice"),
        ("Landmark_Groundtruth", SURVEY + " 8 inf 1 0 0 \n", "no numbers"),
    ],
)
def test_small_tables_must_be_whole(tmp_path: Path, name: str, text: str, message: str) -> None:
    with pytest.raises(DataError, match=message) as caught:
        open_mission(files(tmp_path, **{name: text}))
    assert caught.value.path is not None
    assert caught.value.path.name == f"{name}.dat"


def test_an_empty_log_leaves_its_sensor_out(tmp_path: Path) -> None:
    mission = open_mission(files(tmp_path, Robot3_Measurement=HEADER))
    assert list(mission.sensors) == ["odometry", "reference"]
    assert any("'landmarks' is left out" in w for w in mission.warnings)
    with pytest.raises(DataError, match="no usable sensor"):
        open_mission(files(tmp_path, Robot3_Measurement="", Robot3_Odometry=""))


def test_nan_and_negative_ranges_are_rejected(tmp_path: Path) -> None:
    text = MEASUREMENT + f"{START} 63 nan 0\n{START} 63 -1 0\n{START} nan 1 0\n"
    mission = open_mission(files(tmp_path, Robot3_Measurement=text))
    assert [r.reason for r in mission.rejections if r.index >= 5 and r.sensor == "landmarks"] == [
        "non-finite range_m",
        "implausible range_m",
        "non-finite id",
    ]


@settings(max_examples=80)
@given(data=st.data())
def test_damaged_logs_never_crash_the_reader(tmp_path: Path, data: st.DataObject) -> None:
    name = data.draw(st.sampled_from(sorted(GOOD)))
    text = bytearray(GOOD[name].encode())
    start = data.draw(st.integers(0, len(text) - 1))
    stop = data.draw(st.integers(start, min(start + 20, len(text))))
    text[start:stop] = data.draw(st.binary(max_size=8))
    if data.draw(st.booleans()):
        del text[data.draw(st.integers(0, len(text))) :]
    contents = bytes(text)
    if data.draw(st.booleans()):
        contents = gzip.compress(contents)[: data.draw(st.integers(1, 2000))]
    with suppress(GtsamNavError):
        assert open_mission(files(tmp_path, **{name: contents})).sensors


@pytest.fixture(scope="session")
def mrclam_folder(recorded_data: Path) -> Path:
    folder = recorded_data / "mrclam6"
    if not folder.is_dir():
        pytest.skip("MRCLAM data set 6 is not among the recorded missions")
    return folder


@pytest.mark.realdata
@pytest.mark.parametrize("number", [1, 2, 3, 4, 5])
def test_sightings_agree_with_the_survey_and_the_truth(mrclam_folder: Path, number: int) -> None:
    """From the true pose, the sighted landmark lies where it was surveyed."""
    mission = open_mission(mrclam_folder / f"Robot{number}")
    assert mission.warnings == ()
    seen, truth, survey = sightings(mission), mission.sensors["reference"].series, mission
    assert isinstance(truth, ReferenceSeries)
    assert truth.rpy is not None
    assert survey.landmark_map is not None
    inside = seen.select((seen.t >= truth.t[0]) & (seen.t <= truth.t[-1]))
    place = dict(zip(survey.landmark_map.id.tolist(), survey.landmark_map.p_n, strict=True))
    landmark = np.array([place[k] for k in inside.id.tolist()])
    n, e = (np.interp(inside.t, truth.t, truth.p_n[:, axis]) for axis in (0, 1))
    yaw = np.interp(inside.t, truth.t, np.unwrap(truth.rpy[:, 2]))
    azimuth = yaw + inside.bearing
    error = np.hypot(
        n + inside.range_m * np.cos(azimuth) - landmark[:, 0],
        e + inside.range_m * np.sin(azimuth) - landmark[:, 1],
    )
    assert np.median(error) < 0.2


@pytest.mark.realdata
def test_the_recorded_robots_open_whole(mrclam_folder: Path) -> None:
    mission = open_mission(mrclam_folder / "D6_Robot3_Odometry.dat.gz")
    odometry, seen = mission.sensors["odometry"].series, sightings(mission)
    assert (len(odometry), len(seen)) == (61_150, 4348)
    assert set(seen.id.tolist()) == set(range(6, 21))
    reasons = [r.reason for r in mission.rejections if r.sensor == "landmarks"]
    assert reasons.count("another robot") == 1277
    assert sorted(set(reasons)) == ["another robot", "unknown barcode 34"]
    assert mission.start_utc == pytest.approx(1248444187.886)
    with pytest.raises(DataError, match="several robots"):
        open_mission(mrclam_folder)
