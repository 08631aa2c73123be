"""Pose graphs as g2o."""

from __future__ import annotations

from pathlib import Path

import gtsam
import numpy as np
import pytest
import solutions

from gtsam_nav.errors import DataError
from gtsam_nav.frames import ENU_FROM_NED, FLU_FROM_FRD, rotation_from_quaternion
from gtsam_nav.solution import PoseGraph
from gtsam_nav.writers.pose_graph import read_pose_graph, write_g2o, write_vertex_times


@pytest.fixture
def graph() -> PoseGraph:
    return solutions.pose_graph(solutions.true_trajectory(np.arange(0.0, 600.0, 10.0)))


def test_round_trip(graph: PoseGraph, tmp_path: Path) -> None:
    write_g2o(graph, tmp_path / "graph.g2o")
    write_vertex_times(graph, tmp_path / "vertex_times.csv")
    back = read_pose_graph(tmp_path / "graph.g2o", tmp_path / "vertex_times.csv")
    np.testing.assert_array_equal(back.t, graph.t)
    np.testing.assert_array_equal(back.p_n, graph.p_n)
    np.testing.assert_allclose(back.q_nb_wxyz, graph.q_nb_wxyz, atol=1e-12)
    assert [(e.a, e.b) for e in back.edges] == [(e.a, e.b) for e in graph.edges]
    for read, written in zip(back.edges, graph.edges, strict=True):
        np.testing.assert_array_equal(read.p_a, written.p_a)
        np.testing.assert_allclose(read.R_ab, written.R_ab, atol=1e-12)
        np.testing.assert_array_equal(read.information, written.information)


def test_gtsam_reads_the_same_factors(graph: PoseGraph, tmp_path: Path) -> None:
    write_g2o(graph, tmp_path / "graph.g2o")
    factors, values = gtsam.readG2o(str(tmp_path / "graph.g2o"), True)
    assert factors.size() == len(graph.edges)
    R_nb = rotation_from_quaternion(graph.q_nb_wxyz)
    for k in range(len(graph.t)):
        vertex = values.atPose3(k)
        np.testing.assert_allclose(vertex.translation(), graph.p_n[k], atol=1e-9)
        np.testing.assert_allclose(vertex.rotation().matrix(), R_nb[k], atol=1e-9)
    for k, edge in enumerate(graph.edges):
        factor = factors.at(k)
        assert list(factor.keys()) == [edge.a, edge.b]
        np.testing.assert_allclose(factor.measured().translation(), edge.p_a, atol=1e-9)
        np.testing.assert_allclose(
            factor.noiseModel().information(), edge.information, rtol=1e-6, atol=1e-6
        )
    assert factors.error(values) < 1e-12


def test_enu_edges_still_fit_enu_vertices(graph: PoseGraph, tmp_path: Path) -> None:
    write_g2o(graph, tmp_path / "enu.g2o", "enu")
    factors, values = gtsam.readG2o(str(tmp_path / "enu.g2o"), True)
    assert factors.error(values) < 1e-12
    R_nb = rotation_from_quaternion(graph.q_nb_wxyz)
    for k in (0, 7):
        vertex = values.atPose3(k)
        np.testing.assert_allclose(vertex.translation(), ENU_FROM_NED @ graph.p_n[k], atol=1e-9)
        np.testing.assert_allclose(
            vertex.rotation().matrix(), ENU_FROM_NED @ R_nb[k] @ FLU_FROM_FRD, atol=1e-9
        )


def test_enu_information_weighs_the_same_error_the_same(graph: PoseGraph, tmp_path: Path) -> None:
    """A vertex that is moved alike in both frames costs alike."""
    costs = []
    for frame in ("ned", "enu"):
        write_g2o(graph, tmp_path / "g.g2o", frame)  # type: ignore[arg-type]
        factors, values = gtsam.readG2o(str(tmp_path / "g.g2o"), True)
        step_b = np.array([0.1, 0.2, 0.3])
        turn_b = np.array([0.01, 0.02, 0.03])
        flip = FLU_FROM_FRD if frame == "enu" else np.eye(3)
        delta = gtsam.Pose3(gtsam.Rot3.Expmap(flip @ turn_b), flip @ step_b)
        values.update(3, values.atPose3(3).compose(delta))
        costs.append(factors.error(values))
    assert costs[0] > 1.0
    assert costs[1] == pytest.approx(costs[0], rel=1e-9)


def test_a_graph_without_edges_has_vertices(graph: PoseGraph, tmp_path: Path) -> None:
    lonely = PoseGraph(graph.t, graph.p_n, graph.q_nb_wxyz, ())
    write_g2o(lonely, tmp_path / "graph.g2o")
    lines = (tmp_path / "graph.g2o").read_text().splitlines()
    assert len(lines) == len(graph.t)


@pytest.mark.parametrize("line", ["VERTEX_SE3:QUAT 0 1", "EDGE_SE2 0 1 2", "VERTEX_SE3:QUAT x"])
def test_other_lines_are_data_errors(tmp_path: Path, line: str) -> None:
    (tmp_path / "graph.g2o").write_text(line + "\n")
    with pytest.raises(DataError, match=r"graph\.g2o:1: "):
        read_pose_graph(tmp_path / "graph.g2o", tmp_path / "vertex_times.csv")
