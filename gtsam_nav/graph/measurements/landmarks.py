"""Sightings of landmarks that are told apart by their ids: each landmark is a state."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gtsam_nav.config import Config
from gtsam_nav.frames import Array, rotation_from_rpy
from gtsam_nav.graph import factors
from gtsam_nav.graph.factors import L, X
from gtsam_nav.graph.problem import Problem, Reading, StateAt
from gtsam_nav.mission import Mission, Rejection, Sensor
from gtsam_nav.sensors.landmarks import (
    NO_DIRECTION_M,
    Sighting,
    place,
    sighting,
    trusted_ids,
    variance_factors,
)
from gtsam_nav.sensors.noise import LandmarkNoise
from gtsam_nav.sensors.prediction import BodyState
from gtsam_nav.series import LandmarkSeries

UNKNOWN_M, LEVEL_M = 1e4, 1e-2
"""Spread of a landmark that was never surveyed, and of its depth where no sighting tells it."""


@dataclass(frozen=True)
class Seen:
    """One sighting at keyframe k of the landmark with this key.

    Attributes
    ----------
    sensor : Sensor
        As if mounted on that keyframe's body.
    level : bool
        The landmark is taken to lie level with the sensor.
    excess : float
        By how much its variance grows because earlier sightings share its error.
    """

    k: int
    key: int
    values: Sighting
    sensor: Sensor
    level: bool
    excess: float = 1.0

    def make(self, state_at: StateAt) -> Any:
        """The native factor, linear about the present estimate.

        As `sensors.landmarks.observe` has it, for one landmark: thousands of sightings are made
        anew many times.
        """
        body, landmark_n = state_at(X(self.k)), state_at(self.key).position()
        R_nb = body.attitude().matrix()
        offset_b = R_nb.T @ (landmark_n - body.position())
        counted_b = offset_b - self.sensor.xyz_b
        if self.level:
            counted_b = counted_b - R_nb[2] * (R_nb[2] @ counted_b)
        values, by_point = _polar(self.sensor.R_bs.T @ counted_b, self.values.elevation is not None)
        by_offset = by_point @ self.sensor.R_bs.T
        if self.level:
            by_offset = by_offset - np.outer(by_offset @ R_nb[2], R_nb[2])
        residual = values - self.values.measured
        residual[1:] = (residual[1:] + np.pi) % (2 * np.pi) - np.pi
        residual[~np.any(by_point, axis=1)] = 0.0
        cov = self.excess * self.values.cov
        return factors.sighting(X(self.k), self.key, offset_b, by_offset, residual, cov)

    def first_place(self, state_at: StateAt) -> Any:
        """The landmark where the sighting puts it."""
        state = state_at(X(self.k))
        body = BodyState(state.attitude().matrix(), state.position(), state.velocity())
        p_n = place(body, self.values, self.sensor).p_n
        return factors.nav_state(np.eye(3), p_n, np.zeros(3))


def _polar(p_s: Array, elevation: bool) -> tuple[Array, Array]:
    """Range, bearing[, elevation] of a point in sensor axes, and their Jacobian (m, 3)."""
    x, y, z = p_s.tolist()
    level, distance = math.hypot(x, y), math.hypot(x, y, z)
    values, jacobian = np.zeros(3), np.zeros((3, 3))
    values[:] = distance, math.atan2(y, x), math.atan2(-z, level)
    if distance > NO_DIRECTION_M:
        jacobian[0] = x / distance, y / distance, z / distance
    if level > NO_DIRECTION_M:
        jacobian[1, :2] = -y / level**2, x / level**2
        jacobian[2] = x * z / level, y * z / level, -level
        jacobian[2] /= distance**2
    m = 3 if elevation else 2
    return values[:m], jacobian[:m]


def add(problem: Problem, mission: Mission, config: Config) -> None:
    """Every sighting with an id, and the landmarks that are seen."""
    for sensor in mission.of_type("landmarks"):
        _add_sightings(problem, mission, sensor, config)


def _add_sightings(problem: Problem, mission: Mission, sensor: Sensor, config: Config) -> None:
    series = sensor.series
    assert isinstance(series, LandmarkSeries)
    series = series.select((series.t >= problem.t[0]) & (series.t <= problem.t[-1]))
    known = _surveyed(mission, config)
    ids = trusted_ids(series, config.landmarks)
    keyframe = problem.keyframe_nearest(series.t)
    excess = variance_factors(series.t, LandmarkNoise.model_validate(sensor.noise))
    for i, (landmark, k) in enumerate(zip(ids.tolist(), keyframe.tolist(), strict=True)):
        t, row = float(series.t[i]), int(series.row[i])
        if landmark < 0:
            problem.rejections.append(Rejection(t, sensor.name, row, "unknown landmark"))
            continue
        is_new = landmark not in problem.landmarks
        key = problem.landmarks.setdefault(landmark, int(L(len(problem.landmarks))))
        seen = Seen(
            k,
            key,
            sighting(series, i),
            _mounted_at(problem, k, t, sensor),
            level=series.elevation is None and landmark not in known,
            excess=float(excess[i]),
        )
        if is_new:
            _add_landmark(problem, seen, known.get(landmark))
            if seen.level:
                problem.level_landmarks.add(landmark)
        problem.readings[k].append(
            Reading(
                t=t,
                sensor=sensor.name,
                index=row,
                make=seen.make,
                robustness=config.graph.robust.landmarks,
                reason="sighting outlier",
            )
        )


def _surveyed(mission: Mission, config: Config) -> dict[int, tuple[Array, float]]:
    """Positions and sigmas of the mapped landmarks that may be trusted, by id."""
    known = mission.landmark_map
    if known is None or not config.landmarks.use_map:
        return {}
    rows = zip(known.id.tolist(), known.p_n, known.sigma.tolist(), strict=True)
    return {landmark: (p_n, sigma) for landmark, p_n, sigma in rows}


def _add_landmark(problem: Problem, seen: Seen, known: tuple[Array, float] | None) -> None:
    """A landmark where the map has it, or where its first sighting puts it."""
    if known is not None:
        p_n, sigma = known
        place = factors.nav_state(np.eye(3), p_n, np.zeros(3))
        problem.variables[seen.k].append((seen.key, lambda _: place))
        spread = np.full(3, max(sigma, LEVEL_M))
    else:
        problem.variables[seen.k].append((seen.key, seen.first_place))
        p_n = seen.first_place(lambda _: problem.initial_state(seen.k)).position()
        spread = np.array([UNKNOWN_M, UNKNOWN_M, LEVEL_M if seen.level else UNKNOWN_M])
    problem.add(seen.k, seen.sensor.name, factors.landmark_prior(seen.key, p_n, spread))


def _mounted_at(problem: Problem, k: int, t: float, sensor: Sensor) -> Sensor:
    """The sensor where it was at a time, as if mounted there on keyframe k's body."""
    if t == problem.t[k]:
        return sensor
    p_n, rpy = problem.motion.at(np.array([t]))
    R_kt = problem.R_nb[k].T @ rotation_from_rpy(rpy[0])
    p_kt = problem.R_nb[k].T @ (p_n[0] - problem.p_n[k])
    return replace(sensor, xyz_b=p_kt + R_kt @ sensor.xyz_b, R_bs=R_kt @ sensor.R_bs)
