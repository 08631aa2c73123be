"""Depth below the surface."""

from __future__ import annotations

import numpy as np

from gtsam_nav.config import Config
from gtsam_nav.graph import factors
from gtsam_nav.graph.factors import X
from gtsam_nav.graph.problem import Problem
from gtsam_nav.mission import Mission
from gtsam_nav.sensors.silences import said_of_silences, speaks_at
from gtsam_nav.series import DepthSeries


def add(problem: Problem, mission: Mission, config: Config) -> None:
    """The depth at each keyframe but those within a silence of the sensor."""
    sensor = mission.first("depth")
    if sensor is None:
        return
    series = sensor.series
    assert isinstance(series, DepthSeries)
    depth_m, sigma = (np.interp(problem.t, series.t, of) for of in (series.depth_m, series.sigma))
    for k in np.flatnonzero(speaks_at(sensor, mission, problem.t)).tolist():
        factor = factors.depth(X(k), float(depth_m[k]), sensor.xyz_b, float(sigma[k]))
        row = series.row_nearest(problem.t[k])
        problem.add_gated(k, sensor.name, row, factor, config.graph.robust.depth)
    problem.warnings += said_of_silences(sensor, mission, "the other sensors carry the depth")
