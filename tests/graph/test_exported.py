"""The exported pose graph: the keyframes are at rest in it, under loops that pull."""

from __future__ import annotations

from pathlib import Path

import gtsam
import numpy as np
from scipy.spatial.transform import Rotation

from gtsam_nav.frames import quaternion_from_rpy
from gtsam_nav.graph.exported import balanced_chain
from gtsam_nav.solution import PoseGraph, PoseGraphEdge
from gtsam_nav.trajectory import Trajectory
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


def test_keyframes_are_at_rest_under_loops_that_disagree(tmp_path: Path) -> None:
    n = 40
    rng = np.random.default_rng(4)
    angle = np.linspace(0.0, 2 * np.pi, n)
    tilt = 0.1 * rng.standard_normal((n, 2))
    keyframes = Trajectory(
        t=np.arange(float(n)),
        p_n=np.column_stack([10 * np.cos(angle), 10 * np.sin(angle), rng.standard_normal(n)]),
        q_nb_wxyz=quaternion_from_rpy(np.column_stack([tilt, angle + np.pi / 2])),
    )
    joined = []
    for a, b in [(0, 39), (3, 37), (10, 30), (5, 6)]:
        R_a, R_b = keyframes.R_nb[[a, b]]
        off = Rotation.from_rotvec(0.01 * rng.standard_normal(3)).as_matrix()
        p_a = R_a.T @ (keyframes.p_n[b] - keyframes.p_n[a]) + 0.1 * rng.standard_normal(3)
        root = rng.standard_normal((6, 6)) * np.repeat([30.0, 3.0], 3)[:, None]
        joined.append(PoseGraphEdge(a, b, R_a.T @ R_b @ off, p_a, root @ root.T))
    information = [np.diag([1e5] * 3 + [1e3] * 3)] * (n - 1)
    poses = [
        gtsam.Pose3(gtsam.Rot3(R), p) for R, p in zip(keyframes.R_nb, keyframes.p_n, strict=True)
    ]
    chain = balanced_chain(poses, information, joined)
    assert [(edge.a, edge.b) for edge in chain] == [(k, k + 1) for k in range(n - 1)]
    graph = PoseGraph(keyframes.t, keyframes.p_n, keyframes.q_nb_wxyz, (*chain, *joined))
    cost, moved = moved_by_levenberg_marquardt(graph, tmp_path / "graph.g2o")
    assert cost > 5.0
    assert moved.max() < 2e-3
    # which it would not be if the motion were the estimated one
    estimated = balanced_chain(poses, information, [])
    pulled = PoseGraph(keyframes.t, keyframes.p_n, keyframes.q_nb_wxyz, (*estimated, *joined))
    assert moved_by_levenberg_marquardt(pulled, tmp_path / "graph.g2o")[1].max() > 0.05
