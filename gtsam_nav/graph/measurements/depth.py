"""Depth below the surface."""

from __future__ import annotations

from gtsam_nav.config import Config
from gtsam_nav.frames import sag_m
from gtsam_nav.graph import factors
from gtsam_nav.graph.factors import X
from gtsam_nav.graph.problem import Problem
from gtsam_nav.mission import Mission
from gtsam_nav.sensors.depth import depths_at


def add(problem: Problem, mission: Mission, config: Config) -> None:
    """The depth at each keyframe."""
    sensor = mission.first("depth")
    if sensor is None:
        return
    depth_m, sigma = depths_at(sensor, problem.t)
    # where the vehicle is, as near as its first guess knows, the water lies so deep
    down_m = depth_m + sag_m(problem.p_n, problem.origin)
    for k, t in enumerate(problem.t.tolist()):
        factor = factors.depth(X(k), float(down_m[k]), sensor.xyz_b, float(sigma[k]))
        row = sensor.series.row_nearest(t)
        problem.add_gated(k, sensor.name, row, factor, config.graph.robust.depth)
