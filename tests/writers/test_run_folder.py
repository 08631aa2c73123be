"""A run's folder: complete, equal for equal runs, whole or not at all."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import solutions
import yaml

import gtsam_nav
from gtsam_nav.config import Config
from gtsam_nav.errors import DataError, OutputError
from gtsam_nav.evaluation.metrics import evaluate
from gtsam_nav.evaluation.settings import EvaluationSettings
from gtsam_nav.writers import run_folder
from gtsam_nav.writers.run_folder import find_runs, read_run, write_run

EVERYTHING = {
    "trajectory.tum", "trajectory.csv", "trajectory_online.csv", "nav.csv", "biases.csv",
    "loops.csv", "rejections.csv", "graph.g2o", "vertex_times.csv", "map.ply", "map.png",
    "map.pgw", "landmarks.csv", "track.geojson", "metrics.json", "config.yaml", "run.json",
}  # fmt: skip
CONFIG = Config(seed=7)


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    solution = solutions.graph_solution((Path(__file__),))
    out = tmp_path_factory.mktemp("out") / "deep"
    return write_run(solution, CONFIG, out, wall_s=10.0, command="gtsam-nav run m")


def test_a_full_run_has_every_file(run: Path) -> None:
    assert run.name == "graph"
    assert names(run) == EVERYTHING
    assert names(run.parent) == {"graph"}


def test_read_back(run: Path) -> None:
    solution = solutions.graph_solution()
    back = read_run(run)
    np.testing.assert_array_equal(back.trajectory.t, solution.trajectory.t)
    np.testing.assert_array_equal(back.trajectory.p_n, solution.trajectory.p_n)
    assert back.trajectory.cov_pose_n is not None
    assert back.metrics == evaluate(solution)
    assert back.name == "basin <laps> (graph)"
    assert back.record.origin == solution.mission.origin


def test_landmarks_are_written_with_their_covariance(run: Path) -> None:
    assert (run / "landmarks.csv").read_text().splitlines() == [
        "id,n,e,d,sigma_n,sigma_e,sigma_d,cov_ne",
        "7,10.000000,20.000000,1.000000,0.2,0.2,0,0",
        "3,-30.000000,5.000000,1.000000,0.1,1,0,0",
        "12,0.000000,-12.500000,2.000000,0.5,0.5,0.5,0.2",
    ]


def test_the_record_says_where_the_run_came_from(run: Path) -> None:
    record = read_run(run).record
    assert record.sources == {__file__: hashlib.sha256(Path(__file__).read_bytes()).hexdigest()}
    assert record.versions["gtsam_nav"] == gtsam_nav.__version__
    assert {"gtsam_nav", "gtsam", "numpy", "scipy", "numba", "python"} <= set(record.versions)
    assert record.seed == 7
    assert record.command == "gtsam-nav run m"
    assert record.sonar == "simulated"
    assert record.warnings == ("the sonar's echoes are simulated",)
    assert record.skipped == {}
    assert list(record.stage_s) == ["reading", "scans", "graph", "refinement"]


def test_writing_counts_into_the_wall_time(run: Path) -> None:
    record = read_run(run).record
    assert record.wall_s is not None
    assert 10.0 < record.wall_s < 40.0
    assert record.mission_s == pytest.approx(599.9)
    assert record.realtime_factor == pytest.approx(record.mission_s / record.wall_s)


def test_the_resolved_configuration_is_kept(run: Path) -> None:
    assert Config.model_validate(yaml.safe_load((run / "config.yaml").read_text())) == CONFIG


def test_equal_runs_differ_in_run_json_alone(run: Path, tmp_path: Path) -> None:
    solution = solutions.graph_solution((Path(__file__),))
    again = write_run(solution, CONFIG, tmp_path, wall_s=99.0)
    assert names(again) == EVERYTHING
    differ = {n for n in EVERYTHING if (run / n).read_bytes() != (again / n).read_bytes()}
    assert differ == {"run.json"}


def test_tables_hold_every_candidate_and_rejection(run: Path) -> None:
    solution = solutions.graph_solution()
    loops = (run / "loops.csv").read_text().splitlines()
    assert loops[0] == (
        "t_a,t_b,dx,dy,dyaw_deg,score,sigma_x,sigma_y,sigma_yaw_deg,verdict,reason,weight"
    )
    assert len(loops) == 1 + len(solution.loops)
    rejections = (run / "rejections.csv").read_text().splitlines()
    assert rejections[0] == "t,sensor,index,reason,normalised_residual"
    assert len(rejections) == 1 + len(solution.rejections)
    assert rejections[-1] == ',imu,3,"not finite: ""nan""",'
    biases = (run / "biases.csv").read_text().splitlines()
    assert biases[0] == (
        "t,heading_bias_rad,sigma_heading_bias_rad,gyro_z_rad_s,sigma_gyro_z_rad_s"
    )


