"""Plaza files: invented ones with round numbers and faults, and those of GTSAM."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import savemat

from gtsam_nav.errors import DataError, GtsamNavError
from gtsam_nav.mission import Mission
from gtsam_nav.readers import open_mission
from gtsam_nav.series import LandmarkSeries, OdometrySeries, ReferenceSeries

DR = [[100.5, 1.0, 0.25], [101.0, 0.5, -0.25], [102.0, 0.5, 0.0]]
TD = [[100.75, 2, 1, 30.0], [101.25, 2, 6, 40.0]]
GT = [[100.0, 1.0, 2.0, 9.0], [102.0, 3.0, 2.0, 9.0]]
TL = [[1, 10.0, -20.0], [6, 0.0, 5.0]]
TABLES: dict[str, Any] = {"DR": DR, "TD": TD, "GT": GT, "TL": TL}


def text(rows: list[list[float]]) -> str:
    return "".join("  " + "\t  ".join(f"{x:.16e}" for x in row) + "\t\n" for row in rows)


def texts(folder: Path, dr: str = text(DR), td: str = text(TD)) -> Path:
    folder.mkdir(exist_ok=True)
    (folder / "Lawn_DR.txt").write_text(dr)
    (folder / "Lawn_TD.txt").write_text(td)
    return folder


def mat(folder: Path, name: str = "Lawn", **changes: Any) -> Path:
    folder.mkdir(exist_ok=True)
    tables = {k: v for k, v in {**TABLES, **changes}.items() if v is not None}
    savemat(folder / f"{name}_.mat", tables)
    return folder


def odometry_and_ranges(mission: Mission) -> tuple[OdometrySeries, LandmarkSeries]:
    odometry, ranges = (mission.sensors[name].series for name in ("odometry", "landmarks"))
    assert isinstance(odometry, OdometrySeries)
    assert isinstance(ranges, LandmarkSeries)
    return odometry, ranges


@pytest.mark.parametrize("make", [texts, mat])
def test_increments_become_rates_in_the_middle(tmp_path: Path, make: Any) -> None:
    odometry, ranges = odometry_and_ranges(open_mission(make(tmp_path)))
    # stamps 100.25, 100.75, 101.5
    np.testing.assert_allclose(np.diff(odometry.t), [0.5, 0.75])
    np.testing.assert_allclose(odometry.v_b, [[2.0, 0], [1.0, 0], [0.5, 0]])
    np.testing.assert_allclose(odometry.yaw_rate, [-0.5, 0.5, 0.0])
    np.testing.assert_allclose(ranges.t - odometry.t[0], [0.5, 1.0])
    np.testing.assert_array_equal(ranges.id, [1, 6])
    np.testing.assert_allclose(ranges.range_m, [30.0, 40.0])
    assert ranges.bearing is None
    assert ranges.sigma_bearing is None


def test_truth_and_survey_come_from_the_mat(tmp_path: Path) -> None:
    mission = open_mission(mat(tmp_path) / "Lawn")
    truth = mission.sensors["reference"].series
    assert isinstance(truth, ReferenceSeries)
    np.testing.assert_allclose(truth.p_n, [[1, -2, 0], [3, -2, 0]])
    assert truth.rpy is None
    assert not truth.vertical_usable
    assert mission.landmark_map is not None
    np.testing.assert_array_equal(mission.landmark_map.id, [1, 6])
    np.testing.assert_array_equal(mission.landmark_map.p_n, [[10, 20, 0], [0, -5, 0]])
    without = open_mission(mat(tmp_path / "bare", GT=None, TL=None))
    assert list(without.sensors) == ["odometry", "landmarks"]
    assert without.landmark_map is None


def test_figures_of_a_card_are_the_sigmas(tmp_path: Path) -> None:
    card = tmp_path / "card.yaml"
    card.write_text("mission: {sensors: {landmarks: {noise: {sigma_range_m: 0.9}}}}")
    odometry, ranges = odometry_and_ranges(open_mission(mat(tmp_path) / "Lawn_.mat", card=card))
    np.testing.assert_array_equal(ranges.sigma_range, 0.9)
    np.testing.assert_array_equal(odometry.sigma_v, odometry.sigma_v[0])


def test_names_and_choices(tmp_path: Path) -> None:
    folder = texts(tmp_path)
    for name in ("", "Lawn", "Lawn_DR.txt", "Lawn_TD.txt"):
        assert open_mission(folder / name).name == "Lawn"
    mat(folder, "Field")
    with pytest.raises(DataError, match=r"several missions .*Field, .*Lawn"):
        open_mission(folder)
    assert "reference" in open_mission(folder / "Field_.mat").sensors
    with pytest.raises(DataError, match="no such file or folder"):
        open_mission(folder / "Meadow")


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    (texts(tmp_path) / "Lawn_TD.txt").unlink()
    with pytest.raises(DataError, match=r"no file Lawn_TD\.txt"):
        open_mission(tmp_path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"DR": None}, "holds no table DR"),
        ({"TD": None}, "holds no table TD"),
        ({"TD": [[1, 2, 3]]}, "TD must be a table of time, transmitter, beacon, range"),
        ({"DR": "text"}, "holds no table DR of time, distance, turn"),
        ({"TL": [[1, 0, 0], [1, 2, 2]]}, "TL gives a beacon twice"),
        ({"TL": [[1.5, 0, 0]]}, "beacons with a fraction"),
    ],
)
def test_tables_that_are_not_as_they_should_be(
    tmp_path: Path, changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(DataError, match=message) as caught:
        open_mission(mat(tmp_path, **changes))
    assert "Lawn_.mat" in str(caught.value)


def test_a_file_that_is_no_mat(tmp_path: Path) -> None:
    (tmp_path / "Lawn_.mat").write_bytes(b"MATLAB 5.0 MAT-file, but not really" * 20)
    with pytest.raises(DataError, match=r"Lawn_\.mat: not readable as a MATLAB file"):
        open_mission(tmp_path)


def test_malformed_and_cut_lines(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"Lawn_DR\.txt:2: "):
        open_mission(texts(tmp_path, dr="1 2 3\n1 2\n3 4 5\n"))
    mission = open_mission(texts(tmp_path, td=text(TD) + "101.5 2"))
    assert [(r.sensor, r.index, r.reason) for r in mission.rejections] == [
        ("landmarks", 2, "truncated line")
    ]


def test_steps_that_take_no_time_are_rejected(tmp_path: Path) -> None:
    mission = open_mission(texts(tmp_path, dr=text([*DR, DR[-1]])))
    assert [(r.sensor, r.index) for r in mission.rejections] == [("odometry", 3)]


@settings(max_examples=60)
@given(data=st.data())
def test_damaged_files_never_crash_the_reader(tmp_path: Path, data: st.DataObject) -> None:
    name = data.draw(st.sampled_from(["Lawn_.mat", "Lawn_DR.txt", "Lawn_TD.txt"]))
    folder = mat(tmp_path / "mat") if name.endswith("mat") else texts(tmp_path / "texts")
    contents = bytearray((folder / name).read_bytes())
    start = data.draw(st.integers(0, len(contents) - 1))
    stop = data.draw(st.integers(start, min(start + 20, len(contents))))
    contents[start:stop] = data.draw(st.binary(max_size=8))
    (folder / name).write_bytes(bytes(contents))
    with suppress(GtsamNavError):
        assert open_mission(folder).sensors


@pytest.mark.parametrize(
    ("name", "n_steps", "n_ranges"), [("Plaza1", 9657, 3529), ("Plaza2", 4090, 1816)]
)
def test_gtsam_s_files_make_sense(name: str, n_steps: int, n_ranges: int) -> None:
    """The truth's distances to the surveyed beacons are the ranges, but for their scale."""
    import gtsam

    mission = open_mission(gtsam.findExampleDataFile(f"{name}_.mat"))
    odometry, ranges = odometry_and_ranges(mission)
    truth, survey = mission.sensors["reference"].series, mission.landmark_map
    assert isinstance(truth, ReferenceSeries)
    assert survey is not None
    assert ranges.range_m is not None
    assert (len(odometry), len(ranges)) == (n_steps, n_ranges)
    place = dict(zip(survey.id.tolist(), survey.p_n, strict=True))
    beacon = np.array([place[k] for k in ranges.id.tolist()])
    n, e = (np.interp(ranges.t, truth.t, truth.p_n[:, axis]) for axis in (0, 1))
    scale = ranges.range_m / np.hypot(n - beacon[:, 0], e - beacon[:, 1])
    assert np.median(scale) == pytest.approx(1.07, abs=0.01)
    driven = np.sum(odometry.v_b[:-1, 0] * np.diff(odometry.t))
    path = np.sum(np.hypot(*np.diff(truth.p_n[:, :2], axis=0).T))
    assert driven == pytest.approx(path, rel=0.01)
