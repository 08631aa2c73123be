"""The factor-graph method: from a mission to a smoothed solution."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gtsam_nav.config import Config
from gtsam_nav.frames import Array
from gtsam_nav.graph.backend import solve_batch
from gtsam_nav.graph.factors import B, M, X
from gtsam_nav.graph.keyframes import keyframe_times, thin_scans
from gtsam_nav.graph.online import SCAN_MATCH, run_online
from gtsam_nav.graph.output import (
    dense_trajectory,
    keyframe_trajectory,
    loop_closures,
    pose_graph,
    slow_states,
    smoothed_covariances,
)
from gtsam_nav.graph.problem import Problem, build_problem
from gtsam_nav.graph.refinement import JointRefinement, Refined, refine_without_sonar
from gtsam_nav.mission import Mission, Rejection, Sensor
from gtsam_nav.preprocess.alignment import Alignment, align
from gtsam_nav.preprocess.motion import VehicleMotion, turn_onto_fixes, vehicle_motion
from gtsam_nav.solution import Progress, Solution, SonarMap, StageClock
from gtsam_nav.sonar.defects import WHOLE_SENSOR, sonar_defect
from gtsam_nav.sonar.echoes import Echoes, echoes_of_scans, segment
from gtsam_nav.sonar.motion import PlanarMotion
from gtsam_nav.sonar.scans import Scan, Turns, find_turns, form_scans
from gtsam_nav.trajectory import Trajectory

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class SonarData:
    """Echoes of a mission, cut into scans and deskewed by the vehicle's own motion."""

    echoes: Echoes
    turns: Turns
    scans: list[Scan]


