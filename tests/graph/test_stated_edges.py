"""Pose graphs with loops: the least-squares optimum of their edges, closures and all."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import gtsam
import numpy as np
import pytest

import gtsam_nav as gn
from gtsam_nav.frames import rpy_from_quaternion
from gtsam_nav.graph.measurements.edges import left_open
from gtsam_nav.solution import Solution

SIDE = 3
LEAST_SQUARES = ("graph.robust.loops.kernel=none", "graph.robust.velocity.kernel=none")


@pytest.fixture(scope="module")
def square(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two rounds of a square with noise; the second round sees the first one's poses again."""
    rng, sigma = np.random.default_rng(1), np.array([0.05, 0.02, 0.02])
    information = 1.0 / sigma**2
    figures = f"{information[0]} 0 0 {information[1]} 0 {information[2]}"
    corner = [SIDE * (k + 1) - 1 for k in range(8)]
    true = gtsam.Pose2()
    poses = [true]
    for k in range(8 * SIDE):
        true = true.compose(gtsam.Pose2(1.0, 0.0, np.pi / 2 if k in corner else 0.0))
        poses.append(true)
    ends = [(k, k + 1) for k in range(8 * SIDE)]
    ends += [(k, k + 4 * SIDE) for k in range(4 * SIDE)]
    lines = []
    for a, b in ends:
        step = poses[a].between(poses[b]).compose(gtsam.Pose2(*(sigma * rng.normal(size=3))))
        lines.append(f"EDGE_SE2 {a} {b} {step.x()} {step.y()} {step.theta()} {figures}")
    path = tmp_path_factory.mktemp("square") / "square.g2o"
    path.write_text("\n".join(lines) + "\n")
    return path


def solved(path: Path, *overrides: str) -> Solution:
    return gn.estimate(gn.open_mission(path), "graph", gn.load_config(None, list(overrides)))


def poses_of(solution: Solution) -> Any:
    """The keyframes in the graph's own axes: y to port."""
    graph, values = solution.pose_graph, gtsam.Values()
    assert graph is not None
    yaw = rpy_from_quaternion(graph.q_nb_wxyz)[:, 2]
    for k, (p, turn) in enumerate(zip(graph.p_n, yaw.tolist(), strict=True)):
        values.insert(k, gtsam.Pose2(p[0], -p[1], -turn))
    return values


@pytest.fixture(scope="module")
def open_square(square: Path) -> Path:
    """The same, where no edge joins two poses that follow each other: closures hold them."""
    lines = square.read_text().splitlines(keepends=True)
    path = square.with_name("open.g2o")
    path.write_text("".join(line for line in lines if not line.startswith("EDGE_SE2 4 5 ")))
    return path


@pytest.mark.parametrize("name", ["square", "open_square"])
def test_the_optimum_is_that_of_plain_least_squares(
    name: str, request: pytest.FixtureRequest
) -> None:
    path = request.getfixturevalue(name)
    ours = poses_of(solved(path, *LEAST_SQUARES))
    graph, _ = gtsam.readG2o(str(path), False)
    anchored = gtsam.NonlinearFactorGraph(graph)
    anchored.push_back(gtsam.NonlinearEqualityPose2(0, ours.atPose2(0)))
    best = graph.error(gtsam.LevenbergMarquardtOptimizer(anchored, ours).optimize())
    assert graph.error(ours) == pytest.approx(best, rel=1e-3)


def test_every_closure_is_used_and_told(square: Path) -> None:
    solution = solved(square)
    assert len(solution.loops) == 4 * SIDE
    assert {loop.verdict for loop in solution.loops} == {"accepted"}
    first = solution.loops[0]
    assert (first.t_a, first.t_b) == (0.0, 4.0 * SIDE)
    assert first.weight is not None
    assert first.weight > 0.1
    assert solution.pose_graph is not None
    assert len(solution.pose_graph.edges) == 12 * SIDE


def test_no_edge_is_made_up_where_none_joins_two_poses(open_square: Path) -> None:
    graph = solved(open_square).pose_graph
    assert graph is not None
    assert len(graph.edges) == 12 * SIDE - 1
    assert (4, 5) not in {(edge.a, edge.b) for edge in graph.edges}


def test_an_interval_is_left_open_where_edges_lead_round_it_and_nothing_was_measured(
    open_square: Path,
) -> None:
    mission = gn.open_mission(open_square)
    assert mission.edges is not None
    t = np.unique(mission.edges.t)
    np.testing.assert_array_equal(np.flatnonzero(left_open(t, mission)), [4])
    few = replace(mission, edges=mission.edges.crop(0.0, SIDE + 0.5))
    assert not np.any(left_open(t, few))
    halfway = np.insert(t, 1, 0.25)  # no edge leads there
    np.testing.assert_array_equal(np.flatnonzero(left_open(halfway, mission)), [])


def test_what_is_exported_reads_back_as_its_own_optimum(square: Path, tmp_path: Path) -> None:
    config = gn.load_config(None, list(LEAST_SQUARES))
    solution = gn.estimate(gn.open_mission(square), "graph", config)
    gn.write_run(solution, config, tmp_path)
    again = solved(tmp_path / "graph" / "graph.g2o", *LEAST_SQUARES)
    assert again.pose_graph is not None
    assert solution.pose_graph is not None
    # the file's z points down, and a planar graph is taken to be drawn from above
    mirrored = solution.pose_graph.p_n * [1.0, -1.0, 1.0]
    np.testing.assert_allclose(again.pose_graph.p_n, mirrored, atol=2e-3)
