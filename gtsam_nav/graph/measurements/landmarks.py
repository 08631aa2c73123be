"""Sightings of landmarks that are told apart by their ids: each landmark is a state.

A landmark enters the graph once its sightings tell where it is: at the first one that measures both
range and bearing, or when several of ranges or bearings alone leave one place; those before enter
with it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gtsam_nav.config import Config
from gtsam_nav.frames import Array, rotation_from_rpy
from gtsam_nav.graph import factors, frame_factors
from gtsam_nav.graph.factors import L, S, X
from gtsam_nav.graph.measurements.sightings import Seen, SightingFactors
from gtsam_nav.graph.problem import Problem
from gtsam_nav.graph.readings import Reading, StateAt
from gtsam_nav.mission import Mission, Rejection, Sensor
from gtsam_nav.preprocess.landmark_placing import Views, place_by_views
from gtsam_nav.sensors.landmarks import place, sighting, trusted_ids, variance_factors
from gtsam_nav.sensors.noise import LandmarkNoise
from gtsam_nav.sensors.prediction import BodyState
from gtsam_nav.series import IntArray, LandmarkSeries

UNKNOWN_M, LEVEL_M = 1e4, 1e-2
"""Spread of a landmark that was never surveyed, and of its depth where no sighting tells it."""
LEAST_RANGE_SIGMAS = 3.0
"""A nearer landmark has no direction to be placed in."""
TOO_NEAR = "too near to place a landmark by"
UNKNOWN = "unknown landmark"
NO_PLACE = "nothing tells where on the map of surveyed landmarks the mission begins: it is not used"


@dataclass(frozen=True)
class Entry:
    """How a landmark enters the graph: at which keyframe, where, and how well that is known."""

    k: int
    first: Callable[[StateAt], Any]
    p_n: Array
    sigma: Array


class Sightings:
    """What one sensor sees within the problem's time.

    Parameters
    ----------
    problem : Problem
    sensor : Sensor
    config : Config
    known : mapping
        Position and sigma of the surveyed landmarks that are trusted, by id.
    """

    def __init__(
        self,
        problem: Problem,
        sensor: Sensor,
        config: Config,
        known: dict[int, tuple[Array, float]],
    ) -> None:
        series = sensor.series
        assert isinstance(series, LandmarkSeries)
        self.series = series.select(problem.spans(series.t))
        self.problem, self.sensor, self.known = problem, sensor, known
        self.noise = LandmarkNoise.model_validate(sensor.noise)
        self.ids = trusted_ids(self.series, config.landmarks)
        self.keyframe = problem.keyframe_nearest(self.series.t)

    @property
    def is_flat(self) -> bool:
        """Whether its sightings tell no depth."""
        flat = self.series.bearing is not None or self.problem.planar
        return flat and self.series.elevation is None

    def entry(self, landmark: int) -> Entry | str:
        """How a landmark enters; why not, where its sightings do not place it."""
        own = np.flatnonzero(self.ids == landmark)
        if landmark in self.known:
            p_n, sigma = self.known[landmark]
            state = factors.nav_state(np.eye(3), p_n, np.zeros(3))
            spread = np.full(3, max(sigma, LEVEL_M))
            return Entry(int(self.keyframe[own[0]]), lambda _: state, p_n, spread)
        spread = np.full(3, UNKNOWN_M)
        if landmark in self.problem.level_landmarks:
            spread[2] = LEVEL_M
        if self.series.range_m is None or self.series.bearing is None:
            return self._entry_by_views(own, spread)
        assert self.series.sigma_range is not None
        far = self.series.range_m[own] >= LEAST_RANGE_SIGMAS * self.series.sigma_range[own]
        if not np.any(far):
            return TOO_NEAR
        return self._entry_by_sighting(int(own[np.argmax(far)]), spread)

    def _entry_by_sighting(self, i: int, spread: Array) -> Entry:
        k, seen = int(self.keyframe[i]), sighting(self.series, i)
        mounted = self._mounted(i)

        def first(state_at: StateAt) -> Any:
            state = state_at(X(k))
            body = BodyState(state.attitude().matrix(), state.position(), state.velocity())
            return factors.nav_state(np.eye(3), place(body, seen, mounted).p_n, np.zeros(3))

        return Entry(k, first, first(lambda _: self.problem.initial_state(k)).position(), spread)

    def _entry_by_views(self, own: IntArray, spread: Array) -> Entry | str:
        t, motion = self.series.t[own], self.problem.motion
        p_n, rpy = motion.at(t)
        R_nb = rotation_from_rpy(rpy)
        views = Views(
            [sighting(self.series, i) for i in own.tolist()],
            R_nb @ self.sensor.R_bs,
            p_n + R_nb @ self.sensor.xyz_b,
            np.interp(t, motion.t, motion.position_variance),
            motion.yaw_variance_rad2_s * t,
        )
        level = bool(spread[2] == LEVEL_M)
        placed = place_by_views(views, level=level, range_scale_sigma=self.noise.range_scale_sigma)
        if isinstance(placed, str):
            return placed
        k = int(self.keyframe[own[placed.n_views - 1]])
        offset_b = self.problem.R_nb[k].T @ (placed.p_n - self.problem.p_n[k])

        def first(state_at: StateAt) -> Any:
            state = state_at(X(k))
            p_n = state.position() + state.attitude().matrix() @ offset_b
            return factors.nav_state(np.eye(3), p_n, np.zeros(3))

        return Entry(k, first, placed.p_n, spread)

    def _mounted(self, i: int) -> Sensor:
        """The sensor where it was at a sighting, as if mounted there on its keyframe's body."""
        t, k, problem = float(self.series.t[i]), int(self.keyframe[i]), self.problem
        if t == problem.t[k]:
            return self.sensor
        p_n, rpy = problem.motion.at(np.array([t]))
        R_kt = problem.R_nb[k].T @ rotation_from_rpy(rpy[0])
        p_kt = problem.R_nb[k].T @ (p_n[0] - problem.p_n[k])
        xyz_b, R_bs = p_kt + R_kt @ self.sensor.xyz_b, R_kt @ self.sensor.R_bs
        return replace(self.sensor, xyz_b=xyz_b, R_bs=R_bs)

    def add(self, entries: dict[int, Entry | str], config: Config) -> None:
        """Every sighting of a landmark that entered as a reading; the others as rejections."""
        problem, name = self.problem, self.sensor.name
        scale_key = self._range_scale()
        excess, own = variance_factors(self.series.t, self.noise), SightingFactors()
        for i, (landmark, k) in enumerate(
            zip(self.ids.tolist(), self.keyframe.tolist(), strict=True)
        ):
            t, row = float(self.series.t[i]), int(self.series.row[i])
            entry = UNKNOWN if landmark < 0 else entries[landmark]
            if isinstance(entry, str):
                problem.rejections.append(Rejection(t, name, row, entry))
                continue
            seen = Seen(
                k,
                problem.landmarks[landmark],
                sighting(self.series, i),
                self._mounted(i),
                level=landmark in problem.level_landmarks,
                planar=problem.planar,
                excess=float(excess[i]),
                scale_key=scale_key,
            )
            own.seen.append(seen)
            problem.readings[max(k, entry.k)].append(
                Reading(
                    t=t,
                    sensor=name,
                    index=row,
                    maker=own,
                    row=len(own.seen) - 1,
                    robustness=config.graph.robust.landmarks,
                    reason="sighting outlier",
                )
            )

    def _range_scale(self) -> int | None:
        """Key of the state that says by what share the ranges are too long, if that is doubtful."""
        if self.series.range_m is None or self.noise.range_scale_sigma == 0.0:
            return None
        key = int(S(len(self.problem.range_scales)))
        self.problem.range_scales[self.sensor.name] = key
        self.problem.add_variable(0, key, factors.nav_state(np.eye(3), np.zeros(3), np.zeros(3)))
        prior = frame_factors.range_scale_prior(key, self.noise.range_scale_sigma)
        self.problem.add(0, self.sensor.name, prior)
        return key


