"""Sightings of landmarks that are told apart by their ids: each landmark is a state."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gtsam_nav.config import Config
from gtsam_nav.frames import Array, rotation_from_rpy
from gtsam_nav.graph import factors
from gtsam_nav.graph.factors import L, X
from gtsam_nav.graph.problem import Problem, Reading, StateAt
from gtsam_nav.mission import Mission, Rejection, Sensor
from gtsam_nav.sensors.landmarks import Sighting, observe, place, sighting, trusted_ids
from gtsam_nav.sensors.prediction import BodyState
from gtsam_nav.series import LandmarkSeries

UNKNOWN_M, LEVEL_M = 1e4, 1e-2
"""Spread of a landmark that was never surveyed, and of its depth where no sighting tells it."""


@dataclass(frozen=True)
class _Seen:
    """One sighting at keyframe k of a landmark, by a sensor as if mounted on that keyframe's body;
    ``level``: the landmark is taken to lie level with the sensor."""

    k: int
    key: int
    values: Sighting
    sensor: Sensor
    level: bool

    def make(self, state_at: StateAt) -> Any:
        """The native factor, linear about the present estimate."""
        body, landmark_n = _body(state_at(X(self.k))), state_at(self.key).position()
        observed = observe(
            body,
            landmark_n[None],
            self.sensor,
            elevation=self.values.elevation is not None,
            level=np.array([self.level]),
        )
        return factors.sighting(
            X(self.k),
            self.key,
            body.R_nb.T @ (landmark_n - body.p_n),
            observed.jacobian_landmark[0] @ body.R_nb,
            observed.residual(self.values.measured)[0],
            self.values.cov,
        )

    def first_place(self, state_at: StateAt) -> Any:
        """The landmark where the sighting puts it."""
        p_n = place(_body(state_at(X(self.k))), self.values, self.sensor).p_n
        return factors.nav_state(np.eye(3), p_n, np.zeros(3))


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
    for i, (landmark, k) in enumerate(zip(ids.tolist(), keyframe.tolist(), strict=True)):
        t, row = float(series.t[i]), int(series.row[i])
        if landmark < 0:
            problem.rejections.append(Rejection(t, sensor.name, row, "unknown landmark"))
            continue
        is_new = landmark not in problem.landmarks
        key = problem.landmarks.setdefault(landmark, int(L(len(problem.landmarks))))
        seen = _Seen(
            k,
            key,
            sighting(series, i),
            _mounted_at(problem, k, t, sensor),
            level=series.elevation is None and landmark not in known,
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
                gate_probability=config.landmarks.gate_probability,
                reason="sighting outlier",
                cauchy_k=config.graph.sighting_cauchy_k,
            )
        )


def _surveyed(mission: Mission, config: Config) -> dict[int, tuple[Array, float]]:
    """Positions and sigmas of the mapped landmarks that may be trusted, by id."""
    known = mission.landmark_map
    if known is None or not config.landmarks.use_map:
        return {}
    rows = zip(known.id.tolist(), known.p_n, known.sigma.tolist(), strict=True)
    return {landmark: (p_n, sigma) for landmark, p_n, sigma in rows}


def _add_landmark(problem: Problem, seen: _Seen, known: tuple[Array, float] | None) -> None:
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


def _body(state: Any) -> BodyState:
    return BodyState(state.attitude().matrix(), state.position(), state.velocity())


def _mounted_at(problem: Problem, k: int, t: float, sensor: Sensor) -> Sensor:
    """The sensor where it was at a time, as if mounted there on keyframe k's body."""
    if t == problem.t[k]:
        return sensor
    p_n, rpy = problem.motion.at(np.array([t]))
    R_kt = problem.R_nb[k].T @ rotation_from_rpy(rpy[0])
    p_kt = problem.R_nb[k].T @ (p_n[0] - problem.p_n[k])
    return replace(sensor, xyz_b=p_kt + R_kt @ sensor.xyz_b, R_bs=R_kt @ sensor.R_bs)
