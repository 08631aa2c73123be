"""The factor-graph method: from a mission to a smoothed solution."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from gtsam_nav.config import Config
from gtsam_nav.errors import EstimationError, PackageError
from gtsam_nav.frames import Array
from gtsam_nav.graph.backend import graph_of
from gtsam_nav.graph.cloud_loops import close_cloud_loops
from gtsam_nav.graph.doubts import unsure_for_echoes
from gtsam_nav.graph.exact_edges import refine_exactly
from gtsam_nav.graph.factors import B, X
from gtsam_nav.graph.false_loops import loop_faults
from gtsam_nav.graph.heap import give_back, keep_large
from gtsam_nav.graph.indeterminacy import check_anchored, states_named
from gtsam_nav.graph.knot_system import JointPosterior
from gtsam_nav.graph.loop_judging import judged
from gtsam_nav.graph.measurements import build_problem, clouds
from gtsam_nav.graph.online import OnlinePass, run_online
from gtsam_nav.graph.output import constant_errors, smoothed_covariances
from gtsam_nav.graph.outset import Ready, made_ready, mission_keyframes, start_and_motion
from gtsam_nav.graph.problem import Problem, SensorFactor
from gtsam_nav.graph.refinement import JointRefinement, Refined, refine_without_sonar
from gtsam_nav.graph.scan_calibration import ScanCalibration, calibrate_by_scans, planar_of
from gtsam_nav.graph.sensor_posterior import SensorPosterior
from gtsam_nav.graph.settling import Settled
from gtsam_nav.graph.solved import EchoData, SolvedGraph, solution_of
from gtsam_nav.graph.submap_loops import ScanLoops, close_submap_loops, with_matches
from gtsam_nav.mission import Mission
from gtsam_nav.odometry.cloud_track import CloudTrack
from gtsam_nav.odometry.kiss import cloud_odometry
from gtsam_nav.preprocess.motion import VehicleMotion
from gtsam_nav.series import IntArray
from gtsam_nav.solution import Progress, Solution, StageClock
from gtsam_nav.sonar.echoes import Echoes
from gtsam_nav.sonar.motion import lies_inverted
from gtsam_nav.sonar.preparation import (
    SonarData,
    deskewed,
    leave_out_defective_sonar,
    scans_at_once,
    sonar_turns,
)


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
    keep_large()
    clock = StageClock()
    solution = _estimated(mission, config, clock, progress)
    give_back()
    return replace(solution, stage_s=clock.seconds)


def _estimated(mission: Mission, config: Config, clock: StageClock, progress: Progress) -> Solution:
    ready = made_ready(mission, config, clock, progress)
    ready, echoes = _echoes(ready, clock, progress)
    problem = _built(ready, echoes, clock)
    solved, posterior = _solved(problem, ready, echoes, clock, progress)
    with clock.stage("covariance"), states_named(problem):
        give_back()
        covariances = _covariances(problem, solved.graph, posterior)
        del posterior  # its fronts make room for the trajectory
        give_back()
    return solution_of(ready, echoes, solved, covariances)


def _echoes(ready: Ready, clock: StageClock, progress: Progress) -> tuple[Ready, EchoData]:
    """Deskewed scans, what they tell of clock and odometry, and the odometry of the clouds."""
    config = ready.config
    mission, echoes, rejections, warnings = leave_out_defective_sonar(ready.mission, config.sonar)
    with clock.stage("sonar"):
        ready, sonar, by_scans = _with_scans(replace(ready, mission=mission), echoes)
    mission = ready.mission
    with clock.stage("cloud odometry"):
        track, cloud_warnings = _cloud_track(mission, config, progress)
    return ready, EchoData(
        mission, sonar, track, by_scans, rejections, (*warnings, *cloud_warnings)
    )


def _built(ready: Ready, echoes: EchoData, clock: StageClock) -> Problem:
    """The problem of a mission, which something ties to the Earth."""
    config = ready.config
    t = mission_keyframes(echoes.mission, echoes.t_scans, echoes.t_clouds, config)
    with clock.stage("factors"):
        problem = build_problem(echoes.mission, ready.start, ready.motion, t, config)
        if echoes.track is not None:
            clouds.add(problem, echoes.track, config)
        check_anchored(problem)
    return problem


def _solved(
    problem: Problem, ready: Ready, echoes: EchoData, clock: StageClock, progress: Progress
) -> tuple[SolvedGraph, SensorPosterior | JointPosterior]:
    """The causal pass, the judgement of its loops, the batch and the refinement; the Gaussian about
    the solution."""
    config, sonar = ready.config, echoes.sonar
    scan_keyframe = np.searchsorted(problem.t, echoes.t_scans)
    with clock.stage("isam2"), states_named(problem):
        faults = loop_faults(
            echoes.mission.faults, config.seed, problem, scan_keyframe, config.graph.loops
        )
        online = run_online(problem, sonar, scan_keyframe, config, progress, faults)
        give_back()
    with clock.stage("loops"), states_named(problem):
        loops = _scan_loops(problem, sonar, scan_keyframe, online, config, progress)
        give_back()
    matches, match_factors, settled = loops.matches, loops.factors, loops.settled
    others = [*problem.entries, *match_factors]
    with clock.stage("cloud loops"), states_named(problem):
        cloud_loops = close_cloud_loops(problem, echoes.track, others, settled, config, progress)
        settled = cloud_loops.settled
    with clock.stage("refinement"), states_named(problem):
        ready.clocks.describe(problem, settled.used_factors, settled.values)
        unsure = unsure_for_echoes(problem, online, sonar.echoes) if sonar else ()
        least = config.sonar.scans.min_points
        joined = None if unsure or sonar is None else sonar.of_least(least)
        graph, refined = _refined(
            problem, settled, match_factors, cloud_loops.entries, joined, config, progress
        )
    solved = SolvedGraph(
        problem=problem,
        scan_keyframe=scan_keyframe,
        wants_false=bool(faults),
        unsure=unsure,
        online=online,
        matches=matches,
        match_factors=match_factors,
        cloud_loops=cloud_loops,
        graph=graph,
        values=refined.values,
        constants=constant_errors(problem, refined.posterior.constants),
        converged=refined.converged,
    )
    return solved, refined.posterior


def _scan_loops(
    problem: Problem,
    sonar: SonarData | None,
    scan_keyframe: IntArray,
    online: OnlinePass,
    config: Config,
    progress: Progress,
) -> ScanLoops:
    """The estimate with the scans' matches: closures are judged, or between submaps still found."""
    values = online.values
    problem.integrate_all_at(values)
    if sonar is not None and sonar.at_once:
        return close_submap_loops(
            problem, sonar.scans, scan_keyframe, online.matches, values, config, progress
        )
    matches, without = judged(online.matches, problem, values, scan_keyframe, config)
    believed = without.used if without else None
    return with_matches(problem, matches, scan_keyframe, values, config, believed)


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
    problem.integrate_all_at(settled.values)
    graph = graph_of(problem.entries)
    graph.push_back(settled.factors)
    if sonar is not None and not sonar.at_once and config.graph.refinement.max_iterations:
        graph.push_back(graph_of(cloud_loops))
        joint = JointRefinement(sonar.echoes, sonar.turns, problem, config.graph.refinement)
        return graph, joint.run(graph, settled.values, progress)
    graph.push_back(graph_of([*match_factors, *cloud_loops]))
    if problem.exact:
        return refine_exactly(graph, settled.values, problem)
    return graph, refine_without_sonar(graph, settled.values, problem)