def estimate(mission: Mission, config: Config, progress: Progress) -> Solution:
    """Estimate a mission with the factor graph.

    Parameters
    ----------
    mission : Mission
        With a DVL or odometry; IMU, heading, attitude, depth, GNSS and sonar where present.
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
    mission, echoes, rejections, warnings = _leave_out_defective_sonar(mission, config)
    with clock.stage("sonar"):
        sonar = _sonar_data(mission, echoes, motion, config)
    t_scans = sonar.turns.t_ref if sonar else np.empty(0)
    t = keyframe_times(*mission.span_s, t_scans, config.graph.keyframe_interval_s)
    scan_keyframe = np.searchsorted(t, t_scans)
    with clock.stage("factors"):
        problem = build_problem(mission, start, motion, t, config)
    with clock.stage("isam2"):
        online = run_online(problem, sonar.scans if sonar else [], scan_keyframe, config, progress)
    with clock.stage("batch"):
        values = solve_batch(online.backend.graph(), online.backend.values())
    with clock.stage("refinement"):
        if sonar is not None and config.graph.refinement.max_iterations:
            graph = online.backend.graph(without=SCAN_MATCH)
            joint = JointRefinement(sonar.echoes, sonar.turns, problem, config.graph.refinement)
            refined = joint.run(graph, values, progress)
        else:
            graph = online.backend.graph()
            refined = refine_without_sonar(graph, values, problem)
    if not refined.converged:
        warnings = (*warnings, "the refinement stopped before it settled")
    values = refined.values
    loops = loop_closures(
        online.matches, t_scans, scan_keyframe, values, config.graph.loops.cauchy_k
    )
    with clock.stage("covariance"):
        covariances = _covariances(problem, graph, refined)
    states = [values.atNavState(X(k)) for k in range(len(t))]
    keyframes = keyframe_trajectory(t, states, [covariances[X(k)] for k in range(len(t))])
    trajectory = dense_trajectory(problem, keyframes)
    return Solution(
        method="graph",
        trajectory=trajectory,
        mission=mission,
        georeferenced=start.georeferenced,
        online=keyframe_trajectory(t, online.states, online.covariances),
        loops=loops,
        rejections=(*mission.rejections, *motion.rejections, *rejections),
        warnings=(*mission.warnings, *warnings),
        slow_states=slow_states(problem, values, covariances),
        pose_graph=pose_graph(problem, keyframes, online.matches, scan_keyframe),
        sonar_map=_sonar_map(sonar, trajectory) if sonar else None,
        gnss_used=problem.n_fixes,
        n_keyframes=len(t),
        stage_s=clock.seconds,
    )


def _start_and_motion(mission: Mission, config: Config) -> tuple[Alignment, VehicleMotion]:
    """Alignment and motion; without a compass the fixes turn both the right way."""
    start = align(mission)
    motion = vehicle_motion(mission, start, config.motion)
    if start.heading_known or not start.georeferenced:
        return start, motion
    turn = turn_onto_fixes(mission, motion)
    if turn is None:
        return replace(start, georeferenced=False), motion
    start = replace(start, rpy=start.rpy + np.array([0.0, 0.0, turn]), heading_known=True)
    return start, vehicle_motion(mission, start, config.motion)


def _leave_out_defective_sonar(
    mission: Mission, config: Config
) -> tuple[Mission, Echoes | None, tuple[Rejection, ...], tuple[str, ...]]:
    """The mission with the one sonar to be used, and its echoes; why others are not is recorded."""
    rejections: list[Rejection] = []
    used: str | None = None
    echoes: Echoes | None = None
    for sonar in [*mission.of_type("beams"), *mission.of_type("scans")]:
        if not config.sonar.use:
            defect = "switched off by sonar.use"
        elif used is not None:
            defect = f"the sonar '{used}' is used"
        else:
            defect = sonar_defect(sonar)
            if not defect:
                found = _echoes(sonar, config)
                defect = "" if len(found) else "no echo stands out of its noise"
        if not defect:
            used, echoes = sonar.name, found
            continue
        log.warning("sonar '%s' is not used: %s", sonar.name, defect)
        rejections.append(Rejection(float(sonar.series.t[0]), sonar.name, WHOLE_SENSOR, defect))
        mission = mission.without(sonar.name)
    warnings = tuple(f"sonar '{r.sensor}' is not used: {r.reason}" for r in rejections)
    return mission, echoes, tuple(rejections), warnings


def _echoes(sonar: Sensor, config: Config) -> Echoes:
    if sonar.type == "beams":
        return segment(sonar, config.sonar.segmentation)
    return echoes_of_scans(sonar)


def _sonar_data(
    mission: Mission, echoes: Echoes | None, motion: VehicleMotion, config: Config
) -> SonarData | None:
    """Echoes, turns and scans; None without a sonar or without a single scan."""
    sonar = mission.first("beams") or mission.first("scans")
    if sonar is None or echoes is None:
        return None
    turns = find_turns(sonar, config.sonar.scans.max_gap_s)
    kept = thin_scans(turns.t_ref, config.graph.scan_interval_s)
    turns = Turns(turns.first[kept], turns.last[kept], turns.t_ref[kept])
    if len(turns) == 0:
        return None
    echoes = echoes.select(turns.hold(echoes.beam))
    planar = PlanarMotion.of(
        motion.trajectory, motion.position_variance_m2_s, motion.yaw_variance_rad2_s
    )
    return SonarData(echoes, turns, form_scans(echoes, turns, planar))


def _covariances(problem: Problem, graph: Any, refined: Refined) -> dict[int, Array]:
    """Marginal covariances of keyframes, compass frames and IMU biases, by key."""
    index = range(len(problem.t))
    keys = [X(k) for k in index]
    keys += [M(k) for k in index] if problem.has_compass else []
    keys += [B(k) for k in index] if problem.uses_imu else []
    covariances = smoothed_covariances(graph, keys, refined.posterior, refined.planar_information)
    return dict(zip(keys, covariances, strict=True))


def _sonar_map(sonar: SonarData, trajectory: Trajectory) -> SonarMap:
    """All echoes of the used scans where the trajectory puts them."""
    echoes = sonar.echoes
    inside = (echoes.t >= trajectory.t[0]) & (echoes.t <= trajectory.t[-1])
    p_n = np.stack([np.interp(echoes.t[inside], trajectory.t, c) for c in trajectory.p_n.T], axis=1)
    yaw = np.interp(echoes.t[inside], trajectory.t, np.unwrap(trajectory.rpy[:, 2]))
    x, y = echoes.xy_b[inside].T
    p_n[:, 0] += np.cos(yaw) * x - np.sin(yaw) * y
    p_n[:, 1] += np.sin(yaw) * x + np.cos(yaw) * y
    return SonarMap(p_n, echoes.t[inside], echoes.strength[inside])
