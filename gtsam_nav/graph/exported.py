"""The pose graph that others read: keyframes, and edges whose optimum they are.

The graph that was solved has velocities, biases and absolute sensors; a graph of poses has no place
for these. What is exported stands for it at the solution:

- a match that was accepted is an edge as it was registered, with its information times what the
  robust kernel left of it in the solution;
- the motion between neighbouring keyframes is an edge with the information of the motion sensors.
  Its relative pose is the one that all sensors together hold against the pull of the matches: the
  estimated one, less that pull times its own covariance. So the matches count once, and the
  keyframes are where the exported graph is at rest.

A planar match knows neither the tilt nor the depth between its ends; its information on these
vanishes.
"""

from __future__ import annotations

from typing import Any

import gtsam
import numpy as np

from gtsam_nav.frames import Array, quaternion_from_rotation, rotation_from_rpy
from gtsam_nav.graph import factors
from gtsam_nav.graph.cloud_loops import CloudLoop, loop_weight
from gtsam_nav.graph.factors import X
from gtsam_nav.graph.problem import Problem
from gtsam_nav.graph.robust import Robustness
from gtsam_nav.graph.scan_matching import ScanMatch
from gtsam_nav.series import IntArray
from gtsam_nav.solution import PoseGraph, PoseGraphEdge

UNKNOWN = 1e-6
"""Information of what a planar match says nothing about, 1/rad^2 and 1/m^2."""


def pose_graph(
    problem: Problem,
    values: Any,
    matches: list[ScanMatch],
    scan_keyframe: IntArray,
    cloud_loops: list[CloudLoop],
    robustness: Robustness,
) -> PoseGraph:
    """Keyframes with the motion between them and all accepted matches, for export."""
    joined = [
        _planar_edge(m, scan_keyframe, match_weight(m, scan_keyframe, values, robustness))
        for m in matches
        if m.accepted
    ]
    joined += [
        _cloud_edge(loop, loop_weight(loop, values, robustness))
        for loop in cloud_loops
        if loop.accepted
    ]
    poses = [values.atNavState(X(k)).pose() for k in range(len(problem.t))]
    motion = [_motion_information(problem, k) for k in range(1, len(problem.t))]
    return PoseGraph(
        t=problem.t,
        p_n=np.array([pose.translation() for pose in poses]),
        q_nb_wxyz=quaternion_from_rotation(np.array([p.rotation().matrix() for p in poses])),
        edges=(*balanced_chain(poses, motion, joined), *joined),
    )


def match_weight(
    m: ScanMatch, scan_keyframe: IntArray, values: Any, robustness: Robustness
) -> float:
    """What the robust kernel leaves of a match at given values."""
    a, b = (X(int(scan_keyframe[s])) for s in (m.a, m.b))
    whitened = factors.planar_match(a, b, m.match.q, m.match.cov).whitenedError(values)
    return factors.weight(robustness, float(np.linalg.norm(whitened)))


def balanced_chain(
    poses: list[Any], information: list[Array], joined: list[PoseGraphEdge]
) -> list[PoseGraphEdge]:
    """Edges between neighbours under which the other edges leave the poses where they are.

    From the last pose on, an edge holds all the gradient that the edges beyond and across it
    have there: ``z = T_ab Exp(I^-1 g_b)``, and what it passes on is ``g_a + Ad(T_ba)' g_b``.
    """
    pull = _gradients(poses, joined)
    chain = []
    for b in range(len(poses) - 1, 0, -1):
        T_ab = poses[b - 1].between(poses[b])
        measured = T_ab.compose(gtsam.Pose3.Expmap(np.linalg.solve(information[b - 1], pull[b])))
        pull[b - 1] += T_ab.inverse().AdjointMap().T @ pull[b]
        R_ab, p_a = measured.rotation().matrix(), measured.translation()
        chain.append(PoseGraphEdge(b - 1, b, R_ab, p_a, information[b - 1]))
    return chain[::-1]


def _gradients(poses: list[Any], edges: list[PoseGraphEdge]) -> Array:
    """Gradient of the edges' cost by a turn and a shift of each pose along its axes, (n, 6)."""
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for k, pose in enumerate(poses):
        values.insert(k, pose)
    for edge in edges:
        measured = gtsam.Pose3(gtsam.Rot3(edge.R_ab), edge.p_a)
        noise = gtsam.noiseModel.Gaussian.Information(edge.information)
        graph.add(gtsam.BetweenFactorPose3(edge.a, edge.b, measured, noise))
    gradient = graph.linearize(values).gradientAtZero()
    touched = {k for edge in edges for k in (edge.a, edge.b)}
    return np.array([gradient.at(k) if k in touched else np.zeros(6) for k in range(len(poses))])


def _motion_information(problem: Problem, k: int) -> Array:
    """Of the motion sensors from keyframe k - 1 to k."""
    start, stop = problem.t[k - 1], problem.t[k]
    yaw_variance = problem.motion.yaw_variance_rad2_s * float(stop - start)
    position_variance = float(problem.motion.displacement_variance(start, stop))
    return np.diag(1.0 / np.array([yaw_variance] * 3 + [position_variance] * 3))


def _planar_edge(m: ScanMatch, scan_keyframe: IntArray, weight: float) -> PoseGraphEdge:
    """A planar match as a spatial edge."""
    R_ab = rotation_from_rpy([0.0, 0.0, m.match.q[2]])
    # an edge errs along the axes of b: turn the information into these
    turn = np.eye(3)
    turn[:2, :2] = R_ab[:2, :2]
    planar = [3, 4, 2]
    information = UNKNOWN * np.eye(6)
    information[np.ix_(planar, planar)] = weight * turn.T @ np.linalg.inv(m.match.cov) @ turn
    a, b = (int(scan_keyframe[s]) for s in (m.a, m.b))
    return PoseGraphEdge(a, b, R_ab, np.array([m.match.q[0], m.match.q[1], 0.0]), information)


def _cloud_edge(loop: CloudLoop, weight: float) -> PoseGraphEdge:
    pose = loop.match.pose
    information = (weight * np.linalg.inv(pose.cov)).astype(float)
    return PoseGraphEdge(loop.a, loop.b, pose.R_ab, pose.p_a, information)
