"""GNSS positions and velocities, with an error that fixes share where the card says so."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import count
from typing import Any

import gtsam
import numpy as np

from gtsam_nav.config import Config
from gtsam_nav.frames import Array, rotation_from_rpy
from gtsam_nav.graph import factors, frame_factors
from gtsam_nav.graph.factors import G, X
from gtsam_nav.graph.gauss_markov import gauss_markov
from gtsam_nav.graph.measurements.depth import beside_gauge, tells_depth_at
from gtsam_nav.graph.problem import RECEIVER_STRIDE, Problem
from gtsam_nav.graph.readings import Maker, Reading, StateAt, as_given
from gtsam_nav.graph.robust import GatedRobustness
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.preprocess.first_fixes import located
from gtsam_nav.sensors.fix_errors import AlikeFixes, alike_fixes, white_sigma
from gtsam_nav.sensors.noise import GnssNoise
from gtsam_nav.sensors.rates import angular_rate_b
from gtsam_nav.series import BoolArray, GnssSeries, IntArray

POSITION_OUTLIER, VELOCITY_OUTLIER = "position outlier", "velocity outlier"
CARRIED_ACCELERATION_M_S2 = 0.3
"""What the motion's acceleration may be wrong by, that carries a velocity to a keyframe."""


def add(problem: Problem, mission: Mission, config: Config) -> None:
    """All fixes of all receivers, each at the keyframe nearest in time.

    The vehicle's own motion carries them there. GNSS height and vertical velocity give way to a
    depth sensor that speaks.
    """
    processes = count()
    for receiver in mission.of_type("gnss"):
        _add_positions(problem, mission, receiver, processes, config)
        _add_velocities(problem, mission, receiver, config)


def _within(problem: Problem, gnss: Sensor, lag_s: float = 0.0) -> GnssSeries:
    """Fixes whose time, less a lag, lies within the keyframes'."""
    series = gnss.series
    assert isinstance(series, GnssSeries)
    return series.select(problem.spans(series.t - lag_s))


def _add_positions(
    problem: Problem, mission: Mission, gnss: Sensor, processes: Iterator[int], config: Config
) -> None:
    """Antenna positions; an error that fixes share is a state of its own.

    It is a Gauss-Markov sequence over the keyframes with fixes that are alike.
    """
    series = _within(problem, gnss)
    series = series.select(located(series))
    if not len(series):
        return
    noise = GnssNoise.model_validate(gnss.noise)
    keyframe = problem.keyframe_nearest(series.t)
    carried = problem.motion.displacement_variance(series.t, problem.t[keyframe])
    sigma = np.sqrt(white_sigma(series, noise) ** 2 + carried[:, None])
    if not config.gnss.use_height:
        series, by_gauge = beside_gauge(problem, mission, gnss.xyz_b, series)
        sigma[by_gauge, 2] = np.inf
    arm_b = _arms(problem, gnss, series.t, keyframe)
    for alike in alike_fixes(series, noise):
        at, arms, own = keyframe[alike.which], arm_b[alike.which], sigma[alike.which]
        fixes = series.select(alike.which)
        if alike.share:
            process = next(processes)
            counts = np.any(np.isfinite(own), axis=0)
            shared = _where_told(alike, counts)
            _add_shared_error(problem, gnss.name, process, at, shared, noise.correlation_time_s)
            keys = [(error_key(process, k), int(X(k))) for k in at.tolist()]
            maker = _with_errors(keys, fixes.p_n, arms - gnss.xyz_b, gnss.xyz_b, own)
        else:
            rows = zip(at.tolist(), fixes.p_n, arms, own, strict=True)
            maker = as_given([factors.gnss(X(k), p_n, arm, s) for k, p_n, arm, s in rows])
        robustness = config.graph.robust.gnss
        _add_readings(problem, gnss.name, fixes, at, maker, robustness, POSITION_OUTLIER)


def _add_readings(
    problem: Problem,
    name: str,
    fixes: GnssSeries,
    keyframe: IntArray,
    maker: Maker,
    robustness: GatedRobustness,
    reason: str,
) -> None:
    """A reading of each fix, at its keyframe."""
    for i, k in enumerate(keyframe.tolist()):
        problem.readings[k].append(
            Reading(
                t=float(fixes.t[i]),
                sensor=name,
                index=int(fixes.row[i]),
                maker=maker,
                row=i,
                robustness=robustness,
                reason=reason,
            )
        )


