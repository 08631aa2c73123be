"""The pose graphs that the speed benchmark makes."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.speed.pose_graphs import PARK, SPHERE, compare, write_city, write_first
from benchmarks.speed.raw_pose_graphs import RawGraph, read_raw
from gtsam_nav.readers import open_mission


def test_the_first_poses_of_city10000_are_a_graph_with_loops(tmp_path: Path) -> None:
    write_city(tmp_path / "city.g2o", 40)
    mission = open_mission(tmp_path / "city.g2o")
    assert mission.edges is not None
    assert mission.edges.span_s == (0.0, 39.0)
    assert len(mission.sensors["odometry"].series) == 39
    assert len(mission.edges) > 39


@pytest.mark.parametrize(("name", "n_poses"), [(SPHERE, 60), ("city.g2o", 60), (PARK, 55)])
def test_either_s_optimum_is_that_of_the_same_edges(
    name: str, n_poses: int, tmp_path: Path
) -> None:
    """Victoria Park's first numbers are those of five trees too; of it there are times alone."""
    path = tmp_path / name
    if name == "city.g2o":
        write_city(path, 60)
    else:
        write_first(name, path, 60)
    row = compare(path, repeats=1)
    assert row["poses"] == n_poses
    if name != PARK:
        assert row["chi2_over_raw"] == pytest.approx(1.0, abs=1e-4)
        assert row["batch_chi2_over_raw"] == pytest.approx(1.0, abs=1e-4)
    assert row["reading_over_gtsam"] > 0


@pytest.mark.parametrize(
    ("word", "tail"),
    [
        ("EDGE_SE2", "0 0 1 0 0 1 0 1"),
        ("EDGE_SE3:QUAT", "0 1 0 0 0 1 1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 1 0 0 1 0 1"),
    ],
)
def test_a_graph_begins_at_any_number_and_leaves_neighbours_apart(
    word: str, tail: str, tmp_path: Path
) -> None:
    """Pose 7 hangs on 6 backward, 8 on 5 alone; the second edge between 5 and 6 differs."""
    steps = ((5, 6, 1.0), (7, 6, -1.0), (5, 8, 3.0), (5, 6, 1.6))
    path = tmp_path / "far.g2o"
    path.write_text("".join(f"{word} {a} {b} {x} {tail}\n" for a, b, x in steps))
    raw = RawGraph.of(read_raw(path), open_mission(path))
    assert raw.poses == [5, 6, 7, 8]
    assert [raw.start_in_ned(k)[1][0] for k in range(4)] == [0, 1, 2, 3]
    assert 2 * raw.graph.error(raw.optimum()) == pytest.approx(2 * 0.3**2)


def test_poses_that_no_edges_lead_to_are_named(tmp_path: Path) -> None:
    path = tmp_path / "torn.g2o"
    steps = ((0, 1), (2, 3))
    path.write_text("".join(f"EDGE_SE2 {a} {b} 1 0 0 1 0 0 1 0 1\n" for a, b in steps))
    with pytest.raises(ValueError, match="no edges lead from pose 0 to pose 2"):
        RawGraph.of(read_raw(path), open_mission(path))