def add(problem: Problem, mission: Mission, config: Config) -> None:
    """Every sighting with an id, and the landmarks that are seen."""
    known = _surveyed(problem, mission, config)
    sensors = [Sightings(problem, sensor, config, known) for sensor in mission.of_type("landmarks")]
    problem.level_landmarks = _level(sensors) - set(known)
    entries: dict[int, Entry | str] = {}
    for own in sorted(sensors, key=lambda own: own.series.elevation is None):
        for landmark in dict.fromkeys(own.ids[own.ids >= 0].tolist()):
            if isinstance(entries.get(landmark, ""), str):
                entries[landmark] = own.entry(landmark)
                _enter(problem, own, landmark, entries[landmark])
    for own in sensors:
        own.add(entries, config)
    for landmark, entry in entries.items():
        if isinstance(entry, str):
            problem.warnings.append(f"landmark {landmark} is not used: {entry}")


def _level(sensors: list[Sightings]) -> set[int]:
    """Landmarks that are taken to lie level with the sensors that see them: none tells a depth."""
    flat, others = (
        {landmark for own in sensors if own.is_flat is told for landmark in own.ids.tolist()}
        for told in (True, False)
    )
    return flat - others


def _enter(problem: Problem, own: Sightings, landmark: int, entry: Entry | str) -> None:
    if isinstance(entry, str):
        return
    key = int(L(len(problem.landmarks)))
    problem.landmarks[landmark] = key
    problem.variables[entry.k].append((key, entry.first))
    prior = frame_factors.landmark_prior(key, entry.p_n, entry.sigma)
    problem.add(entry.k, own.sensor.name, prior)


def _surveyed(problem: Problem, mission: Mission, config: Config) -> dict[int, tuple[Array, float]]:
    """Positions and sigmas of the mapped landmarks that may be trusted, by id."""
    known = mission.landmark_map
    if known is None or not config.landmarks.use_map or mission.first("landmarks") is None:
        return {}
    if problem.measures_velocity and not problem.alignment.georeferenced:
        problem.warnings.append(NO_PLACE)
        return {}
    rows = zip(known.id.tolist(), known.p_n, known.sigma.tolist(), strict=True)
    return {landmark: (p_n, sigma) for landmark, p_n, sigma in rows}
