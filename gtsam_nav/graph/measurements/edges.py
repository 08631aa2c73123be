"""Edges of a pose graph between the keyframes at its poses."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import gtsam
import numpy as np

from gtsam_nav.config import Config
from gtsam_nav.frames import Array
from gtsam_nav.graph import factors
from gtsam_nav.graph.factors import X
from gtsam_nav.graph.problem import Problem
from gtsam_nav.graph.readings import StateAt
from gtsam_nav.graph.robust import Robustness
from gtsam_nav.graph.scan_matching import LOOP
from gtsam_nav.mission import Mission
from gtsam_nav.preprocess.edge_motion import moves_by_edges
from gtsam_nav.sensors.odometry import velocity_sensor
from gtsam_nav.series import BoolArray
from gtsam_nav.trajectory import SAME_TIME_S


@dataclass(frozen=True)
class KeyframeEdge:
    """Keyframe b in the axes of keyframe a, with its information as `PoseEdges` has it; ``row`` is
    its place among the mission's edges."""

    a: int
    b: int
    R_ab: Array
    p_a: Array
    information: Array
    row: int

    @property
    def is_loop(self) -> bool:
        """Whether the keyframes do not follow each other."""
        return abs(self.b - self.a) > 1

    @cached_property
    def root(self) -> Array:
        """Of the information, shape (6, 6)."""
        tells = np.flatnonzero(np.diagonal(self.information))
        root = np.zeros((6, 6))
        own = np.ix_(tells, tells)
        root[own] = np.linalg.cholesky(self.information[own]).T
        return root

    @cached_property
    def factor(self) -> Any:
        """As a factor with Gaussian noise."""
        return factors.stated_pose(X(self.a), X(self.b), self.R_ab, self.p_a, self.root)

    def by_logarithm(self, state_at: StateAt) -> Any:
        """The factor near given states whose residual is the logarithm, on SE(3), of the pose of b
        in where it should be, as GTSAM's graphs of poses have it.

        That of two NavStates takes turn and shift apart; value and derivative are made the same.
        """
        a, b = (state_at(X(k)).pose() for k in (self.a, self.b))
        R_ab, p_a = a.rotation().matrix().T @ b.rotation().matrix(), a.transformTo(b.translation())
        stated = gtsam.Pose3(gtsam.Rot3(self.R_ab), self.p_a)
        error = gtsam.Pose3.Logmap(stated.between(a.between(b)))
        apart = np.zeros((6, 6))
        apart[:3, :3] = gtsam.Rot3.LogmapDerivative(error[:3])
        apart[3:, 3:] = gtsam.Rot3.Expmap(error[:3]).matrix()
        into_log = gtsam.Pose3.LogmapDerivative(error) @ np.linalg.inv(apart)
        shifted = p_a - R_ab @ error[3:]
        return factors.stated_pose(X(self.a), X(self.b), self.R_ab, shifted, self.root @ into_log)

    def weight_at(self, values: Any, robustness: Robustness) -> float:
        """What a kernel leaves of the edge at given values."""
        residual = float(np.linalg.norm(self.factor.whitenedError(values)))
        return factors.weight(robustness, residual)


def keyframe_edges(t_keyframes: Array, mission: Mission) -> Iterator[KeyframeEdge]:
    """The mission's edges whose poses are keyframes."""
    edges = mission.edges
    if edges is None:
        return
    t = edges.t
    nearest = np.searchsorted(0.5 * (t_keyframes[1:] + t_keyframes[:-1]), t, side="right")
    there = np.all(np.abs(t_keyframes[nearest] - t) < SAME_TIME_S, axis=1)
    for n in np.flatnonzero(there).tolist():
        a, b = nearest[n].tolist()
        yield KeyframeEdge(a, b, edges.R_ab[n], edges.p_a[n], edges.information[n], n)


def joined(t_keyframes: Array, mission: Mission) -> BoolArray:
    """Which intervals between keyframes an edge spans, shape (n - 1,): no need of odometry."""
    spanned = np.zeros(len(t_keyframes) - 1, dtype=bool)
    for edge in keyframe_edges(t_keyframes, mission):
        if not edge.is_loop:
            spanned[min(edge.a, edge.b)] = True
    return spanned


def left_open(t_keyframes: Array, mission: Mission) -> BoolArray:
    """Which intervals between keyframes no reading of the velocity lies in, shape (n - 1,), where
    edges lead from each keyframe to all others: nothing need be made up for them."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    n, sensor = len(t_keyframes), velocity_sensor(mission)
    ends = np.array([(edge.a, edge.b) for edge in keyframe_edges(t_keyframes, mission)])
    if sensor is None or not len(ends):
        return np.zeros(n - 1, dtype=bool)
    together = coo_array((np.ones(len(ends)), ends.T.astype(np.int32)), shape=(n, n))
    if connected_components(together.tocsr(), directed=False)[0] > 1:
        return np.zeros(n - 1, dtype=bool)
    before = np.searchsorted(sensor.series.t, t_keyframes)
    return np.asarray(np.diff(before) == 0)


def add(problem: Problem, mission: Mission, config: Config) -> None:
    """Every edge as it stands; those that close loops under the loops' kernel."""
    robust, are_all = config.graph.robust, moves_by_edges(mission)
    reached, loops = set(), 0
    for edge in keyframe_edges(problem.t, mission):
        kernel = robust.loops if edge.is_loop else robust.velocity
        sensor = LOOP if edge.is_loop else "velocity"
        entry = problem.add(max(edge.a, edge.b), sensor, edge.factor, kernel, edge.row)
        reached |= {edge.a, edge.b}
        loops += edge.is_loop
        if are_all:
            problem.exact.append((entry, edge.by_logarithm))
    problem.is_pose_graph = loops > 0 and len(reached) == len(problem.t)
