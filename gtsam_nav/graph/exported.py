"""The pose graph that others read: keyframes, and edges whose optimum they are.

The graph that was solved has velocities, biases and absolute sensors, and its refinement registers
the echoes of all scans anew; a graph of poses has no place for these. What is exported stands for
it at the solution. The relative pose of every edge is the estimated one; its information is that of
what tied the two keyframes together:

- the motion sensors between neighbours;
- a match that was accepted, times what the robust kernel left of it in the solution. What it had
  registered stands in ``loops.csv``;
- an edge of a mission that is a pose graph, so too.

A planar match knows neither the tilt nor the depth between its ends; its information on these
vanishes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from gtsam_nav.frames import Array, quaternion_from_rotation, rotation_from_rpy
from gtsam_nav.graph import factors
from gtsam_nav.graph.cloud_loops import CloudLoop, loop_weight
from gtsam_nav.graph.factors import X
from gtsam_nav.graph.measurements.edges import KeyframeEdge
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
    stated: Sequence[KeyframeEdge],
    robustness: Robustness,
) -> PoseGraph:
    """Keyframes with the motion between them, all accepted matches and stated edges, for export."""
    poses = [values.atNavState(X(k)).pose() for k in range(len(problem.t))]
    joined = {max(e.a, e.b) for e in stated if not e.is_loop}
    moved = {d.k for d in problem.displacements} | {step.k for step in problem.steps if step}
    edges = [
        edge_between(poses, k - 1, k, _motion_information(problem, k))
        for k in sorted(moved - joined)
    ]
    for e in stated:
        weight = e.weight_at(values, robustness) if e.is_loop else 1.0
        edges.append(edge_between(poses, e.a, e.b, _vaguely_complete(weight * e.information)))
    for m in matches:
        if m.accepted:
            a, b = (int(scan_keyframe[s]) for s in (m.a, m.b))
            weight = match_weight(m, scan_keyframe, values, robustness)
            information = weight * _planar_information(m.match.q, m.match.cov)
            edges.append(edge_between(poses, a, b, information))
    for loop in cloud_loops:
        if loop.accepted:
            weight = loop_weight(loop, values, robustness)
            information = (weight * np.linalg.inv(loop.match.pose.cov)).astype(float)
            edges.append(edge_between(poses, loop.a, loop.b, information))
    return PoseGraph(
        t=problem.t,
        p_n=np.array([pose.translation() for pose in poses]),
        q_nb_wxyz=quaternion_from_rotation(np.array([p.rotation().matrix() for p in poses])),
        edges=tuple(edges),
    )


def edge_between(poses: list[Any], a: int, b: int, information: Array) -> PoseGraphEdge:
    """The edge that holds pose b where it is in pose a."""
    T_ab = poses[a].between(poses[b])
    return PoseGraphEdge(a, b, T_ab.rotation().matrix(), T_ab.translation(), information)


def match_weight(
    m: ScanMatch, scan_keyframe: IntArray, values: Any, robustness: Robustness
) -> float:
    """What the robust kernel leaves of a match at given values."""
    a, b = (X(int(scan_keyframe[s])) for s in (m.a, m.b))
    whitened = factors.planar_match(a, b, m.match.q, m.match.cov).whitenedError(values)
    return factors.weight(robustness, float(np.linalg.norm(whitened)))


def _motion_information(problem: Problem, k: int) -> Array:
    """Of the motion sensors from keyframe k - 1 to k."""
    start, stop = problem.t[k - 1], problem.t[k]
    yaw_variance = problem.motion.yaw_variance_rad2_s * float(stop - start)
    position_variance = float(problem.motion.displacement_variance(start, stop))
    return np.diag(1.0 / np.array([yaw_variance] * 3 + [position_variance] * 3))


def _planar_information(q: Array, cov: Array) -> Array:
    """Of a planar pose, along the axes at that pose, as an edge has it."""
    turn = np.eye(3)
    turn[:2, :2] = rotation_from_rpy([0.0, 0.0, q[2]])[:2, :2]
    planar = [3, 4, 2]
    information = np.zeros((6, 6))
    information[np.ix_(planar, planar)] = turn.T @ np.linalg.inv(cov) @ turn
    return _vaguely_complete(information)


def _vaguely_complete(information: Array) -> Array:
    """With next to none instead of none."""
    return information + np.diag(UNKNOWN * (np.diagonal(information) == 0))
