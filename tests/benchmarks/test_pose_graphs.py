"""The pose graphs that the speed benchmark makes."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.speed.pose_graphs import PARK, SPHERE, compare, write_city, write_first
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
