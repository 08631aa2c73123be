"""A mission made ready for its graph: ids, compass and clocks put right, its first guess.

Where the vehicle stands as the estimate begins, how it moves by its own sensors, and when the
graph's states are.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from gtsam_nav.config import Config
from gtsam_nav.frames import Array
from gtsam_nav.graph.clocks import Clocks, find_clocks
from gtsam_nav.graph.keyframes import keyframe_times, merged_anchors
from gtsam_nav.graph.measurements.imu import HABIT_S, own_motion, preintegrable, silences
from gtsam_nav.graph.robust import check_sigmas
from gtsam_nav.graph.taken import twins_taken
from gtsam_nav.mission import Mission
from gtsam_nav.preprocess.accelerometer_units import check_accelerometer_unit
from gtsam_nav.preprocess.alignment import Alignment, align
from gtsam_nav.preprocess.compass_steps import without_compass_steps
from gtsam_nav.preprocess.compass_turns import disturbance_walk_rad2_s, turned_by_compass
from gtsam_nav.preprocess.edge_motion import edge_motion, moves_by_edges, where_edges_lead
from gtsam_nav.preprocess.fixes_by_ranges import fixes_by_ranges
from gtsam_nav.preprocess.identified import identified, unidentified
from gtsam_nav.preprocess.inertial_motion import inertial_motion
from gtsam_nav.preprocess.landmark_start import landmark_start
from gtsam_nav.preprocess.motion import (
    VehicleMotion,
    measures_velocity,
    offset_from_fixes,
    turn_onto_fixes,
)
from gtsam_nav.preprocess.planar_motion import planar_motion
from gtsam_nav.sensors.orientation import headings_true
from gtsam_nav.sensors.twins import said_of_twin
from gtsam_nav.series import ImuSeries
from gtsam_nav.solution import Progress, StageClock

MAP_START_SIGMAS = 10.0
ROLLING_INTERVAL_S = 0.25
"""Longest time between keyframes of a vehicle on wheels: each is held to its course."""
BRIDGED_YAW_RAD = np.radians(0.2)
"""So far a compass's disturbance may stray between keyframes that know it: a bin at 30 m."""
COMPASS_INTERVAL_S = 2.0
"""Keyframes for the sake of a compass are no closer than this, since each state in a scan is tied
to all others in it; ..."""
MOST_BY_COMPASS = 3600
"""... and no more than these: those of a longer mission are further apart."""


@dataclass(frozen=True)
class Ready:
    """A mission whose ids, compass and clocks are put right, and its first guess."""

    mission: Mission
    config: Config
    start: Alignment
    motion: VehicleMotion
    clocks: Clocks
    warnings: tuple[str, ...]


def made_ready(mission: Mission, config: Config, clock: StageClock, progress: Progress) -> Ready:
    """Tell landmarks apart, take compass steps and timing errors off, guess the motion."""
    check_sigmas(mission, config.graph.robust)
    twins = tuple(_idle_twins(mission, config))
    mission = _with_one_imu(mission, config)
    nameless: tuple[str, ...] = ()
    if config.landmarks.association == "ids":
        nameless = tuple(unidentified(mission))
    else:
        with clock.stage("association"):
            mission, config = _identified(mission, config)
    if moves_by_edges(mission):
        mission = where_edges_lead(mission)
    with clock.stage("motion"):
        mission, warnings = without_compass_steps(mission)
        start, motion = start_and_motion(mission, config)
    with clock.stage("clocks"):
        t = mission_keyframes(mission, np.empty(0), np.empty(0), config)
        clocks = find_clocks(mission, start, motion, t, config, progress)
        mission = clocks.corrected(mission)
        if clocks.errors:
            start, motion = start_and_motion(mission, config)
    return Ready(mission, config, start, motion, clocks, (*nameless, *warnings, *twins))


def _idle_twins(mission: Mission, config: Config) -> Iterator[str]:
    """Sensors that are left out because another of their type is taken."""
    for name, taken in twins_taken(mission, config).items():
        yield said_of_twin(mission.sensors[name], f"the graph takes one, '{taken.name}'")


def _with_one_imu(mission: Mission, config: Config) -> Mission:
    """A mission in which no other IMU tells turns and biases than the one that is preintegrated."""
    taken = preintegrable(mission, config.graph.imu_min_rate_hz)
    if taken is None:
        return mission
    check_accelerometer_unit(mission, taken)
    return mission.without(*(imu.name for imu in mission.of_type("imu") if imu is not taken))


def _identified(mission: Mission, config: Config) -> tuple[Mission, Config]:
    """The mission with ids by association, and the settings that trust them."""
    mission = identified(mission, config.motion, config.landmarks)
    landmarks = config.landmarks.model_copy(update={"association": "ids"})
    return mission, config.model_copy(update={"landmarks": landmarks})


