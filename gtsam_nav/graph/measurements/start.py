"""What is known of the first keyframe before anything is measured."""

from __future__ import annotations

import numpy as np

from gtsam_nav.config import Config
from gtsam_nav.frames import rotation_from_rpy
from gtsam_nav.graph import factors
from gtsam_nav.graph.factors import X
from gtsam_nav.graph.problem import Problem
from gtsam_nav.mission import Mission
from gtsam_nav.preprocess.alignment import at_rest
from gtsam_nav.preprocess.first_fixes import locating_receiver
from gtsam_nav.sensors.orientation import UNMEASURED_TILT_SIGMA_RAD

VAGUE_M, VAGUE_RAD, VAGUE_M_S = 1e3, np.pi, 30.0
"""Spread of what the sensors' own factors know better of the start."""
FIXES_SIGMAS = 3.0
"""While the fixes come in, the start that they tell together shows which of the first are outliers;
the batch needs no such hint, and must not count them twice."""
SLOW_M_S = 1.0
"""Speed at the start of a vehicle that a DVL or odometry tells of, or nothing."""


def add(problem: Problem, mission: Mission, config: Config) -> None:
    """The alignment as a prior; what is a factor of its own must not count twice."""
    start = problem.alignment
    sigma_rpy, sigma_p = start.sigma_rpy.copy(), start.sigma_p.copy()
    has_gnss = mission.first("gnss") is not None
    if mission.first("attitude") is not None:
        sigma_rpy[:2] = VAGUE_RAD
    elif problem.uses_imu and has_gnss:
        sigma_rpy[:2] = UNMEASURED_TILT_SIGMA_RAD
    # fixes too close together to show a yaw would only swing the frame that begins with it
    shows_yaw = has_gnss and (start.heading_known or not problem.measures_velocity)
    if mission.initial.heading is None and (problem.has_compass or shows_yaw):
        sigma_rpy[2] = VAGUE_RAD
    if locating_receiver(mission) is not None and mission.initial.p_n is None:
        hint = factors.position_prior(X(0), problem.p_n[0], FIXES_SIGMAS * sigma_p)
        problem.hints.append(hint)
        sigma_p[:] = VAGUE_M
    if mission.first("depth") is not None:
        sigma_p[2] = VAGUE_M
    if problem.depth_spread_m and mission.initial.p_n is None:
        sigma_p[2] = problem.depth_spread_m
    sigma_v = _speed_sigma(problem, mission, config)
    state = problem.initial_state(0)
    if mission.initial.heading is not None:  # the motion may begin with a compass's reading
        turn = rotation_from_rpy([0.0, 0.0, mission.initial.heading - problem.rpy[0, 2]])
        state = factors.nav_state(turn @ problem.R_nb[0], problem.p_n[0], turn @ state.velocity())
    prior = factors.start_prior(X(0), state, start.R_nb, sigma_rpy, sigma_p, sigma_v)
    problem.add(0, "start", prior)


def _speed_sigma(problem: Problem, mission: Mission, config: Config) -> float:
    """Spread of the speed at the start: what nothing but a quiet IMU tells of stands."""
    if problem.measures_velocity:
        return SLOW_M_S
    if mission.first("gnss") is not None or problem.by_ranges:
        return VAGUE_M_S
    is_quiet = at_rest(mission, problem.alignment.t)
    return config.motion.zero_velocity_sigma_m_s if is_quiet else SLOW_M_S
