"""Pose graphs in space, of any attitude: their optimum is that of GTSAM's own graph of poses."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import gtsam
import numpy as np
import pytest

import gtsam_nav as gn
from gtsam_nav.errors import DataError
from gtsam_nav.evaluation.report import write_report
from gtsam_nav.frames import FLU_FROM_FRD, rotation_from_quaternion
from gtsam_nav.solution import Solution

LEAST_SQUARES = ("graph.robust.loops.kernel=none", "graph.robust.velocity.kernel=none")


def solved(path: Path, *overrides: str) -> Solution:
    return gn.estimate(gn.open_mission(path), "graph", gn.load_config(None, list(overrides)))


def poses_of(solution: Solution) -> Any:
    """The keyframes in the file's own axes: y to port and z up."""
    graph, values = solution.pose_graph, gtsam.Values()
    assert graph is not None
    R_nb = FLU_FROM_FRD @ rotation_from_quaternion(graph.q_nb_wxyz) @ FLU_FROM_FRD
    for k, (R, p) in enumerate(zip(R_nb, graph.p_n @ FLU_FROM_FRD, strict=True)):
        values.insert(k, gtsam.Pose3(gtsam.Rot3(R), p))
    return values


def optimum(graph: Any, poses: Any) -> float:
    """Sum of squares of GTSAM's own solution, from ours."""
    anchored = gtsam.NonlinearFactorGraph(graph)
    anchored.push_back(gtsam.NonlinearEqualityPose3(0, poses.atPose3(0)))
    best = gtsam.LevenbergMarquardtOptimizer(anchored, poses).optimize()
    return 2.0 * float(graph.error(best))


