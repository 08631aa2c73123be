"""The graph at its solution, with what the echoes told, and the `Solution` that is told of it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from gtsam_nav.config import Config
from gtsam_nav.frames import Array
from gtsam_nav.graph.clock_check import suspected_constants
from gtsam_nav.graph.cloud_loops import CloudLoops, cloud_loop_closures
from gtsam_nav.graph.dense import dense_trajectory
from gtsam_nav.graph.doubts import (
    contradictions,
    doubts,
    fixes,
    is_georeferenced,
    missing_loops,
    refused_loops,
    unaided,
    unmeasured_height,
)
from gtsam_nav.graph.exported import pose_graph
from gtsam_nav.graph.factors import X
from gtsam_nav.graph.measurements.edges import keyframe_edges
from gtsam_nav.graph.online import OnlinePass
from gtsam_nav.graph.output import (
    keyframe_trajectory,
    landmark_estimates,
    loop_closures,
    match_rejections,
    slow_states,
    stated_closures,
    thin_scan_rejections,
)
from gtsam_nav.graph.outset import Ready
from gtsam_nav.graph.problem import Problem, SensorFactor
from gtsam_nav.graph.scan_calibration import ScanCalibration
from gtsam_nav.graph.scan_matching import ScanMatch
from gtsam_nav.graph.settling import Settled
from gtsam_nav.graph.weights import robust_weights, weighed, weightless
from gtsam_nav.mission import Mission, Rejection
from gtsam_nav.odometry.cloud_map import map_or_reason
from gtsam_nav.odometry.cloud_track import CloudTrack
from gtsam_nav.series import IntArray
from gtsam_nav.solution import ClockOffset, Solution, SonarMap
from gtsam_nav.sonar.preparation import (
    SonarData,
    registered_scans,
    sonar_map,
)
from gtsam_nav.trajectory import Trajectory


@dataclass(frozen=True)
class EchoData:
    """What sonar and clouds tell; the mission here lacks a sonar that is of no use."""

    mission: Mission
    sonar: SonarData | None
    track: CloudTrack | None
    by_scans: tuple[ScanCalibration, ...]
    rejections: tuple[Rejection, ...]
    warnings: tuple[str, ...]

    @property
    def t_scans(self) -> Array:
        """Middles of the scans, s."""
        return self.sonar.turns.t_ref if self.sonar else np.empty(0)

    @property
    def t_clouds(self) -> Array:
        """Times of the clouds that are keyframes, s."""
        return np.array([cloud.t for cloud in self.track.key] if self.track else [])


@dataclass(frozen=True)
class SolvedGraph:
    """The graph at its solution, and what became of the loops on the way.

    ``graph`` is what ``values`` rest on; ``match_factors`` are those of the ``matches`` that were
    accepted, in their order; ``wants_false`` whether false ones were asked for;
    ``unsure`` why the echoes were not registered jointly; ``constants`` the sensors' constant
    errors, each with its sigma.
    """

    problem: Problem
    scan_keyframe: IntArray
    wants_false: bool
    unsure: tuple[str, ...]
    online: OnlinePass
    matches: list[ScanMatch]
    match_factors: list[SensorFactor]
    cloud_loops: CloudLoops
    graph: Any
    values: Any
    constants: dict[str, tuple[float, float]]
    converged: bool

    @property
    def settled(self) -> Settled:
        """What became of the readings."""
        return self.cloud_loops.settled

    def timed_matches(self, t_scans: Array) -> list[tuple[float, SensorFactor]]:
        """The accepted matches' factors, with the times of their new scans."""
        joined = (m for m in self.matches if m.accepted)
        return [(float(t_scans[m.b]), f) for m, f in zip(joined, self.match_factors, strict=True)]


