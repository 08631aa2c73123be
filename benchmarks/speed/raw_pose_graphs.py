"""Pose graphs as GTSAM itself reads and solves them."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gtsam
import numpy as np

import gtsam_nav as gn
from gtsam_nav.frames import FLU_FROM_FRD, Array
from gtsam_nav.sensors.noise import LandmarkNoise, OdometryNoise

CITY_INFORMATION = "900 0 0 900 0 10000"
"""Of 1/30 m, 1/30 m and 1/100 rad, as in GTSAM's own example."""
LANDMARK = ord("l")


def city_lines(lines: Iterable[str], poses: int) -> Iterator[str]:
    """The edges among the first poses of city10000 as g2o; of several hypotheses the first."""
    for line in lines:
        _, a, _, b, _, _, x, y, theta, *_ = line.split()
        if max(int(a), int(b)) < poses:
            yield f"EDGE_SE2 {a} {b} {x} {y} {theta} {CITY_INFORMATION}\n"


def read_raw(path: Path) -> Any:
    """The factors that GTSAM reads."""
    with path.open(encoding="ascii") as stream:
        words = {stream.readline().split()[0]} | {stream.readline().split()[0]}
    if path.suffix == ".txt":
        return (gtsam.load3D if "EDGE3" in words else gtsam.load2D)(str(path))[0]
    return gtsam.readG2o(str(path), bool({"EDGE_SE3:QUAT", "VERTEX_SE3:QUAT"} & words))[0]


@dataclass(frozen=True)
class RawGraph:
    """A graph of Pose2 or Pose3, and where its odometry and first sightings put everything; the
    numbers of its poses in order."""

    graph: Any
    start: Any
    poses: list[int]
    in_space: bool

    @classmethod
    def of(cls, factors: Any, mission: gn.Mission) -> RawGraph:
        """With the noise of the mission's card, where there is one, as our reader has it."""
        in_space = isinstance(factors.at(0), gtsam.BetweenFactorPose3)
        if mission.first("landmarks") is not None:
            factors = _with_noise_of(mission, factors)
        keys = set(
            itertools.chain.from_iterable(factors.at(n).keys() for n in range(factors.size()))
        )
        poses = sorted(key for key in keys if gtsam.Symbol(key).chr() != LANDMARK)
        return cls(factors, _start(factors, poses, in_space), poses, in_space)

    def optimum(self) -> Any:
        """By Levenberg-Marquardt, the first pose held."""
        anchored, first = gtsam.NonlinearFactorGraph(self.graph), self.poses[0]
        if self.in_space:
            anchored.push_back(gtsam.NonlinearEqualityPose3(first, gtsam.Pose3()))
        else:
            anchored.push_back(gtsam.NonlinearEqualityPose2(first, gtsam.Pose2()))
        return gtsam.LevenbergMarquardtOptimizer(anchored, self.start).optimize()

    def start_in_ned(self, k: int) -> tuple[Array, Array]:
        """Attitude and place of the k-th pose at the start, as our reader turns the axes."""
        key = self.poses[k]
        pose = self.start.atPose3(key) if self.in_space else _raised(self.start.atPose2(key))
        R = FLU_FROM_FRD @ pose.rotation().matrix() @ FLU_FROM_FRD
        return R, FLU_FROM_FRD @ pose.translation()

    def values(self, R_nb: Array, p_n: Array) -> Any:
        """Attitudes (n, 3, 3) and places (n, 3) of all poses in the file's axes."""
        values = gtsam.Values()
        turned = FLU_FROM_FRD @ R_nb @ FLU_FROM_FRD
        for key, R, p in zip(self.poses, turned, p_n, strict=True):
            pose = gtsam.Pose3(gtsam.Rot3(R), FLU_FROM_FRD @ p)
            if self.in_space:
                values.insert(key, pose)
            else:
                x, y, _ = pose.translation()
                values.insert(key, gtsam.Pose2(x, y, pose.rotation().yaw()))
        return values


def _raised(pose: Any) -> Any:
    return gtsam.Pose3(gtsam.Rot3.Yaw(pose.theta()), np.array([pose.x(), pose.y(), 0.0]))


def _with_noise_of(mission: gn.Mission, factors: Any) -> Any:
    """The same measurements with the noise of the mission's sensors."""
    steps = OdometryNoise.model_validate(mission.sensors["odometry"].noise)
    sightings = LandmarkNoise.model_validate(mission.sensors["landmarks"].noise)
    moved, turned = steps.sigma_v_m_s, steps.sigma_yaw_rate_rad_s
    step_noise = gtsam.noiseModel.Diagonal.Sigmas(np.array([moved, moved, turned]))
    polar = np.array([np.radians(sightings.sigma_bearing_deg), sightings.sigma_range_m])
    sighting_noise = gtsam.noiseModel.Diagonal.Sigmas(polar)
    graph = gtsam.NonlinearFactorGraph()
    for n in range(factors.size()):
        is_step = isinstance(factors.at(n), gtsam.BetweenFactorPose2)
        graph.push_back(
            factors.at(n).cloneWithNewNoiseModel(step_noise if is_step else sighting_noise)
        )
    return graph


def _start(graph: Any, poses: list[int], in_space: bool) -> Any:
    """The poses along the tree of the edges between poses as near as there are (the chain, where
    neighbours are joined), and landmarks where first seen."""
    values = gtsam.Values()
    values.insert(poses[0], gtsam.Pose3() if in_space else gtsam.Pose2())
    pose_at = values.atPose3 if in_space else values.atPose2
    factors = [graph.at(n) for n in range(graph.size())]
    joining: dict[int, list[tuple[int, int]]] = {pose: [] for pose in poses}
    for n, factor in enumerate(factors):
        a, b = factor.keys()
        if b in joining:
            joining[a].append((abs(b - a), n))
            joining[b].append((abs(b - a), n))
    near = sorted(joining[poses[0]])
    while near:
        factor = factors[heapq.heappop(near)[1]]
        (a, b), step = factor.keys(), factor.measured()
        if values.exists(b):
            a, b, step = b, a, step.inverse()
        if values.exists(b):
            continue
        values.insert(b, pose_at(a).compose(step))
        for edge in joining[b]:
            heapq.heappush(near, edge)
    if apart := [pose for pose in poses if not values.exists(pose)]:
        raise ValueError(f"no edges lead from pose {poses[0]} to pose {apart[0]}")
    for factor in factors:
        a, b = factor.keys()
        if gtsam.Symbol(b).chr() == LANDMARK and not values.exists(b):
            seen = factor.measured()
            ray = seen.range() * seen.bearing().matrix()[:, 0]
            values.insert(b, pose_at(a).transformFrom(ray))
    return values
