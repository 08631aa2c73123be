"""The pose graphs that the speed benchmark makes."""

from __future__ import annotations

from pathlib import Path

from benchmarks.speed.pose_graphs import write_city
from gtsam_nav.readers import open_mission


def test_the_first_poses_of_city10000_are_a_graph_with_loops(tmp_path: Path) -> None:
    write_city(tmp_path / "city.g2o", 40)
    mission = open_mission(tmp_path / "city.g2o")
    assert mission.edges is not None
    assert mission.edges.span_s == (0.0, 39.0)
    assert len(mission.sensors["odometry"].series) == 39
    assert len(mission.edges) > 39
