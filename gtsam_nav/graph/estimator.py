"""The factor-graph method: from a mission to a smoothed solution."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from gtsam_nav.config import Config
from gtsam_nav.errors import EstimationError, PackageError
from gtsam_nav.frames import Array
from gtsam_nav.graph.cloud_loops import close_cloud_loops, cloud_loop_closures, cloud_loop_edges
from gtsam_nav.graph.dense import dense_trajectory
from gtsam_nav.graph.factors import B, X
from gtsam_nav.graph.keyframes import keyframe_times, merged_anchors
from gtsam_nav.graph.measurements import build_problem, clouds
from gtsam_nav.graph.measurements.constraints import rolls
from gtsam_nav.graph.measurements.gnss import POSITION_OUTLIER
from gtsam_nav.graph.measurements.imu import preintegrable, silences
from gtsam_nav.graph.online import SCAN_MATCH, run_online
from gtsam_nav.graph.output import (
    keyframe_trajectory,
    landmark_estimates,
    loop_closures,
    pose_graph,
    slow_states,
    smoothed_covariances,
)
from gtsam_nav.graph.problem import Problem
from gtsam_nav.graph.refinement import JointRefinement, Refined, refine_without_sonar
from gtsam_nav.graph.settling import settle
from gtsam_nav.mission import Mission
from gtsam_nav.odometry.cloud_map import map_or_reason
from gtsam_nav.odometry.kiss import CloudTrack, cloud_odometry
from gtsam_nav.preprocess.alignment import Alignment, align
from gtsam_nav.preprocess.inertial_motion import inertial_motion
from gtsam_nav.preprocess.landmark_start import landmark_start
from gtsam_nav.preprocess.motion import (
    VehicleMotion,
    measures_velocity,
    offset_from_fixes,
    turn_onto_fixes,
    vehicle_motion,
)
from gtsam_nav.preprocess.planar_motion import planar_motion
from gtsam_nav.series import ImuSeries
from gtsam_nav.solution import Progress, Solution, SonarMap, StageClock
from gtsam_nav.sonar.echoes import Echoes
from gtsam_nav.sonar.motion import PlanarMotion
from gtsam_nav.sonar.preparation import (
    SonarData,
    deskewed,
    leave_out_defective_sonar,
    sonar_map,
    sonar_turns,
)
from gtsam_nav.trajectory import Trajectory

MAP_START_SIGMAS = 10.0
ROLLING_INTERVAL_S = 0.25
"""Longest time between keyframes of a vehicle on wheels: each is held to its course."""


def estimate(mission: Mission, config: Config, progress: Progress) -> Solution:
    """Estimate a mission with the factor graph.

    Parameters
    ----------
    mission : Mission
        With a DVL, odometry or IMU; heading, attitude, depth, GNSS, sonar and 3-D clouds where
        present.
    config : Config
    progress : Progress

    Raises
    ------
    DataError
        Where nothing measures the velocity.
    EstimationError
        Where the graph is indeterminate or diverges.
    """
    clock = StageClock()
    with clock.stage("motion"):
        start, motion = _start_and_motion(mission, config)
    mission, echoes, rejections, warnings = leave_out_defective_sonar(mission, config.sonar)
    with clock.stage("sonar"):
        sonar = _sonar_data(mission, echoes, motion, config)
    with clock.stage("cloud odometry"):
        track, cloud_warnings = _cloud_track(mission, config, progress)
    t_scans = sonar.turns.t_ref if sonar else np.empty(0)
    t = _keyframe_times(mission, t_scans, track, config)
    scan_keyframe = np.searchsorted(t, t_scans)
    with clock.stage("factors"):
        problem = build_problem(mission, start, motion, t, config)
        if track is not None:
            clouds.add(problem, track, config)
    with clock.stage("isam2"):
        online = run_online(problem, sonar.scans if sonar else [], scan_keyframe, config, progress)
    with clock.stage("batch"):
        settled = settle(problem, online.backend.graph(), online.backend.values())
    with clock.stage("cloud loops"):
        cloud_loops = close_cloud_loops(
            problem, track, online.backend.graph(), settled, config, progress
        )
        settled = cloud_loops.settled
    with clock.stage("refinement"):
        if sonar is not None and config.graph.refinement.max_iterations:
            graph = online.backend.graph(without=SCAN_MATCH)
            graph.push_back(cloud_loops.factors)
            graph.push_back(settled.factors)
            joint = JointRefinement(sonar.echoes, sonar.turns, problem, config.graph.refinement)
            refined = joint.run(graph, settled.values, progress)
        else:
            graph = online.backend.graph()
            graph.push_back(cloud_loops.factors)
            graph.push_back(settled.factors)
            refined = refine_without_sonar(graph, settled.values, problem)
    if not (refined.converged and settled.settled):
        warnings = (*warnings, "the refinement stopped before it settled")
    values = refined.values
    loops = loop_closures(
        online.matches, t_scans, scan_keyframe, values, config.graph.loops.cauchy_k
    )
    loops += cloud_loop_closures(
        cloud_loops.loops, problem, values, config.graph.cloud_loops.cauchy_k
    )
    with clock.stage("covariance"):
        covariances = _covariances(problem, graph, refined)
    states = [values.atNavState(X(k)) for k in range(len(t))]
    keyframes = keyframe_trajectory(t, states, [covariances[X(k)] for k in range(len(t))])
    trajectory = dense_trajectory(problem, values, keyframes)
    points, map_warnings = _map(sonar, track, trajectory, config)
    return Solution(
        method="graph",
        trajectory=trajectory,
        mission=mission,
        georeferenced=start.georeferenced,
        online=keyframe_trajectory(t, online.states, online.covariances),
        loops=loops,
        rejections=(
            *mission.rejections,
            *motion.rejections,
            *rejections,
            *problem.rejections,
            *settled.rejections,
        ),
        warnings=(
            *mission.warnings,
            *problem.warnings,
            *warnings,
            *cloud_warnings,
            *cloud_loops.warnings,
            *map_warnings,
        ),
        slow_states=slow_states(problem, values, covariances),
        pose_graph=pose_graph(
            problem,
            keyframes,
            online.matches,
            scan_keyframe,
            cloud_loop_edges(cloud_loops.loops),
        ),
        sonar_map=points,
        landmarks=landmark_estimates(problem, values, covariances, set(settled.factors.keys())),
        gnss_used=len({(r.sensor, r.index) for r in settled.used if r.reason == POSITION_OUTLIER}),
        n_keyframes=len(t),
        stage_s=clock.seconds,
    )


def _start_and_motion(mission: Mission, config: Config) -> tuple[Alignment, VehicleMotion]:
    """Alignment and motion, drawn onto the fixes or the surveyed landmarks.

    Without a compass the fixes turn the motion too.
    """
    start = align(mission)
    if not measures_velocity(mission):
        return start, inertial_motion(mission, start, config.motion)
    if not start.georeferenced and config.landmarks.use_map:
        start = _start_on_map(mission, config) or start
    motion = vehicle_motion(mission, start, config.motion)
    if start.georeferenced and not start.heading_known:
        turn = turn_onto_fixes(mission, motion)
        if turn is None:
            return replace(start, georeferenced=False), motion
        start = replace(start, rpy=start.rpy + np.array([0.0, 0.0, turn]), heading_known=True)
        motion = vehicle_motion(mission, start, config.motion)
    if mission.initial.p_n is None:
        offset = offset_from_fixes(mission, motion)
        start = replace(start, p_n=start.p_n + offset)
        motion = replace(motion, p_n=motion.p_n + offset)
    return start, motion


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


def _keyframe_times(
    mission: Mission, t_scans: Array, track: CloudTrack | None, config: Config
) -> Array:
    """Keyframes at scans, clouds and sightings; where the IMU carries all, at fixes and silences
    too."""
    t_clouds = np.array([cloud.t for cloud in track.key] if track else [])
    anchors = [t_scans, t_clouds, *(sensor.series.t for sensor in mission.of_type("landmarks"))]
    interval_s = config.graph.keyframe_interval_s
    imu = preintegrable(mission, config.graph.imu_min_rate_hz)
    if imu is not None and not measures_velocity(mission):
        assert isinstance(imu.series, ImuSeries)
        anchors += [silences(imu.series, *mission.span_s).ravel()]
        anchors += [sensor.series.t for sensor in mission.of_type("gnss")]
        if rolls(mission, config):
            interval_s = min(interval_s, ROLLING_INTERVAL_S)
    merged = merged_anchors(anchors, config.graph.anchor_spacing_s)
    return keyframe_times(*mission.span_s, merged, interval_s)


def _sonar_data(
    mission: Mission, echoes: Echoes | None, motion: VehicleMotion, config: Config
) -> SonarData | None:
    """Echoes, turns and scans; None without a sonar or without a single scan."""
    turns = sonar_turns(mission, config.sonar)
    if echoes is None or turns is None:
        return None
    planar = PlanarMotion.of(
        motion.trajectory, motion.position_variance_m2_s, motion.yaw_variance_rad2_s
    )
    return deskewed(echoes, turns, planar)


def _cloud_track(
    mission: Mission, config: Config, progress: Progress
) -> tuple[CloudTrack | None, tuple[str, ...]]:
    """Odometry of the clouds, or why they are not used: the other sensors carry the estimate."""
    try:
        return cloud_odometry(mission, config.kiss, progress), ()
    except (EstimationError, PackageError) as error:
        return None, (f"the clouds are not used: {error}",)


def _map(
    sonar: SonarData | None, track: CloudTrack | None, trajectory: Trajectory, config: Config
) -> tuple[SonarMap | None, tuple[str, ...]]:
    """Map of the sonar's echoes, else of the clouds; and why there is none of these."""
    if sonar is not None:
        return sonar_map(sonar.echoes, trajectory), ()
    if track is None:
        return None, ()
    return map_or_reason(track, trajectory, config.open3d.voxel_m)


def _covariances(problem: Problem, graph: Any, refined: Refined) -> dict[int, Array]:
    """Marginal covariances of keyframes, compass frames, IMU biases and landmarks, by key."""
    index = range(len(problem.t))
    keys = [X(k) for k in index]
    keys += dict.fromkeys(problem.compass)
    keys += [B(k) for k in index] if problem.uses_imu else []
    keys += problem.landmarks.values()
    covariances = smoothed_covariances(
        graph, keys, refined.posterior, refined.planar_information, problem.is_stiff
    )
    return dict(zip(keys, covariances, strict=True))
