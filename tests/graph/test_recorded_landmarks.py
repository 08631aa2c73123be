"""Landmarks on recorded data, scored against truths that no estimator reads."""

from __future__ import annotations

from pathlib import Path

import gtsam
import pytest

import gtsam_nav as gn

SLAM = gn.load_config(None, ["landmarks.use_map=false"])


@pytest.mark.slow
@pytest.mark.realdata
def test_a_robot_among_barcodes_is_no_worse_than_by_the_filter(recorded_data: Path) -> None:
    mission = gn.open_mission(recorded_data / "mrclam6" / "Robot4")
    graph, filtered = (
        gn.evaluate(gn.estimate(mission, method, SLAM)).ate.se2
        for method in ("graph", "landmark-ekf")
    )
    assert graph is not None
    assert filtered is not None
    assert graph.rmse <= min(0.1, filtered.rmse)


@pytest.mark.slow
@pytest.mark.realdata
def test_a_robot_that_is_not_told_the_barcodes_is_hardly_worse(recorded_data: Path) -> None:
    mission = gn.open_mission(recorded_data / "mrclam6" / "Robot4")
    blind = gn.load_config(None, ["landmarks.use_map=false", "landmarks.association=joint"])
    errors = gn.evaluate(gn.estimate(mission, "graph", blind)).ate.se2
    assert errors is not None
    assert errors.rmse <= 0.2


@pytest.mark.slow
def test_a_mower_among_beacons_finds_how_much_too_long_its_ranges_are() -> None:
    mission = gn.open_mission(Path(gtsam.findExampleDataFile("Plaza2_.mat")))
    solution = gn.estimate(mission, "graph", SLAM)
    errors = gn.evaluate(solution).ate.se2
    assert errors is not None
    assert errors.rmse <= 0.35
    assert solution.slow_states is not None
    scale, sigma = solution.slow_states.columns["landmarks_range_scale"]
    assert abs(scale[0] - 0.07) < 3 * sigma[0]
