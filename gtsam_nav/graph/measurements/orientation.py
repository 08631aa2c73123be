"""Heading, roll and pitch: AHRS orientations, a slow heading bias as a compass frame of its own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import gtsam
import numpy as np

from gtsam_nav.config import Config
from gtsam_nav.frames import Array, rotation_from_rpy, wrap_angle
from gtsam_nav.graph import factors, frame_factors
from gtsam_nav.graph.factors import M, X
from gtsam_nav.graph.gauss_markov import gauss_markov
from gtsam_nav.graph.problem import Problem
from gtsam_nav.graph.readings import Reading, StateAt
from gtsam_nav.mission import Mission
from gtsam_nav.preprocess.edge_motion import edges_in_space
from gtsam_nav.preprocess.settings import MotionSettings
from gtsam_nav.preprocess.turning import unmeasured_yaw_variance_rad2_s, untold_turns
from gtsam_nav.sensors.noise import HeadingNoise
from gtsam_nav.sensors.orientation import headings_true, measures_tilt_at, tilt_at
from gtsam_nav.sensors.silences import said_of_silences
from gtsam_nav.series import IntArray

UNMEASURED_TURN_RAD2_S = np.radians(3.0) ** 2
"""Growth of the variance of a turn that neither gyro nor compass saw, but something did."""

Averaged = tuple[Array, Array, IntArray]
"""Heading at each keyframe, rad, its sigma, and the row of its first reading."""


def add(problem: Problem, mission: Mission, config: Config) -> None:
    """Headings where there is a compass; roll and pitch unless forces or edges tell them."""
    told = problem.uses_imu or edges_in_space(mission)
    by_ahrs = measures_tilt_at(mission, problem.t) | (not told)
    if problem.has_compass:
        _add_compass(problem, mission)
        headings = _averaged_headings(problem, mission)
        _add_orientations(problem, mission, headings, np.flatnonzero(by_ahrs), config)
        _add_headings(problem, headings, np.flatnonzero(~by_ahrs), config)
    elif not problem.planar:
        tilt, sigma = tilt_at(mission, problem.t)
        for k in np.flatnonzero(by_ahrs).tolist():
            add_tilt(problem, mission, k, tilt[k], float(sigma[k]), config)
    attitude = mission.first("attitude")
    if attitude is not None:
        others = "the IMU carries" if problem.uses_imu else "the edges carry"
        instead = others if told else "nothing tells"
        problem.warnings += said_of_silences(attitude, mission, f"{instead} roll and pitch")


def _add_compass(problem: Problem, mission: Mission) -> None:
    """The compass frames: a constant heading bias and a Gauss-Markov disturbance, if it has any."""
    sensor = mission.first("heading")
    assert sensor is not None
    noise = HeadingNoise.model_validate(sensor.noise)
    if noise.bias_sigma_deg == 0 and noise.disturbance_sigma_deg == 0:
        return
    constant = M(len(problem.t))
    problem.add_variable(0, constant, gtsam.NavState())
    problem.add(
        0, "heading", frame_factors.compass_prior(constant, np.radians(noise.bias_sigma_deg))
    )
    problem.compass = [constant] * len(problem.t)
    if noise.disturbance_sigma_deg == 0:
        return
    spread = float(np.radians(noise.disturbance_sigma_deg))
    disturbance = gauss_markov(problem.t, spread, noise.disturbance_time_s)
    problem.compass = [M(k) for k in range(len(problem.t))]
    for k in range(len(problem.t)):
        problem.variables[k].append((M(k), _frame_before(k)))
        problem.add(k, "heading", frame_factors.compass_pin(M(k)))
        problem.add(k, "heading", frame_factors.compass_link(constant, M(k), disturbance.tie[k]))
        if k:
            link = frame_factors.compass_link(M(k - 1), M(k), disturbance.link[k - 1])
            problem.add(k, "heading", link)


def _frame_before(k: int) -> Callable[[StateAt], Any]:
    """First value of a compass frame: nearer than zero, it need not be linearised anew."""
    return lambda state_at: state_at(M(k - 1)) if k else gtsam.NavState()


def _add_orientations(
    problem: Problem, mission: Mission, headings: Averaged, keyframes: IntArray, config: Config
) -> None:
    """Heading, roll and pitch of an AHRS as one orientation, at given keyframes."""
    yaw, sigma_yaw, row = headings
    tilt, sigma_tilt = tilt_at(mission, problem.t)
    R_measured = rotation_from_rpy(np.column_stack([tilt, yaw]))
    growth = turn_growth_rad2_s(mission, problem.t, config.motion)
    for k in keyframes.tolist():
        if np.isfinite(sigma_yaw[k]):
            sigmas = np.array([sigma_tilt[k], sigma_tilt[k], sigma_yaw[k]])
            factor = factors.orientation(problem.compass_at(k), X(k), R_measured[k], sigmas)
            problem.add_gated(k, "heading", int(row[k]), factor, config.graph.robust.heading)
        else:
            add_tilt(problem, mission, k, tilt[k], float(sigma_tilt[k]), config)
            add_unmeasured_turn(problem, k, growth)


def _add_headings(
    problem: Problem, headings: Averaged, keyframes: IntArray, config: Config
) -> None:
    """Headings alone, at given keyframes; their factors take roll and pitch from the present
    estimate."""
    yaw, sigma, row = headings
    measured = list(zip(yaw.tolist(), sigma.tolist(), strict=True))

    def make(rows: Sequence[int], state_at: StateAt) -> list[Any]:
        R_nb, _, _ = factors.parts(state_at(X(k)) for k in rows)
        return [
            factors.heading(problem.compass_at(k), X(k), measured[k][0], R, measured[k][1])
            for k, R in zip(rows, R_nb, strict=True)
        ]

    for k in keyframes[np.isfinite(sigma[keyframes])].tolist():
        reading = Reading(
            t=float(problem.t[k]),
            sensor="heading",
            index=int(row[k]),
            maker=make,
            row=k,
            robustness=config.graph.robust.heading,
            reason="heading outlier",
        )
        problem.readings[k].append(reading)


def turn_growth_rad2_s(mission: Mission, t: Array, settings: MotionSettings) -> Array:
    """Growth of the variance of a turn without gyro and compass, between times (n,); shape
    (n - 1,)."""
    middle = 0.5 * (t[1:] + t[:-1])
    untold = [(begin < middle) & (middle < end) for begin, end in untold_turns(mission)]
    nowhere = np.zeros(len(middle), dtype=bool)
    return np.where(
        np.any([nowhere, *untold], axis=0),
        unmeasured_yaw_variance_rad2_s(settings),
        UNMEASURED_TURN_RAD2_S,
    )


def add_unmeasured_turn(problem: Problem, k: int, growth_rad2_s: Array) -> None:
    """Ties the yaw of a keyframe without a reading loosely to its neighbours'."""
    for a, b in ((k - 1, k), (k, k + 1)):
        if a >= 0 and b < len(problem.t):
            R_ab, _ = problem.increments
            precision = 1.0 / (growth_rad2_s[a] * (problem.t[b] - problem.t[a]))
            problem.add(b, "heading", factors.turn(X(a), X(b), R_ab[a], precision))


