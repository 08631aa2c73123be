"""g2o graphs: an invented one with round numbers and faults, and one of our own."""

from __future__ import annotations

import warnings
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from gtsam_nav.audit import audit
from gtsam_nav.errors import DataError
from gtsam_nav.methods import estimate
from gtsam_nav.mission import Mission
from gtsam_nav.readers import open_mission
from gtsam_nav.series import LandmarkSeries, OdometrySeries
from gtsam_nav.writers.mission_folder import write_mission

INFORMATION = "25 0 0 100 0 4"
GRAPH = f"""# a quarter turn to the left on a circle of 2 m, then straight on
VERTEX_SE2 0 9 9 9
EDGE_SE2 0 1 2 2 {np.pi / 2} {INFORMATION}
EDGE_SE2 1 3 1 0 0 {INFORMATION}
EDGE_SE2 4 3 -2 0 0 {INFORMATION}
EDGE_SE2 0 4 1 1 1 {INFORMATION}
EDGE_SE2_XY 1 2 3 4 25 0 25
EDGE_SE2_XY 9 2 3 4 25 0 25
EDGE_PRIOR_SE2 0 0 0
"""


def graph(folder: Path, text: str = GRAPH) -> Mission:
    (folder / "park.g2o").write_text(text)
    return open_mission(folder / "park.g2o")


def odometry_of(mission: Mission) -> OdometrySeries:
    series = mission.sensors["odometry"].series
    assert isinstance(series, OdometrySeries)
    return series


def test_edges_between_neighbours_are_odometry(tmp_path: Path) -> None:
    """Poses 0, 1, 3, 4 are a second apart; a left quarter turn on 2 m radius is pi metres long."""
    read = graph(tmp_path)
    series = odometry_of(read)
    np.testing.assert_allclose(series.t, [0.5, 1.5, 2.5])
    np.testing.assert_allclose(series.v_b, [[np.pi, 0], [1, 0], [2, 0]], atol=1e-12)
    np.testing.assert_allclose(series.yaw_rate, [-np.pi / 2, 0, 0], atol=1e-12)
    np.testing.assert_allclose(series.sigma_v, 0.2)
    np.testing.assert_allclose(series.sigma_yaw_rate, 0.5)
    assert Counter(r.reason for r in read.rejections) == {"no such pose": 1}
    assert any("EDGE_PRIOR_SE2 (1)" in w for w in read.warnings)


def test_edges_that_close_loops_are_edges_of_the_mission(tmp_path: Path) -> None:
    """All edges are then; the noise along the later pose's axes is turned into the earlier's."""
    read = graph(tmp_path)
    assert read.edges is not None
    np.testing.assert_allclose(read.edges.t, [[0, 1], [1, 2], [3, 2], [0, 3]])
    np.testing.assert_allclose(read.edges.q[0], [2, -2, -np.pi / 2])
    np.testing.assert_allclose(read.edges.q[3], [1, -1, -1])
    np.testing.assert_allclose(read.edges.cov[1], np.diag([0.04, 0.01, 0.25]))
    np.testing.assert_allclose(read.edges.cov[0], np.diag([0.01, 0.04, 0.25]), atol=1e-15)
    told = "1 edges close loops, which only the method graph uses"
    assert told not in read.warnings
    assert told in estimate(read, "dr").warnings
    assert told not in estimate(read, "graph").warnings
    assert (audit(read).edges, audit(read).loops) == (4, 1)


def test_edges_are_cropped_with_both_their_poses(tmp_path: Path) -> None:
    read = graph(tmp_path)
    cropped = read.crop(1.0, 4.0)
    assert cropped.edges is not None
    np.testing.assert_allclose(cropped.edges.t, [[1, 2], [3, 2]])
    assert cropped.span_s == (1.0, 3.0)
    assert read.crop(0.1, 0.9).edges is None


@pytest.mark.parametrize(
    ("line", "told"),
    [
        pytest.param("1e9,1,0,0,0,1,0,0,1,0,1", "1 edges are left out", id="hours_away"),
        pytest.param("0,1,0,0,0,-1,0,0,1,0,1", "1 unusable edges", id="no_covariance"),
    ],
)
def test_an_edge_of_a_mission_folder_that_is_left_out_is_told(
    tmp_path: Path, line: str, told: str
) -> None:
    write_mission(graph(tmp_path), tmp_path / "folder")
    with (tmp_path / "folder" / "edges.csv").open("a") as file:
        file.write(f"{line}\n")
    read = open_mission(tmp_path / "folder")
    assert read.edges is not None
    assert len(read.edges) == 4
    assert any(told in w for w in read.warnings)


def test_what_is_wrong_with_an_edge_of_a_mission_folder_is_told(tmp_path: Path) -> None:
    write_mission(graph(tmp_path), tmp_path / "folder")
    with (tmp_path / "folder" / "edges.csv").open("a") as file:
        file.write("0,2,nan,0,0,1,0,0,1,0,1\n1,1,0,0,0,1,0,0,1,0,1\n")
    rejections = open_mission(tmp_path / "folder").rejections
    found = [(r.sensor, r.t, r.index, r.reason) for r in rejections if r.sensor == "edges"]
    assert found == [
        ("edges", 2.0, 4, "says nothing finite"),
        ("edges", 1.0, 5, "joins a pose to itself"),
    ]