def solution_of(
    ready: Ready, echoes: EchoData, solved: SolvedGraph, covariances: dict[int, Array]
) -> Solution:
    """What is told of it; ``covariances`` are those of its variables."""
    problem, settled, values = solved.problem, solved.settled, solved.values
    online = solved.online
    robust, mission, t_scans = ready.config.graph.robust, echoes.mission, echoes.t_scans
    scans = echoes.sonar.scans if echoes.sonar else []
    loops = solved.cloud_loops.loops
    stated = list(keyframe_edges(problem.t, mission))
    rows = weighed(problem, solved.timed_matches(t_scans), settled.used, values)
    by_scans = (found.clock for found in echoes.by_scans if found.clock)
    clock_offsets = (*ready.clocks.offsets(solved.constants), *by_scans)
    keyframes = _keyframes(problem.t, values, covariances)
    trajectory = dense_trajectory(problem, values, keyframes, covariances)
    points, map_warnings = _map(echoes.sonar, echoes.track, trajectory, ready.config)
    return Solution(
        method="graph",
        trajectory=trajectory,
        mission=mission,
        georeferenced=is_georeferenced(problem, settled, mission),
        online=keyframe_trajectory(problem.t[online.keyframes], online.states, online.covariances),
        loops=(
            *loop_closures(solved.matches, t_scans, solved.scan_keyframe, values, robust.loops),
            *cloud_loop_closures(loops, problem, values, robust.loops),
            *stated_closures(stated, mission, values, robust.loops),
        ),
        rejections=(
            *mission.rejections,
            *ready.motion.rejections,
            *echoes.rejections,
            *problem.rejections,
            *settled.rejections,
            *weightless(rows),
            *thin_scan_rejections(scans, ready.config.sonar.scans.min_points),
            *match_rejections(solved.matches, t_scans),
        ),
        robust_weights=robust_weights(rows),
        warnings=(
            *_warnings(ready, echoes, solved, clock_offsets),
            *map_warnings,
            *unaided(mission, problem, keyframes),
            *unmeasured_height(keyframes),
            *suspected_constants(mission, problem, settled, values, rows),
            *contradictions(rows),
        ),
        slow_states=slow_states(problem, values, covariances, solved.constants),
        clock_offsets=clock_offsets,
        pose_graph=pose_graph(
            problem, values, solved.matches, solved.scan_keyframe, loops, stated, robust.loops
        ),
        sonar_map=points,
        scans=registered_scans(mission, echoes.sonar) if echoes.sonar else None,
        landmarks=landmark_estimates(problem, values, covariances, set(settled.factors.keys())),
        gnss_used=fixes(problem, settled)[1],
        n_keyframes=len(problem.t),
    )


def _warnings(
    ready: Ready, echoes: EchoData, solved: SolvedGraph, clock_offsets: Iterable[ClockOffset]
) -> Iterator[str]:
    """What the user must hear of how it came about."""
    problem, settled = solved.problem, solved.settled
    yield from echoes.mission.warnings
    yield from problem.warnings
    yield from ready.warnings
    yield from echoes.warnings
    yield from (warning for found in echoes.by_scans for warning in found.warnings)
    yield from solved.cloud_loops.warnings
    yield from solved.unsure
    yield from (warning for offset in clock_offsets for warning in offset.warnings)
    yield from doubts(problem, settled, converged=solved.converged)
    yield from missing_loops(solved.wants_false, solved.matches)
    yield from refused_loops(solved.matches)


def _keyframes(t: Array, values: Any, covariances: dict[int, Array]) -> Trajectory:
    """The keyframes of a solution as a trajectory."""
    keys = [X(k) for k in range(len(t))]
    states = [values.atNavState(key) for key in keys]
    return keyframe_trajectory(t, states, [covariances[key] for key in keys])


def _map(
    sonar: SonarData | None, track: CloudTrack | None, trajectory: Trajectory, config: Config
) -> tuple[SonarMap | None, tuple[str, ...]]:
    """Map of the sonar's echoes, else of the clouds; and why there is none of these."""
    if sonar is not None:
        return sonar_map(sonar.echoes, trajectory), ()
    if track is None:
        return None, ()
    return map_or_reason(track, trajectory, config.open3d.voxel_m)
