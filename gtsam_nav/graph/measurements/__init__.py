"""A mission's measurements as factors: one module a kind of sensor, `KINDS` the list of them."""

from __future__ import annotations

from collections.abc import Callable

from gtsam_nav.config import Config
from gtsam_nav.frames import Array
from gtsam_nav.graph.measurements import (
    constraints,
    depth,
    edges,
    gnss,
    imu,
    landmarks,
    orientation,
    start,
    velocity,
)
from gtsam_nav.graph.problem import Problem
from gtsam_nav.mission import Mission
from gtsam_nav.preprocess.alignment import Alignment
from gtsam_nav.preprocess.depth_by_ranges import depth_spread_m
from gtsam_nav.preprocess.fixes_by_ranges import fixes_by_ranges
from gtsam_nav.preprocess.motion import VehicleMotion, measures_velocity
from gtsam_nav.sensors.orientation import headings_true

KINDS: tuple[Callable[[Problem, Mission, Config], None], ...] = (
    start.add,
    velocity.add,
    edges.add,
    imu.add,
    orientation.add,
    depth.add,
    constraints.add,
    gnss.add,
    landmarks.add,
)
"""Each adds what the mission has of it."""


def build_problem(
    mission: Mission, alignment: Alignment, motion: VehicleMotion, t: Array, config: Config
) -> Problem:
    """All sensor factors of a mission on given keyframe times."""
    problem = Problem(
        t=t,
        alignment=alignment,
        motion=motion,
        uses_imu=imu.preintegrable(mission, config.graph.imu_min_rate_hz) is not None,
        has_compass=headings_true(mission) is not None,
        measures_velocity=measures_velocity(mission),
        by_ranges=alignment.georeferenced
        and fixes_by_ranges(mission, config.landmarks) is not None,
        planar=constraints.is_planar(mission),
        depth_spread_m=depth_spread_m(mission, config.landmarks.use_map),
        origin=mission.origin,
    )
    for add in KINDS:
        add(problem, mission, config)
    return problem
