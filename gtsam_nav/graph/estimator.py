"""The factor-graph method: from a mission to a smoothed solution."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gtsam_nav.config import Config
from gtsam_nav.errors import EstimationError, PackageError
from gtsam_nav.frames import Array
from gtsam_nav.graph.backend import graph_of
from gtsam_nav.graph.clocks import Clocks, find_clocks
from gtsam_nav.graph.cloud_loops import close_cloud_loops, cloud_loop_closures, cloud_loop_edges
from gtsam_nav.graph.dense import dense_trajectory
from gtsam_nav.graph.factors import B, X
from gtsam_nav.graph.false_loops import loop_faults
from gtsam_nav.graph.indeterminacy import check_anchored, states_named
from gtsam_nav.graph.keyframes import keyframe_times, merged_anchors
from gtsam_nav.graph.loop_judging import judged
from gtsam_nav.graph.measurements import build_problem, clouds
from gtsam_nav.graph.measurements.constraints import rolls
from gtsam_nav.graph.measurements.gnss import POSITION_OUTLIER
from gtsam_nav.graph.measurements.imu import preintegrable, silences
from gtsam_nav.graph.online import OnlinePass, run_online
from gtsam_nav.graph.output import (
    constant_errors,
    keyframe_trajectory,
    landmark_estimates,
    loop_closures,
    match_rejections,
    pose_graph,
    slow_states,
    smoothed_covariances,
)
from gtsam_nav.graph.problem import Problem, SensorFactor
from gtsam_nav.graph.refinement import JointRefinement, Refined, refine_without_sonar
from gtsam_nav.graph.robust import check_sigmas
from gtsam_nav.graph.scan_calibration import ScanCalibration, calibrate_by_scans, planar_of
from gtsam_nav.graph.scan_matching import ScanMatch
from gtsam_nav.graph.settling import Settled
from gtsam_nav.graph.submap_loops import ScanLoops, close_submap_loops, with_matches
from gtsam_nav.graph.weights import contradictions, robust_weights
from gtsam_nav.mission import Mission
from gtsam_nav.odometry.cloud_map import map_or_reason
from gtsam_nav.odometry.kiss import CloudTrack, cloud_odometry
from gtsam_nav.preprocess.alignment import Alignment, align
from gtsam_nav.preprocess.compass_steps import without_compass_steps
from gtsam_nav.preprocess.identified import identified
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
from gtsam_nav.series import ImuSeries, IntArray
from gtsam_nav.solution import Progress, Solution, SonarMap, StageClock
from gtsam_nav.sonar.echoes import Echoes
from gtsam_nav.sonar.preparation import (
    SonarData,
    deskewed,
    leave_out_defective_sonar,
    registered_scans,
    scans_at_once,
    sonar_map,
    sonar_turns,
)
from gtsam_nav.trajectory import Trajectory

MAP_START_SIGMAS = 10.0
LEAST_BELIEVED = 0.2
"""Where a smaller share of the fixes agrees, none of them tells where the vehicle is."""
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
    clock, robust = StageClock(), config.graph.robust
    ready = _made_ready(mission, config, clock, progress)
    config = ready.config
    mission, echoes, rejections, warnings = leave_out_defective_sonar(ready.mission, config.sonar)
    with clock.stage("sonar"):
        ready, sonar, by_scans = _with_scans(replace(ready, mission=mission), echoes)
    mission, motion = ready.mission, ready.motion
    with clock.stage("cloud odometry"):
        track, cloud_warnings = _cloud_track(mission, config, progress)
    t_scans = sonar.turns.t_ref if sonar else np.empty(0)
    t = _keyframe_times(mission, t_scans, track, config)
    scan_keyframe = np.searchsorted(t, t_scans)
    with clock.stage("factors"):
        problem = build_problem(mission, ready.start, motion, t, config)
        if track is not None:
            clouds.add(problem, track, config)
        check_anchored(problem)
    faults = loop_faults(mission.faults, config.seed, problem, scan_keyframe, config.graph.loops)
    with clock.stage("isam2"), states_named(problem):
        online = run_online(problem, sonar, scan_keyframe, config, progress, faults)
    with clock.stage("loops"), states_named(problem):
        loops = _scan_loops(problem, sonar, scan_keyframe, online, config, progress)
    matches, match_factors, settled = loops.matches, loops.factors, loops.settled
    joined = [m for m in matches if m.accepted]
    others = [*problem.entries, *match_factors]
    with clock.stage("cloud loops"), states_named(problem):
        cloud_loops = close_cloud_loops(problem, track, others, settled, config, progress)
        settled = cloud_loops.settled
    with clock.stage("refinement"), states_named(problem):
        ready.clocks.describe(problem, settled.used_factors, settled.values)
        graph, refined = _refined(
            problem, settled, match_factors, cloud_loops.entries, sonar, config, progress
        )
    values = refined.values
    timed = [(float(t_scans[m.b]), f) for m, f in zip(joined, match_factors, strict=True)]
    weights = robust_weights(problem, timed, settled.used, values)
    constants = constant_errors(problem, refined)
    clock_offsets = (*ready.clocks.offsets(constants), *(c.clock for c in by_scans))
    with clock.stage("covariance"), states_named(problem):
        covariances = _covariances(problem, graph, refined)
    keyframes = _keyframes(t, values, covariances)
    trajectory = dense_trajectory(problem, values, keyframes)
    points, map_warnings = _map(sonar, track, trajectory, config)
    edges = cloud_loop_edges(cloud_loops.loops)
    return Solution(
        method="graph",
        trajectory=trajectory,
        mission=mission,
        georeferenced=_is_georeferenced(problem, settled, mission),
        online=keyframe_trajectory(t, online.states, online.covariances),
        loops=(
            *loop_closures(matches, t_scans, scan_keyframe, values, robust.loops),
            *cloud_loop_closures(cloud_loops.loops, problem, values, robust.loops),
        ),
        rejections=(
            *mission.rejections,
            *motion.rejections,
            *rejections,
            *problem.rejections,
            *settled.rejections,
            *match_rejections(matches, t_scans),
        ),
        robust_weights=weights,
        warnings=(
            *mission.warnings,
            *problem.warnings,
            *ready.warnings,
            *warnings,
            *(warning for c in by_scans for warning in c.warnings),
            *cloud_warnings,
            *cloud_loops.warnings,
            *map_warnings,
            *(offset.warning for offset in clock_offsets if not offset.observed),
            *_doubts(problem, settled, refined),
            *_missing_loops(bool(faults), matches),
            *contradictions(weights),
        ),
        slow_states=slow_states(problem, values, covariances, constants),
        clock_offsets=clock_offsets,
        pose_graph=pose_graph(problem, keyframes, matches, scan_keyframe, edges),
        sonar_map=points,
        scans=registered_scans(mission, sonar) if sonar else None,
        landmarks=landmark_estimates(problem, values, covariances, set(settled.factors.keys())),
        gnss_used=_fixes(problem, settled)[1],
        n_keyframes=len(t),
        stage_s=clock.seconds,
    )


@dataclass(frozen=True)
class _Ready:
    """A mission whose ids, compass and clocks are put right, and its first guess."""

    mission: Mission
    config: Config
    start: Alignment
    motion: VehicleMotion
    clocks: Clocks
    warnings: tuple[str, ...]


def _made_ready(mission: Mission, config: Config, clock: StageClock, progress: Progress) -> _Ready:
    """Tell landmarks apart, take compass steps and timing errors off, guess the motion."""
    check_sigmas(mission, config.graph.robust)
    if config.landmarks.association != "ids":
        with clock.stage("association"):
            mission, config = _identified(mission, config)
    with clock.stage("motion"):
        mission, warnings = without_compass_steps(mission)
        start, motion = _start_and_motion(mission, config)
    with clock.stage("clocks"):
        t = _keyframe_times(mission, np.empty(0), None, config)
        clocks = find_clocks(mission, start, motion, t, config, progress)
        mission = clocks.corrected(mission)
        if clocks.errors:
            start, motion = _start_and_motion(mission, config)
    return _Ready(mission, config, start, motion, clocks, warnings)


def _scan_loops(
    problem: Problem,
    sonar: SonarData | None,
    scan_keyframe: IntArray,
    online: OnlinePass,
    config: Config,
    progress: Progress,
) -> ScanLoops:
    """The estimate with the scans' matches: closures are judged, or between submaps still found."""
    values = online.backend.values()
    if sonar is not None and sonar.at_once:
        return close_submap_loops(
            problem, sonar.scans, scan_keyframe, online.matches, values, config, progress
        )
    matches = judged(online.matches, problem, values, scan_keyframe, config)
    return with_matches(problem, matches, scan_keyframe, values, config)