def test_what_a_run_has_not_is_named_with_the_reason(tmp_path: Path) -> None:
    run = write_run(solutions.without_origin(solutions.dr_solution()), CONFIG, tmp_path)
    skipped = read_run(run).record.skipped
    assert set(skipped) == EVERYTHING - names(run)
    assert set(skipped) == {
        "trajectory_online.csv", "graph.g2o", "vertex_times.csv", "map.ply", "map.png", "map.pgw",
        "nav.csv", "track.geojson", "landmarks.csv",
    }  # fmt: skip
    assert "origin" in skipped["nav.csv"]
    assert (run / "loops.csv").read_text().count("\n") == 1
    assert (run / "biases.csv").read_text() == "t\n"
    assert read_run(run).record.wall_s is None


def test_an_empty_map_is_no_map(tmp_path: Path) -> None:
    graph = solutions.graph_solution()
    assert graph.sonar_map is not None
    empty = replace(graph.sonar_map, points_n=np.empty((0, 3)), t=np.empty(0), strength=np.empty(0))
    run = write_run(replace(graph, sonar_map=empty), CONFIG, tmp_path)
    assert read_run(run).record.skipped["map.png"] == "no echo was mapped"


def test_metrics_follow_the_window_of_the_configuration(tmp_path: Path) -> None:
    config = Config(evaluation=EvaluationSettings(window_s=(100.0, 200.0)))
    solution = solutions.dr_solution()
    run = write_run(solution, config, tmp_path)
    assert read_run(run).metrics == evaluate(solution, window_s=(100.0, 200.0))
    document = json.loads((run / "metrics.json").read_text())
    assert document["ate_online"] is None


def test_an_earlier_run_is_replaced(tmp_path: Path) -> None:
    old = write_run(solutions.graph_solution(), CONFIG, tmp_path)
    (old / "export").mkdir()
    new = write_run(solutions.graph_solution(), CONFIG, tmp_path)
    assert names(new) == EVERYTHING
    assert names(tmp_path) == {"graph"}


def test_what_is_not_a_run_is_never_replaced(tmp_path: Path) -> None:
    (tmp_path / "dr").mkdir()
    (tmp_path / "dr" / "thesis.tex").write_text("years of work")
    with pytest.raises(OutputError, match="not a run's folder"):
        write_run(solutions.dr_solution(), CONFIG, tmp_path)
    assert names(tmp_path / "dr") == {"thesis.tex"}
    assert names(tmp_path) == {"dr"}


def test_a_crash_leaves_the_old_run_and_no_half_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = write_run(solutions.dr_solution(), CONFIG, tmp_path)
    before = {name: (run / name).read_bytes() for name in names(run)}

    def crash(*_: object) -> None:
        raise RuntimeError("power cut")

    monkeypatch.setattr(run_folder, "write_nav", crash)
    with pytest.raises(RuntimeError, match="power cut"):
        write_run(solutions.dr_solution(), CONFIG, tmp_path)
    assert {name: (run / name).read_bytes() for name in names(run)} == before
    assert names(tmp_path) == {"dr"}


def test_an_unwritable_folder_is_an_output_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(OutputError, match="cannot write the run"):
        write_run(solutions.dr_solution(), CONFIG, tmp_path / "file")


def test_runs_are_found_at_a_run_or_above(run: Path, tmp_path: Path) -> None:
    assert find_runs(run) == [run]
    assert find_runs(run.parent) == [run]
    assert find_runs(run.parents[1]) == [run]
    for nothing in (tmp_path, tmp_path / "missing"):
        with pytest.raises(DataError, match="no run here"):
            find_runs(nothing)


def test_damaged_runs_are_data_errors(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"run\.json"):
        read_run(tmp_path)
    run = write_run(solutions.dr_solution(), CONFIG, tmp_path)
    (run / "metrics.json").write_text('{"ate": 3}')
    with pytest.raises(DataError, match=r"cannot read the metrics: [^\n]*$"):
        read_run(run)