def _with_errors(
    keys: list[tuple[int, int]], p_n: Array, carried_b: Array, lever_b: Array, sigma: Array
) -> Maker:
    """Fixes of the antenna with their shared errors.

    The way by which they are carried has told its yaw already, as a displacement.
    """

    def make(rows: Sequence[int], state_at: StateAt) -> list[Any]:
        R_nb, _, _ = factors.parts(state_at(keys[i][1]) for i in rows)
        at_keyframe_n = p_n[rows] - np.einsum("kij,kj->ki", R_nb, carried_b[rows])
        return [
            factors.gnss_with_error(*keys[i], fix_n, lever_b, R, sigma[i])
            for i, fix_n, R in zip(rows, at_keyframe_n, R_nb, strict=True)
        ]

    return make


def _arms(problem: Problem, gnss: Sensor, t: Array, keyframe: IntArray) -> Array:
    """From the keyframes to where the antenna is at the fixes, in the keyframes' body axes.

    They turn with the estimate: the motion's own yaw may have drifted, as without a compass.
    """
    p_fix, rpy_fix = problem.motion.at(t)
    moved_n = p_fix - problem.p_n[keyframe] + rotation_from_rpy(rpy_fix) @ gnss.xyz_b
    return np.asarray(np.einsum("kji,kj->ki", problem.R_nb[keyframe], moved_n))


def error_key(process: int, k: int) -> int:
    """Key of a shared error at keyframe k."""
    return int(G(process * RECEIVER_STRIDE + k))


def _where_told(alike: AlikeFixes, counts: BoolArray) -> AlikeFixes:
    """Fixes whose shared error is as near zero on an axis that counts nowhere (3,) as on the rest.

    The sigma of a height that a 2-D fix makes up, of kilometres, would spoil the equations.
    """
    sigma = np.where(counts, alike.shared_sigma, alike.shared_sigma[:2].max())
    return replace(alike, shared_sigma=sigma)


def _add_shared_error(
    problem: Problem,
    name: str,
    process: int,
    keyframe: IntArray,
    alike: AlikeFixes,
    time_s: float,
) -> None:
    keyframes = np.unique(keyframe)
    unit = gauss_markov(problem.t[keyframes], 1.0, time_s)
    tie, link = (np.outer(own, alike.shared_sigma**-2.0) for own in (unit.tie, unit.link))
    for i, k in enumerate(keyframes.tolist()):
        key = error_key(process, k)
        problem.add_variable(k, key, gtsam.NavState())
        problem.add(k, name, frame_factors.gnss_error_prior(key, tie[i]))
        if i:
            previous = error_key(process, int(keyframes[i - 1]))
            problem.add(k, name, frame_factors.gnss_error_link(previous, key, link[i - 1]))


def _add_velocities(problem: Problem, mission: Mission, gnss: Sensor, config: Config) -> None:
    """Antenna velocities, which belong to a time before their fix."""
    noise = GnssNoise.model_validate(gnss.noise)
    series = _within(problem, gnss, noise.velocity_lag_s)
    if series.v_n is None:
        return
    t = series.t - noise.velocity_lag_s
    keyframe = problem.keyframe_nearest(t)
    motion = problem.motion.trajectory
    assert motion.v_n is not None
    own_v_n = [
        np.interp(t, motion.t, v) - np.interp(problem.t[keyframe], motion.t, v)
        for v in motion.v_n.T
    ]
    v_n = series.v_n - np.stack(own_v_n, axis=1)
    omega_b = angular_rate_b(mission, problem.t[keyframe], problem.motion.gyro_bias_b)
    turning_b = np.cross(omega_b, gnss.xyz_b)
    carried = CARRIED_ACCELERATION_M_S2 * (t - problem.t[keyframe])
    sigma = np.hypot(noise.sigma_velocity_m_s, carried)[:, None] * np.ones(3)
    if not config.gnss.use_height:
        sigma[tells_depth_at(mission, t), 2] = np.inf

    def make(rows: Sequence[int], state_at: StateAt) -> list[Any]:
        keys = [int(X(int(keyframe[i]))) for i in rows]
        return [
            factors.gnss_velocity(key, state_at(key), v_n[i], turning_b[i], sigma[i])
            for i, key in zip(rows, keys, strict=True)
        ]

    robustness = config.graph.robust.gnss_velocity
    _add_readings(problem, gnss.name, series, keyframe, make, robustness, VELOCITY_OUTLIER)