def _averaged_headings(problem: Problem, mission: Mission) -> Averaged:
    """Heading at each keyframe from the readings nearest to it, its sigma, and the first's row.

    The readings are carried to the keyframe by the vehicle's own turn; half before, half after,
    so that a gyro's bias cancels. Where a compass alone tells that turn, no reading tells more than
    the smoothed heading there. Keyframes without a reading get an infinite sigma.
    """
    headings = headings_true(mission)
    assert headings is not None
    yaw, n = problem.rpy[:, 2], len(problem.t)
    owner = problem.keyframe_nearest(headings.t)
    turned = problem.motion.at(headings.t)[1][:, 2] - yaw[owner]
    difference = wrap_angle(headings.heading - turned - yaw[owner])
    count = np.bincount(owner, minlength=n)
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = np.bincount(owner, difference, minlength=n) / count
        sigma = np.sqrt(np.bincount(owner, headings.sigma**2, minlength=n)) / count
    if problem.motion.compass_sigma is not None:
        sigma = np.maximum(sigma, problem.motion.compass_sigma)
    first = np.clip(np.searchsorted(owner, np.arange(n)), 0, len(owner) - 1)
    heading = yaw + np.where(count > 0, mean, 0.0)
    return heading, np.where(count > 0, sigma, np.inf), headings.row[first]


def add_tilt(
    problem: Problem, mission: Mission, k: int, tilt: Array, sigma: float, config: Config
) -> None:
    """Roll and pitch of a keyframe without a heading."""
    factor = factors.tilt(X(k), np.array([*tilt, 0.0]), sigma)
    sensor, robustness = mission.first("attitude"), config.graph.robust.attitude
    if sensor is None:
        problem.add(k, "attitude", factor, robustness)
    else:
        row = sensor.series.row_nearest(problem.t[k])
        problem.add_gated(k, "attitude", row, factor, robustness)