def _refined(
    problem: Problem,
    settled: Settled,
    match_factors: list[SensorFactor],
    cloud_loops: list[SensorFactor],
    sonar: SonarData | None,
    config: Config,
    progress: Progress,
) -> tuple[Any, Refined]:
    """The last solve, and the graph that it rests on: the echoes take the place of the matches."""
    graph = graph_of(problem.entries)
    graph.push_back(settled.factors)
    if sonar is not None and not sonar.at_once and config.graph.refinement.max_iterations:
        graph.push_back(graph_of(cloud_loops))
        joint = JointRefinement(sonar.echoes, sonar.turns, problem, config.graph.refinement)
        return graph, joint.run(graph, settled.values, progress)
    graph.push_back(graph_of([*match_factors, *cloud_loops]))
    return graph, refine_without_sonar(graph, settled.values, problem)


def _doubts(problem: Problem, settled: Settled, refined: Refined) -> Iterator[str]:
    """What speaks against the solution."""
    fixes, believed = _fixes(problem, settled)
    if not _enough(believed, fixes):
        yield f"gnss: only {believed} of {fixes} fixes agree with each other"
    if not (refined.converged and settled.settled):
        yield "the refinement stopped before it settled"


def _missing_loops(wanted: bool, matches: list[ScanMatch]) -> Iterator[str]:
    if wanted and not any(m.is_injected for m in matches):
        yield "no loop closures: there were none to put false ones among"


