"""The exported pose graph: the keyframes are at rest in it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import gtsam
import numpy as np

from gtsam_nav.frames import quaternion_from_rpy, rotation_from_rpy
from gtsam_nav.graph.exported import edge_between
from gtsam_nav.solution import PoseGraph
from gtsam_nav.writers.pose_graph import write_g2o


def moved_by_levenberg_marquardt(graph: PoseGraph, path: Path) -> tuple[float, np.ndarray]:
    """Cost of a graph as written, and how far each vertex goes when it is solved, m."""
    write_g2o(graph, path)
    factors, values = gtsam.readG2o(str(path), True)
    hold = gtsam.noiseModel.Isotropic.Sigma(6, 1e-6)
    factors = gtsam.NonlinearFactorGraph(factors)
    factors.add(gtsam.PriorFactorPose3(0, values.atPose3(0), hold))
    solved = gtsam.LevenbergMarquardtOptimizer(factors, values).optimize()
    steps = [
        np.linalg.norm(solved.atPose3(k).translation() - values.atPose3(k).translation())
        for k in range(len(graph.t))
    ]
    return factors.error(values), np.array(steps)


def test_keyframes_are_at_rest_and_give_way_to_a_new_loop(tmp_path: Path) -> None:
    n = 40
    rng = np.random.default_rng(4)
    angle = np.linspace(0.0, 2 * np.pi, n)
    rpy = np.column_stack([0.1 * rng.standard_normal((n, 2)), angle + np.pi / 2])
    p_n = np.column_stack([10 * np.cos(angle), 10 * np.sin(angle), rng.standard_normal(n)])
    R_nb = rotation_from_rpy(rpy)
    poses = [gtsam.Pose3(gtsam.Rot3(R), p) for R, p in zip(R_nb, p_n, strict=True)]
    information = np.diag([1e5] * 3 + [1e3] * 3)
    pairs = [*((k, k + 1) for k in range(n - 1)), (3, 37), (10, 30)]
    edges = [edge_between(poses, a, b, information) for a, b in pairs]
    graph = PoseGraph(np.arange(float(n)), p_n, quaternion_from_rpy(rpy), tuple(edges))
    cost, moved = moved_by_levenberg_marquardt(graph, tmp_path / "graph.g2o")
    assert cost < 1e-12
    assert moved.max() < 1e-6
    end = edge_between(poses, 0, n - 1, information)
    further = replace(graph, edges=(*edges, replace(end, p_a=end.p_a + np.array([0.5, 0, 0]))))
    assert moved_by_levenberg_marquardt(further, tmp_path / "graph.g2o")[1].max() > 0.05
