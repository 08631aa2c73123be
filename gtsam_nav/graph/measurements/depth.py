"""Depth below the surface."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gtsam_nav.config import Config
from gtsam_nav.frames import Array, rotation_from_rpy, sag_m
from gtsam_nav.graph import factors
from gtsam_nav.graph.factors import X
from gtsam_nav.graph.problem import Problem
from gtsam_nav.mission import Mission
from gtsam_nav.sensors.depth import depths_at
from gtsam_nav.sensors.silences import said_of_silences, speaks_at
from gtsam_nav.series import BoolArray, DepthSeries, GnssSeries

LEAST_COMPARED = 10
"""Fixes beside a depth sensor that tell where on its scale a receiver has its zero."""


def add(problem: Problem, mission: Mission, config: Config) -> None:
    """The depth at each keyframe but those within a silence of the sensor."""
    sensor = mission.first("depth")
    if sensor is None:
        return
    depth_m, sigma = depths_at(sensor, problem.t)
    # where the vehicle is, as near as its first guess knows, the water lies so deep
    down_m = depth_m + sag_m(problem.p_n, problem.origin)
    for k in np.flatnonzero(speaks_at(sensor, mission, problem.t)).tolist():
        factor = factors.depth(X(k), float(down_m[k]), sensor.xyz_b, float(sigma[k]))
        row = sensor.series.row_nearest(problem.t[k])
        problem.add_gated(k, sensor.name, row, factor, config.graph.robust.depth)
    problem.warnings += said_of_silences(sensor, mission, "the other sensors carry the depth")


def tells_depth_at(mission: Mission, t: Array) -> BoolArray:
    """At which times (n,) a depth sensor tells the depth."""
    sensor = mission.first("depth")
    return np.zeros(len(t), dtype=bool) if sensor is None else speaks_at(sensor, mission, t)


def beside_gauge(
    problem: Problem, mission: Mission, antenna_b: Array, fixes: GnssSeries
) -> tuple[GnssSeries, BoolArray]:
    """Fixes whose heights are on the scale of the depth sensor, and which of these give way to it.

    A receiver's zero need not lie on the water: all give way where too few tell how far off it is.
    """
    sensor = mission.first("depth")
    if sensor is None:
        return fixes, np.zeros(len(fixes), dtype=bool)
    told = speaks_at(sensor, mission, fixes.t)
    if np.all(told) or np.count_nonzero(told) < LEAST_COMPARED:
        return fixes, np.ones(len(fixes), dtype=bool)
    series = sensor.series
    assert isinstance(series, DepthSeries)
    _, rpy = problem.motion.at(fixes.t)
    below_m = rotation_from_rpy(rpy)[:, 2] @ (antenna_b - sensor.xyz_b)
    sea_m = sag_m(fixes.p_n, problem.origin)
    antenna_m = sea_m + np.interp(fixes.t, series.t, series.depth_m) + below_m
    zero_m = np.median((fixes.p_n[:, 2] - antenna_m)[told])
    return replace(fixes, p_n=fixes.p_n - [0.0, 0.0, zero_m]), told
