"""The vehicle's own motion by DVL or odometry: displacements between keyframes."""

from __future__ import annotations

import numpy as np

from gtsam_nav.config import Config
from gtsam_nav.frames import Array
from gtsam_nav.graph import factors
from gtsam_nav.graph.factors import X
from gtsam_nav.graph.problem import Displacement, Problem
from gtsam_nav.mission import Mission
from gtsam_nav.sensors.noise import DvlNoise, OdometryNoise


def add(problem: Problem, mission: Mission, config: Config) -> None:
    """Displacements, and without an IMU each keyframe's velocity, which then touches nothing else.

    Yaw turns by the motion too where nothing better turns the vehicle.
    """
    if not problem.measures_velocity:
        return
    problem.calibration_sigma = _calibration_sigma(mission)
    _add_increments(problem, config, not problem.uses_imu and not problem.has_compass)
    if not problem.uses_imu:
        for k in range(len(problem.t)):
            add_velocity(problem, k, config)


def _calibration_sigma(mission: Mission) -> Array:
    """Spread of scale and misalignment of whichever sensor measures the velocity."""
    dvl, odometry = mission.first("dvl"), mission.first("odometry")
    noise: DvlNoise | OdometryNoise
    if dvl is not None:
        noise = DvlNoise.model_validate(dvl.noise)
    else:
        noise = OdometryNoise.model_validate(odometry.noise if odometry else {})
    return np.array([noise.scale_sigma, np.radians(noise.misalignment_sigma_deg)])


def _add_increments(problem: Problem, config: Config, yaw_by_motion: bool) -> None:
    motion = problem.motion
    variance = motion.displacement_variance(problem.t[:-1], problem.t[1:])
    for k in range(1, len(problem.t)):
        dt = problem.t[k] - problem.t[k - 1]
        R_ab, p_a = problem.increment(k - 1, k)
        sigma_p = float(np.sqrt(variance[k - 1]))
        rotation = np.zeros(3)
        if yaw_by_motion:
            rotation[2] = 1.0 / (motion.yaw_variance_rad2_s * dt)
        factor = factors.increment(X(k - 1), X(k), R_ab, p_a, rotation, sigma_p)
        entry = problem.add(k, "velocity", factor, config.graph.robust.velocity)
        problem.displacements.append(Displacement(k, R_ab, p_a, entry.factor))


def add_velocity(problem: Problem, k: int, config: Config) -> None:
    """The motion's own smoothed velocity at a keyframe."""
    motion = problem.motion
    sigma = float(np.interp(problem.t[k], motion.t, motion.sigma_v))
    factor = factors.velocity(X(k), problem.v_b[k], sigma)
    problem.add(k, "velocity", factor, config.graph.robust.velocity)