def _fixes(problem: Problem, settled: Settled) -> tuple[int, int]:
    """Number of fixes with a position, and of those that were believed."""
    readings = (reading for brought in problem.readings for reading in brought)
    every, used = (
        len({(r.sensor, r.index) for r in some if r.reason == POSITION_OUTLIER})
        for some in (readings, settled.used)
    )
    return every, used


def _keyframes(t: Array, values: Any, covariances: dict[int, Array]) -> Trajectory:
    """The keyframes of a solution as a trajectory."""
    keys = [X(k) for k in range(len(t))]
    states = [values.atNavState(key) for key in keys]
    return keyframe_trajectory(t, states, [covariances[key] for key in keys])


def _is_georeferenced(problem: Problem, settled: Settled, mission: Mission) -> bool:
    """Whether the start is known in the world, and the fixes that told it were believed."""
    fixes, believed = _fixes(problem, settled)
    told = _enough(believed, fixes) or mission.initial.p_n is not None
    return problem.alignment.georeferenced and told


def _enough(believed: int, fixes: int) -> bool:
    """Whether the fixes that were believed are more than a chance agreement among outliers."""
    return believed >= LEAST_BELIEVED * fixes


def _identified(mission: Mission, config: Config) -> tuple[Mission, Config]:
    """The mission with ids by association, and the settings that trust them."""
    mission = identified(mission, config.motion, config.landmarks)
    landmarks = config.landmarks.model_copy(update={"association": "ids"})
    return mission, config.model_copy(update={"landmarks": landmarks})


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


def _with_scans(
    ready: _Ready, echoes: Echoes | None
) -> tuple[_Ready, SonarData | None, list[ScanCalibration]]:
    """The sonar's scans, and the mission put right by what a scanner's tell."""
    sonar = _sonar_data(ready.mission, echoes, ready.motion, ready.config)
    found = calibrate_by_scans(ready.mission, sonar, ready.motion, ready.config)
    if found is None or echoes is None:
        return ready, sonar, []
    mission = found.corrected(ready.mission)
    start, motion = _start_and_motion(mission, ready.config)
    sonar = _sonar_data(mission, echoes.shift(found.clock.offset_s), motion, ready.config)
    return replace(ready, mission=mission, start=start, motion=motion), sonar, [found]


def _sonar_data(
    mission: Mission, echoes: Echoes | None, motion: VehicleMotion, config: Config
) -> SonarData | None:
    """Echoes, turns and scans; None without a sonar or without a single scan."""
    planar = planar_of(motion)
    turns = sonar_turns(mission, config.sonar, planar)
    if echoes is None or turns is None:
        return None
    return deskewed(echoes, turns, planar, at_once=scans_at_once(mission))


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
    """Marginal covariances of keyframes, compass frames, IMU biases, landmarks and range scales."""
    index = range(len(problem.t))
    keys = [X(k) for k in index]
    keys += dict.fromkeys(problem.compass)
    keys += [B(k) for k in index] if problem.uses_imu else []
    keys += problem.landmarks.values()
    keys += problem.range_scales.values()
    covariances = smoothed_covariances(
        graph, keys, refined.posterior, refined.planar_information, problem.is_stiff
    )
    return dict(zip(keys, covariances, strict=True))