@pytest.fixture(scope="module")
def grid(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """27 poses that turn every way from one to the next, and loops among them."""
    path = tmp_path_factory.mktemp("grid") / "grid.g2o"
    shutil.copyfile(gtsam.findExampleDataFile("pose3example-grid.txt"), path)
    return path


@pytest.fixture(scope="module")
def solution(grid: Path) -> Solution:
    return solved(grid, *LEAST_SQUARES)


def test_the_optimum_is_gtsam_s(grid: Path, solution: Solution) -> None:
    graph, _ = gtsam.readG2o(str(grid), True)
    ours = poses_of(solution)
    assert 2.0 * graph.error(ours) == pytest.approx(optimum(graph, ours), rel=1e-6)
    assert solution.warnings == (
        "the graph has no clock: its poses are taken to be one second apart",
    )


def test_nothing_is_made_up_between_the_poses(solution: Solution) -> None:
    np.testing.assert_allclose(solution.trajectory.t, np.arange(27.0))
    pitch = solution.trajectory.rpy[:, 1]
    assert np.ptp(pitch) > 1.5
    assert solution.pose_graph is not None
    R_nb = rotation_from_quaternion(solution.pose_graph.q_nb_wxyz)
    np.testing.assert_allclose(solution.trajectory.R_nb, R_nb, atol=1e-9)


def test_every_edge_is_used_and_every_loop_told(solution: Solution) -> None:
    assert solution.pose_graph is not None
    assert len(solution.pose_graph.edges) == 44
    assert len(solution.loops) == 18
    first = solution.loops[0]
    assert (first.t_a, first.t_b, first.sigma_x_m) == (0.0, 5.0, pytest.approx(0.02))


def test_a_false_closure_is_left_without_weight(grid: Path, tmp_path: Path) -> None:
    figures = grid.read_text().splitlines()[-1].split()[10:]
    false = " ".join(["EDGE_SE3:QUAT 0 26 9 9 9 0 0 0 1", *figures])
    (tmp_path / "false.g2o").write_text(f"{grid.read_text()}{false}\n")
    bent, straight = solved(tmp_path / "false.g2o"), solved(grid)
    assert bent.loops[-1].weight == pytest.approx(0.0, abs=1e-3)
    np.testing.assert_allclose(bent.trajectory.p_n, straight.trajectory.p_n, atol=0.03)


def test_large_residuals_are_weighed_as_on_se3(tmp_path: Path) -> None:
    """Turns and shifts apart, as NavStates have them, lead to another optimum here."""
    source = Path(gtsam.findExampleDataFile("sphere2500.txt")).read_text(encoding="ascii")
    lines = [line for line in source.splitlines() if max(map(int, line.split()[1:3])) < 200]
    path = tmp_path / "cap.txt"
    path.write_text("\n".join(lines) + "\n")
    graph, _ = gtsam.load3D(str(path))
    ours = poses_of(solved(path, *LEAST_SQUARES))
    assert 2.0 * graph.error(ours) == pytest.approx(optimum(graph, ours), rel=1e-4)


def test_what_is_exported_reads_back_as_its_own_optimum(solution: Solution, tmp_path: Path) -> None:
    """In a file whose z points down, which is read as if it pointed up."""
    run = gn.write_run(solution, gn.load_config(None, list(LEAST_SQUARES)), tmp_path)
    again = solved(run / "graph.g2o", *LEAST_SQUARES)
    assert again.pose_graph is not None
    assert solution.pose_graph is not None
    np.testing.assert_allclose(
        again.pose_graph.p_n @ FLU_FROM_FRD, solution.pose_graph.p_n, atol=1e-5
    )


def test_a_stretch_of_a_graph_and_its_report(grid: Path, tmp_path: Path) -> None:
    stretch = gn.open_mission(grid).crop(5.0, 15.0)
    some = gn.estimate(stretch, "graph")
    assert some.n_keyframes == 10
    assert write_report([some], tmp_path).is_file()


def test_poses_that_no_edges_lead_to(tmp_path: Path) -> None:
    upper = " ".join(map(str, np.eye(6)[np.triu_indices(6)]))
    text = "".join(f"EDGE3 {a} {a + 1} 1 0 1 0 0 0 {upper}\n" for a in (0, 5, 6))
    (tmp_path / "parts.txt").write_text(text)
    message = "no edges lead from its first pose to 3 of 5 others, the first at 2.0 s"
    with pytest.raises(DataError, match=message):
        solved(tmp_path / "parts.txt")


def test_a_pose_is_reached_by_whatever_edge_there_is(tmp_path: Path) -> None:
    """Pose 1 hangs on pose 2, whose edge is stated backward."""
    upper = " ".join(map(str, 100 * np.eye(6)[np.triu_indices(6)]))
    edges = ["0 2 2 0 0 0 0 1", "2 1 0 0 -3 0 0 0"]
    (tmp_path / "tree.txt").write_text("".join(f"EDGE3 {e} {upper}\n" for e in edges))
    found = solved(tmp_path / "tree.txt").pose_graph
    assert found is not None
    np.testing.assert_allclose(found.p_n, [[0, 0, 0], [2, 0, 3], [2, 0, 0]], atol=1e-6)
    assert [(e.a, e.b) for e in found.edges] == [(0, 2), (2, 1)]


@pytest.mark.slow
def test_the_first_windings_of_the_sphere(tmp_path: Path) -> None:
    """`benchmarks.speed --only pose_graphs` has all of its 2500 poses."""
    whole = Path(gtsam.findExampleDataFile("sphere2500.txt")).read_text().splitlines()
    first = [line for line in whole if max(map(int, line.split()[1:3])) < 600]
    path = tmp_path / "sphere.txt"
    path.write_text("\n".join(first) + "\n")
    graph, _ = gtsam.load3D(str(path))
    ours = poses_of(solved(path, *LEAST_SQUARES))
    graph.push_back(
        gtsam.PriorFactorPose3(0, gtsam.Pose3(), gtsam.noiseModel.Isotropic.Sigma(6, 1e-3))
    )
    chordal = gtsam.InitializePose3.initialize(graph)
    assert 2.0 * graph.error(ours) == pytest.approx(optimum(graph, chordal), rel=2e-4)


@pytest.mark.parametrize("times", [1, 7], ids=["shifted", "shuffled"])
def test_the_order_of_the_poses_does_not_matter(
    grid: Path, solution: Solution, tmp_path: Path, times: int
) -> None:
    """The first poses are joined by later ones only."""
    lines = []
    for line in grid.read_text().splitlines():
        if line.startswith("EDGE"):
            word, *ends, rest = line.split(maxsplit=3)
            a, b = ((times * int(k) + 1) % 27 for k in ends)
            lines.append(f"{word} {a} {b} {rest}")
    (tmp_path / "shuffled.g2o").write_text("\n".join(lines) + "\n")
    graph, _ = gtsam.readG2o(str(tmp_path / "shuffled.g2o"), True)
    shuffled = solved(tmp_path / "shuffled.g2o", *LEAST_SQUARES)
    own, _ = gtsam.readG2o(str(grid), True)
    wanted = float(own.error(poses_of(solution)))
    assert float(graph.error(poses_of(shuffled))) == pytest.approx(wanted, rel=1e-4)
