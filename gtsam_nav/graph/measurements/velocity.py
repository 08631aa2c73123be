"""The vehicle's own motion by DVL or odometry: displacements between keyframes."""

from __future__ import annotations

import numpy as np

from gtsam_nav.config import Config
from gtsam_nav.frames import Array
from gtsam_nav.graph import factors
from gtsam_nav.graph.factors import X
from gtsam_nav.graph.measurements.edges import joined, left_open
from gtsam_nav.graph.problem import ConstantError, Displacement, Problem
from gtsam_nav.mission import Mission
from gtsam_nav.preprocess.depth_by_ranges import DIVE_M_SQRT_S
from gtsam_nav.preprocess.edge_motion import moves_by_edges
from gtsam_nav.sensors.dvl import water_spells
from gtsam_nav.sensors.noise import DvlNoise
from gtsam_nav.sensors.odometry import (
    curvature_sigma,
    velocity_calibration_sigma,
    velocity_sensor,
)
from gtsam_nav.series import BoolArray


def add(problem: Problem, mission: Mission, config: Config) -> None:
    """Displacements, and without an IMU each keyframe's velocity, which then touches nothing else.

    Yaw turns by the motion too where nothing better turns the vehicle.
    """
    if moves_by_edges(mission):
        _add_velocities(problem, config)
        return
    if not problem.measures_velocity:
        return
    problem.calibration_sigma = velocity_calibration_sigma(mission)
    within_s, current_sigma = _through_water(problem, mission, config)
    moved_m = current_sigma * np.sum(within_s, axis=0)
    by_edges = joined(problem.t, mission) | left_open(problem.t, mission)
    turns = not problem.uses_imu and not problem.has_compass
    _add_increments(problem, config, turns, moved_m, by_edges)
    _add_currents(problem, within_s, current_sigma)
    if turns and mission.first("imu") is None:
        _add_curvature(problem, curvature_sigma(mission))
    if not problem.uses_imu:
        _add_velocities(problem, config)


def _through_water(problem: Problem, mission: Mission, config: Config) -> tuple[Array, float]:
    """How long each interval lies within each spell of water lock, s; the current's sigma, m/s."""
    dvl = velocity_sensor(mission)
    if dvl is None or dvl.type != "dvl":
        return np.zeros((0, len(problem.t) - 1)), 0.0
    spells = water_spells([dvl], config.motion.water_lock_after_s)
    noise = DvlNoise.model_validate(dvl.noise)
    return _overlaps(problem.t, spells), noise.water_sigma_m_s


def _overlaps(t: Array, spells: Array) -> Array:
    """How long each interval between times (n,) lies within each spell (k, 2); (k, n - 1), s."""
    begin = np.maximum(t[:-1], spells[:, :1])
    end = np.minimum(t[1:], spells[:, 1:])
    return np.asarray(np.maximum(end - begin, 0.0))


def _add_currents(problem: Problem, within_s: Array, sigma: float) -> None:
    """The water's own motion, a vector a spell: displacements through the water lack it."""
    for spell, in_spell_s in enumerate(within_s):
        moved = [d for d in problem.displacements if in_spell_s[d.k - 1] > 0.0]
        for axis, name in enumerate("ne"):
            effect = []
            for d in moved:
                lacking_b = problem.R_nb[d.k - 1][axis] * in_spell_s[d.k - 1]
                derivative = np.zeros(9)
                derivative[3:6] = -d.R_ab.T @ lacking_b
                effect.append((d.entry, derivative))
            label = f"current_{name}_{spell}_m_s"
            problem.constants.append(ConstantError(label, sigma, effect))


def _add_curvature(problem: Problem, sigma: float) -> None:
    """The turn that odometry does not notice, rad a metre ahead; half of it turns the way."""
    if sigma == 0.0:
        return
    effect = []
    for d in problem.displacements:
        ahead_m = float(d.p_a[0])
        derivative = np.zeros(9)
        derivative[:3] = -ahead_m * d.R_ab.T[:, 2]
        derivative[3:6] = -0.5 * ahead_m * d.R_ab.T @ [-d.p_a[1], d.p_a[0], 0.0]
        effect.append((d.entry, derivative))
    problem.constants.append(ConstantError("odometry_curvature_rad_m", sigma, effect))


def _add_increments(
    problem: Problem, config: Config, yaw_by_motion: bool, moved_m: Array, by_edges: BoolArray
) -> None:
    """Displacements, but where edges alone tell them, shape (n - 1,).

    Changes of the water's motion may move each by ``moved_m``, shape (n - 1,).
    """
    motion = problem.motion
    variance = motion.displacement_variance(problem.t[:-1], problem.t[1:])
    sigma_p = np.tile(np.sqrt(variance + moved_m**2)[:, None], 3)
    if problem.depth_spread_m:
        sigma_p[:, 2] = np.hypot(sigma_p[:, 2], DIVE_M_SQRT_S * np.sqrt(np.diff(problem.t)))
    rotation = np.zeros((len(variance), 3))
    if yaw_by_motion:
        rotation[:, 2] = 1.0 / (motion.yaw_variance_rad2_s * np.diff(problem.t))
    # a bent way tells the mean of two yaws: without a gyro they could swing against each other
    bends = problem.uses_imu
    R_ab, p_a = problem.increments
    for i in np.flatnonzero(~by_edges).tolist():
        factor = factors.increment(X(i), X(i + 1), R_ab[i], p_a[i], rotation[i], sigma_p[i], bends)
        entry = problem.add(i + 1, "velocity", factor, config.graph.robust.velocity)
        problem.displacements.append(Displacement(i + 1, R_ab[i], p_a[i], entry))


def _add_velocities(problem: Problem, config: Config) -> None:
    for k in range(len(problem.t)):
        add_velocity(problem, k, config)


def add_velocity(problem: Problem, k: int, config: Config) -> None:
    """The motion's own smoothed velocity at a keyframe."""
    factor = factors.velocity(X(k), problem.v_b[k], float(problem.sigma_v[k]))
    problem.add(k, "velocity", factor, config.graph.robust.velocity)