@pytest.mark.parametrize("name", ["graph.txt", "graph.graph"])
def test_a_text_file_that_begins_like_g2o_is_read_as_such(tmp_path: Path, name: str) -> None:
    line = f"EDGE_SE2 0 1 2 0 0 {INFORMATION}\n"
    (tmp_path / name).write_text(line)
    np.testing.assert_allclose(odometry_of(open_mission(tmp_path / name)).t, [0])
    (tmp_path / name).write_text(f"note\n{line}")
    with pytest.raises(DataError, match="not a mission that any reader knows"):
        open_mission(tmp_path / name)


def test_a_graph_without_loops_is_odometry_alone(tmp_path: Path) -> None:
    read = graph(tmp_path, f"EDGE_SE2 0 1 2 0 0 {INFORMATION}\n")
    assert read.edges is None
    np.testing.assert_allclose(odometry_of(read).t, [0])


def test_edges_that_say_nothing_are_rejected_by_their_number(tmp_path: Path) -> None:
    good = f"EDGE_SE2 0 1 2 0 0 {INFORMATION}\nEDGE_SE2 1 2 2 0 0 {INFORMATION}\n"
    bad = f"EDGE_SE2 1 1 0 0 0 {INFORMATION}\nEDGE_SE2 0 2 nan 0 0 {INFORMATION}\n"
    read = graph(tmp_path, good + bad)
    assert [(r.index, r.reason) for r in read.rejections] == [
        (2, "joins a pose to itself"),
        (3, "says nothing finite"),
    ]
    assert read.edges is None


def test_landmarks_are_polar_and_clockwise(tmp_path: Path) -> None:
    seen = graph(tmp_path).sensors["landmarks"].series
    assert isinstance(seen, LandmarkSeries)
    np.testing.assert_allclose(seen.range_m, [5])
    np.testing.assert_allclose(seen.bearing, [-np.arctan2(4, 3)])
    np.testing.assert_allclose(seen.sigma_range, [0.2])
    np.testing.assert_allclose(seen.sigma_bearing, [0.04])


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("EDGE_SE2 0 1 x 0 0 1 0 0 1 0 1", r"park.g2o:2: EDGE_SE2: 'x' is not a number"),
        ("EDGE_SE2 0 1 1 0 0 1 0 0 -1 0 1", "not positive definite"),
        ("EDGE_SE2 0 1 1 0 0 1e30 0 0 1 0 1", "not positive definite"),
        ("EDGE_SE2 0.5 1 1 0 0 1 0 0 1 0 1", "whole numbers"),
        ("EDGE_SE2 0 1 1 0 0 1 0", "7 numbers behind EDGE_SE2, where 11 are needed"),
    ],
)
def test_a_malformed_line_is_named(tmp_path: Path, line: str, message: str) -> None:
    good = f"EDGE_SE2 0 1 2 0 0 {INFORMATION}\n"
    with pytest.raises(DataError, match=message):
        graph(tmp_path, f"{good}{line}\n{good}")


def test_a_last_line_that_was_cut_off_is_rejected(tmp_path: Path) -> None:
    read = graph(tmp_path, f"EDGE_SE2 0 1 2 0 0 {INFORMATION}\nEDGE_SE2 1 2 2 0")
    assert [r.reason for r in read.rejections] == ["truncated line"]


@pytest.mark.parametrize("n_whole", [0, 1])
def test_a_sighting_that_was_cut_off_is_rejected_as_one(tmp_path: Path, n_whole: int) -> None:
    whole = "EDGE_SE2_XY 1 2 3 4 25 0 25\n" * n_whole
    read = graph(tmp_path, f"EDGE_SE2 0 1 2 0 0 {INFORMATION}\n{whole}EDGE_SE2_XY 1 2 3 4")
    assert [(r.sensor, r.index) for r in read.rejections] == [("landmarks", n_whole)]


def test_what_is_infinite_is_rejected_without_a_word_of_numpy_s(tmp_path: Path) -> None:
    edges = f"EDGE_SE2 1 0 inf -inf 0 {INFORMATION}\nEDGE_SE2 3 4 1 0 inf {INFORMATION}\n"
    flat = "EDGE_SE3:QUAT 0 4 -inf inf 0 0 0 inf 1 1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 1 0 0 1 0 1\n"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read = graph(tmp_path, f"{GRAPH}{edges}{flat}EDGE_SE2_XY 1 2 inf 4 25 0 25\n")
    assert [(r.sensor, r.index) for r in read.rejections] == [
        *(("odometry", n) for n in (4, 5, 6)),
        *(("landmarks", n) for n in (1, 2)),
    ]


def test_a_graph_without_edges(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no edge joins two poses"):
        graph(tmp_path, "VERTEX_SE2 0 0 0 0\n")
