"""Finding the sensors' timing errors before a mission is estimated.

Gauss-Newton over trajectory and timing errors together, the latter marginalised as constants of the
whole mission are (`sensor_posterior`). After each step the sensors are moved by what was found and
the problem is built anew, since a shift changes which readings lie between which keyframes. While a
clock is off, good readings look like outliers: they start under a kernel that lets everything in,
and it narrows from round to round as the clocks come right.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import gtsam
import numpy as np

from gtsam_nav.config import Config
from gtsam_nav.frames import Array
from gtsam_nav.graph import factors
from gtsam_nav.graph.backend import graph_of
from gtsam_nav.graph.factors import X
from gtsam_nav.graph.keys import letter_of
from gtsam_nav.graph.least_squares import solve_batch
from gtsam_nav.graph.measurements import build_problem
from gtsam_nav.graph.measurements.imu import own_motion
from gtsam_nav.graph.problem import Problem
from gtsam_nav.graph.readings import made
from gtsam_nav.graph.robust import Robustness
from gtsam_nav.graph.sensor_posterior import sensor_posterior
from gtsam_nav.graph.settling import NARROWING, START
from gtsam_nav.graph.taken import twins_taken
from gtsam_nav.graph.timing import TimingError, Used, timing_effect, timing_errors
from gtsam_nav.mission import Mission
from gtsam_nav.preprocess.alignment import Alignment
from gtsam_nav.preprocess.motion import VehicleMotion, measures_velocity
from gtsam_nav.sensors.odometry import velocity_sensor
from gtsam_nav.solution import ClockOffset, Progress

log = logging.getLogger(__name__)

MAX_ROUNDS = 15
STILL_SIGMAS = 0.1
"""A timing error that moves by less of its standard deviation has been found."""


@dataclass(frozen=True)
class Clocks:
    """Timing errors of a mission, and what they were corrected by, shape (m,), s.

    ``idle`` are those of sensors of which no sample is used: nothing can tell them.
    """

    errors: tuple[TimingError, ...]
    corrected_s: Array
    idle: tuple[TimingError, ...] = ()

    def corrected(self, mission: Mission) -> Mission:
        """The mission with its timing put right."""
        for error, by_s in zip(self.errors, self.corrected_s.tolist(), strict=True):
            mission = error.corrected(mission, by_s)
        return mission

    def moved(self, by_s: Array) -> Clocks:
        """With more of a correction."""
        return replace(self, corrected_s=self.corrected_s + by_s)

    def describe(self, problem: Problem, used: Used, values: Any) -> None:
        """Let the problem of a corrected mission estimate what is left, beside its trajectory."""
        if self.errors:
            problem.timing = timing_effect(problem, self.errors, self.corrected_s, used, values)

    def offsets(self, constants: Mapping[str, tuple[float, float]]) -> tuple[ClockOffset, ...]:
        """What was found in all, once the solution says what was left, with its sigma."""
        found = []
        for error in self.errors:
            value, sigma = constants[error.name]
            found.append(ClockOffset(error.sensor, error.quantity, value, sigma, error.sigma_s))
        found += [ClockOffset(e.sensor, e.quantity, 0.0, e.sigma_s, e.sigma_s) for e in self.idle]
        return tuple(found)


def find_clocks(
    mission: Mission,
    start: Alignment,
    motion: VehicleMotion,
    t: Array,
    config: Config,
    progress: Progress,
) -> Clocks:
    """The timing errors that a mission asks for; without any, nothing is done.

    Parameters
    ----------
    start, motion : Alignment, VehicleMotion
        Of the mission with its timing as it is.
    t : ndarray, shape (n,)
        Keyframe times.
    """
    every = timing_errors(mission)
    idle = tuple(error for error in every if _is_idle(error, mission, config))
    errors = tuple(error for error in every if error not in idle)
    clocks = Clocks(errors, np.zeros(len(errors)), idle)
    if not errors:
        return clocks
    config = _at_first(config)
    values, width, moved, rounds = None, np.inf, np.inf, 0
    while (moved > STILL_SIGMAS or width > 1.0) and rounds < MAX_ROUNDS:
        corrected = clocks.corrected(mission)
        if measures_velocity(mission):
            motion = own_motion(corrected, start, config)
        problem = build_problem(corrected, start, motion, t, config)
        values = _start(problem, values)
        width = _narrowed(problem, values, width)
        kernel = START.model_copy(update={"threshold": START.scale * width})
        _, graph = _factors(problem, values, kernel)
        values = solve_batch(graph, values, problem.is_stiff)
        used, graph = _factors(problem, values, kernel)
        clocks.describe(problem, used, values)
        posterior = sensor_posterior(graph, values, np.empty(0, dtype=np.int64), problem)
        step = posterior.constants.mean[-len(errors) :]
        sigma = np.sqrt(np.diag(posterior.constants.cov)[-len(errors) :])
        moved = float(np.max(np.abs(step) / sigma))
        clocks, values = clocks.moved(step), posterior.moved()
        rounds += 1
        log.info("clocks, round %d: %s s, sigmas %s s", rounds, clocks.corrected_s, sigma)
        progress("clocks", rounds / MAX_ROUNDS)
    if moved > STILL_SIGMAS:
        log.warning("clocks: the last of %d rounds still moved %.1f sigmas", rounds, moved)
    progress("clocks", 1.0)
    return clocks


def _is_idle(error: TimingError, mission: Mission, config: Config) -> bool:
    """Whether nothing of a sensor is used: it is empty, or another one is taken in its place."""
    sensor = mission.sensors[error.sensor]
    spare = sensor.type in ("dvl", "odometry") and sensor is not velocity_sensor(mission)
    left_out = spare or sensor.name in twins_taken(mission, config)
    return left_out or not len(sensor.series)


def _at_first(config: Config) -> Config:
    """Under the kernels that a solve starts with."""
    graph = config.graph.model_copy(update={"robust": config.graph.robust.at_first})
    return config.model_copy(update={"graph": graph})


def _start(problem: Problem, before: Any) -> Any:
    """The values found before, and the first ones of states that were not among them."""
    values = gtsam.Values()

    def keep(key: int, first: Any) -> None:
        if before is not None and before.exists(key):
            kind = "ConstantBias" if letter_of(key) == "b" else "NavState"
            first = getattr(before, f"at{kind}")(key)
        factors.insert(values, key, first)

    for k in range(len(problem.t)):
        keep(X(k), problem.initial_state(k))
        for key, first in problem.variables[k]:
            keep(key, first(values.atNavState))
    return values


def _narrowed(problem: Problem, values: Any, width: float) -> float:
    """The kernel's scale for the next round: at first as wide as the worst misfit."""
    if np.isfinite(width):
        return max(1.0, width / NARROWING)
    worst = 1.0
    gated = [reading for reading in problem.all_readings if reading.is_gated]
    for factor in made(gated, values.atNavState):
        worst = max(worst, float(np.linalg.norm(factor.whitenedError(values))))
    return max(1.0, worst / START.scale)


def _factors(problem: Problem, values: Any, gated: Robustness) -> tuple[Used, Any]:
    """Readings with their factors, the gated ones under a kernel; and the whole graph."""
    graph = graph_of(problem.entries)
    readings, used = problem.all_readings, []
    for reading, gaussian in zip(readings, made(readings, values.atNavState), strict=True):
        factor = factors.robust(gaussian, gated if reading.is_gated else reading.robustness)
        used.append((reading, factor))
        graph.add(factor)
    return tuple(used), graph