def start_and_motion(mission: Mission, config: Config) -> tuple[Alignment, VehicleMotion]:
    """Alignment and motion, drawn onto the fixes or the surveyed landmarks.

    Without a compass the fixes turn the motion too.
    """
    start = align(mission)
    if not mission.sensors:  # the first pose is the frame, tilt and all
        start = replace(start, sigma_rpy=np.full(3, start.sigma_rpy[2]))
    if not moves_by_edges(mission) and not measures_velocity(mission):
        return _inertial(mission, start, config)
    if not start.georeferenced and config.landmarks.use_map:
        start = _start_on_map(mission, config) or start
    motion = _moved(mission, start, config)
    if start.georeferenced and not start.heading_known:
        turn = turn_onto_fixes(mission, motion)
        if turn is None:
            return replace(start, georeferenced=False), motion
        start = replace(start, rpy=start.rpy + np.array([0.0, 0.0, turn]), heading_known=True)
        motion = _moved(mission, start, config)
    if mission.initial.p_n is None:
        offset = offset_from_fixes(mission, motion)
        start = replace(start, p_n=start.p_n + offset)
        motion = replace(motion, p_n=motion.p_n + offset)
    return start, motion


def _inertial(
    mission: Mission, start: Alignment, config: Config
) -> tuple[Alignment, VehicleMotion]:
    """By the IMU, drawn onto the fixes or what ranges tell in their stead: vague, for the ranges
    are used again."""
    fixes = fixes_by_ranges(mission, config.landmarks)
    if fixes is None:
        return start, inertial_motion(mission, start, config.motion)
    located = mission.with_sensor(fixes)
    start = align(located)
    if mission.initial.p_n is None:
        start = replace(start, sigma_p=MAP_START_SIGMAS * start.sigma_p)
    motion = inertial_motion(located, start, config.motion)
    if not start.heading_known:
        rpy, sigma_rpy = start.rpy.copy(), start.sigma_rpy.copy()
        rpy[2], sigma_rpy[2] = motion.rpy[0, 2], np.pi
        start = replace(start, rpy=rpy, sigma_rpy=sigma_rpy, heading_known=True)
    return start, motion


def _moved(mission: Mission, start: Alignment, config: Config) -> VehicleMotion:
    if moves_by_edges(mission):
        return edge_motion(mission, start)
    return own_motion(mission, start, config)


def _start_on_map(mission: Mission, config: Config) -> Alignment | None:
    """The start that the first sightings of surveyed landmarks tell, vague: they are used again."""
    if mission.landmark_map is None or mission.first("landmarks") is None:
        return None
    motion = planar_motion(mission, config.motion)
    start = None if motion is None else landmark_start(mission, motion, config.landmarks)
    if start is None:
        return None
    return replace(
        start,
        sigma_p=MAP_START_SIGMAS * start.sigma_p,
        sigma_rpy=MAP_START_SIGMAS * start.sigma_rpy,
    )


def mission_keyframes(mission: Mission, t_scans: Array, t_clouds: Array, config: Config) -> Array:
    """Keyframes at edges' poses, scans, clouds and sightings; where the IMU carries all, at fixes
    and silences too, at silences also where no AHRS tells the tilt; and often where, or while, a
    compass alone tells the turns."""
    stated = None if mission.edges is None else np.unique(mission.edges.t)
    if stated is not None and moves_by_edges(mission):  # there is nothing between their poses
        return stated
    anchors = [t_scans, t_clouds, *(sensor.series.t for sensor in mission.of_type("landmarks"))]
    interval_s = config.graph.keyframe_interval_s
    imu = preintegrable(mission, config.graph.imu_min_rate_hz)
    if imu is not None:
        assert isinstance(imu.series, ImuSeries)
        silent = silences(imu.series, *mission.span_s)
        if not measures_velocity(mission):
            anchors += [silent.ravel(), *(sensor.series.t for sensor in mission.of_type("gnss"))]
            if mission.constraints.nonholonomic:
                interval_s = min(interval_s, ROLLING_INTERVAL_S)
        elif headings_true(mission) is not None:
            step_s = _compass_interval_s(mission)
            anchors += [np.append(np.arange(a, b, step_s), b) for a, b in silent if b - a > step_s]
        begin, end = mission.span_s
        if mission.first("attitude") is None and len(silent) * HABIT_S < end - begin:
            # the readings on either side tell the tilt: none is bridged with the silence
            anchors += [silent.ravel()]
    if turned_by_compass(mission):
        interval_s = min(interval_s, _compass_interval_s(mission))
    merged = merged_anchors(anchors, config.graph.anchor_spacing_s, stated)
    return keyframe_times(*mission.span_s, merged, interval_s)


def _compass_interval_s(mission: Mission) -> float:
    """Longest time between keyframes that leaves little of a compass's disturbance between them.

    A walk of density q that is known at both ends of an interval T has the variance ``q T / 4`` at
    its middle.
    """
    begin, end = mission.span_s
    shortest = max(COMPASS_INTERVAL_S, (end - begin) / MOST_BY_COMPASS)
    walk = disturbance_walk_rad2_s(mission)
    return max(shortest, 4.0 * float(BRIDGED_YAW_RAD) ** 2 / walk) if walk else np.inf
