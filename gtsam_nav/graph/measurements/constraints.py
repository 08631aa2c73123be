"""What is known of the motion without a sensor: wheels, rest, a floor."""

from __future__ import annotations

import numpy as np

from gtsam_nav.config import Config
from gtsam_nav.frames import Array
from gtsam_nav.graph import factors
from gtsam_nav.graph.factors import X
from gtsam_nav.graph.problem import ConstantError, Problem
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.preprocess.depth_by_ranges import said_of_depth
from gtsam_nav.preprocess.edge_motion import edges_in_space
from gtsam_nav.preprocess.fixes_by_ranges import said_of_side
from gtsam_nav.preprocess.rest import SPELL_S, Rest, Spells, initial_rest
from gtsam_nav.preprocess.stated_rest import stated_rests
from gtsam_nav.sensors.noise import ImuNoise
from gtsam_nav.series import IntArray

NAME = "constraints"
PIN_RAD, PIN_M = 1e-3, 1e-3
"""Spread of roll, pitch and depth of what drives on a plane."""
TELL_HEIGHT_OR_TILT = ("imu", "attitude", "depth", "dvl", "gnss")


def is_planar(mission: Mission) -> bool:
    """Whether a ground robot's odometry is all that moves it: then its floor is level."""
    told = any(mission.of_type(kind) for kind in TELL_HEIGHT_OR_TILT) or edges_in_space(mission)
    return mission.first("odometry") is not None and not told


def add(problem: Problem, mission: Mission, config: Config) -> None:
    """The constraints that the mission or the configuration states, and a start at rest."""
    problem.warnings += said_of_depth(mission, config.landmarks.use_map, estimated=True)
    if problem.by_ranges:
        problem.warnings += said_of_side(mission)
    if problem.planar:
        _add_plane(problem, config)
    if not problem.uses_imu:
        return
    if mission.constraints.nonholonomic:
        _add_wheels(problem, config)
    _add_rests(problem, mission, config)


def _add_wheels(problem: Problem, config: Config) -> None:
    """Neither sideways nor up, but for how springs let the body pitch as the vehicle speeds up."""
    settings, speed = config.motion, problem.v_b[:, 0]
    acceleration = np.gradient(speed, problem.t)
    effect = []
    for k in range(len(problem.t)):
        factor = factors.nonholonomic(X(k), settings.nonholonomic_sigma_m_s)
        entry = problem.add(k, NAME, factor, config.graph.robust.constraints)
        # a bow that points up lets the body sink along its own z axis
        effect.append((entry, np.r_[np.zeros(8), -speed[k] * acceleration[k]]))
    sigma = float(np.radians(settings.pitch_by_acceleration_sigma_deg_s2_m))
    if sigma > 0:
        problem.constants.append(ConstantError("pitch_by_acceleration_rad_s2_m", sigma, effect))


def _add_rests(problem: Problem, mission: Mission, config: Config) -> None:
    """Rest: stated for an IMU that is quiet and not seen to move, or taken for granted at the start
    of a mission whose position and velocity nothing else measures. What merely floats there keeps
    its velocity."""
    imu = mission.first("imu")
    assert imu is not None
    rest = initial_rest(imu)
    spells, warnings = stated_rests(mission, config.motion)
    problem.warnings += warnings
    if spells is not None:
        _add_rest(problem, spells, imu, config)
    elif rest is not None and not problem.measures_velocity:
        if mission.first("gnss") is None and not problem.by_ranges:
            _add_rest(problem, rest.spells, imu, config)
        else:
            _add_steadiness(problem, rest)


def _add_rest(problem: Problem, spells: Spells, imu: Sensor, config: Config) -> None:
    """No velocity at the keyframes within the spells, and no turn from one to the next within the
    same rest: between two of them the vehicle may have turned on the spot."""
    noise = ImuNoise.model_validate(imu.noise)
    sigma = config.motion.zero_velocity_sigma_m_s
    rest = _rest_at(problem.t, spells)
    for k in np.flatnonzero(rest >= 0).tolist():
        factor = factors.velocity(X(k), np.zeros(3), sigma)
        problem.add(k, NAME, factor, config.graph.robust.constraints)
        if k and rest[k - 1] == rest[k]:
            span_s = float(problem.t[k] - problem.t[k - 1])
            turn = noise.gyro_noise_density_rad_s_sqrt_hz * np.sqrt(span_s)
            problem.add(k, NAME, factors.no_turn(X(k - 1), X(k), turn))


def _rest_at(t: Array, spells: Spells) -> IntArray:
    """Which rest, a row of spells without a break, each time lies in; -1 for none."""
    if not len(spells.t):
        return np.full(len(t), -1)
    rest = np.cumsum(np.diff(spells.t, prepend=spells.t[0]) > 1.5 * SPELL_S)
    end = np.searchsorted(spells.t, t).clip(max=len(spells.t) - 1)
    within = (t <= spells.t[end]) & (t >= spells.t[end] - SPELL_S)
    return np.where(within, rest[end], -1)


def _add_steadiness(problem: Problem, rest: Rest) -> None:
    """The mean specific force of the first quiet spells is gravity's: no velocity is gained."""
    resting = np.flatnonzero(_rest_at(problem.t, rest.spells) >= 0)
    if len(resting) < 2:
        return
    a, b = int(resting[0]), int(resting[-1])
    sigma = rest.sigma_force * (problem.t[b] - problem.t[a])
    problem.add(b, NAME, factors.no_gain(X(a), X(b), sigma))


def _add_plane(problem: Problem, config: Config) -> None:
    """Upright, and at the depth of the start unless ranges tell another."""
    for k, depth_m in enumerate(problem.p_n[:, 2].tolist()):
        pins = [factors.tilt(X(k), np.zeros(3), PIN_RAD)]
        if not problem.depth_spread_m:
            pins.append(factors.depth(X(k), depth_m, np.zeros(3), PIN_M))
        for pin in pins:
            problem.add(k, NAME, pin, config.graph.robust.constraints)