def _with_scans(
    ready: Ready, echoes: Echoes | None
) -> tuple[Ready, SonarData | None, tuple[ScanCalibration, ...]]:
    """The sonar's scans, and the mission put right by what a scanner's tell."""
    sonar = _sonar_data(ready.mission, echoes, ready.motion, ready.config)
    found = calibrate_by_scans(ready.mission, sonar, ready.motion, ready.config)
    if found is None or echoes is None:
        return ready, sonar, ()
    mission = found.corrected(ready.mission)
    start, motion = start_and_motion(mission, ready.config)
    sonar = _sonar_data(mission, echoes.shift(found.offset_s), motion, ready.config)
    return replace(ready, mission=mission, start=start, motion=motion), sonar, (found,)


def _sonar_data(
    mission: Mission, echoes: Echoes | None, motion: VehicleMotion, config: Config
) -> SonarData | None:
    """Echoes, turns and scans; None without a sonar or without a single scan."""
    planar = planar_of(motion)
    turns = sonar_turns(mission, config.sonar, planar)
    if echoes is None or turns is None:
        return None
    echoes = echoes.mirrored(lies_inverted(motion.trajectory, echoes.t))
    return deskewed(echoes, turns, planar, at_once=scans_at_once(mission))


def _cloud_track(
    mission: Mission, config: Config, progress: Progress
) -> tuple[CloudTrack | None, tuple[str, ...]]:
    """Odometry of the clouds, or why they are not used: the other sensors carry the estimate."""
    try:
        track = cloud_odometry(mission, config.kiss, progress)
        return track, track.warnings if track is not None else ()
    except (EstimationError, PackageError) as error:
        return None, (f"the clouds are not used: {error}",)


def _covariances(
    problem: Problem, graph: Any, posterior: SensorPosterior | JointPosterior
) -> dict[int, Array]:
    """Marginal covariances of keyframes, compass frames, IMU biases, landmarks and range scales."""
    index = range(len(problem.t))
    keys = [X(k) for k in index]
    keys += dict.fromkeys(problem.compass)
    keys += [B(k) for k in index] if problem.uses_imu else []
    keys += problem.landmarks.values()
    keys += problem.range_scales.values()
    if isinstance(posterior, JointPosterior):
        covariances = posterior.covariances(keys)
    else:
        covariances = smoothed_covariances(graph, keys, posterior, problem.is_stiff)
    return dict(zip(keys, covariances, strict=True))
