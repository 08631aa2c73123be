"""The causal pass: iSAM2 takes the mission in as it was measured, scan matches included."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import gtsam
import numpy as np
from scipy.linalg import block_diag

from gtsam_nav.config import Config
from gtsam_nav.frames import Array
from gtsam_nav.graph import factors
from gtsam_nav.graph.backend import Backend, at_first, graph_of, planar_pose
from gtsam_nav.graph.factors import B, X
from gtsam_nav.graph.false_loops import LoopFault
from gtsam_nav.graph.problem import Problem, SensorFactor
from gtsam_nav.graph.robust import Robustness
from gtsam_nav.graph.scan_matching import (
    LOOP,
    SCAN_MATCH,
    PlanarPose,
    ScanMatch,
    between,
    loop_candidates,
    match_scans,
    relative_pose,
)
from gtsam_nav.registration.prior import PRIOR_FLOOR
from gtsam_nav.series import IntArray
from gtsam_nav.solution import Progress
from gtsam_nav.sonar.preparation import SonarData
from gtsam_nav.sonar.scans import Scan, planar_rotations

MOST_UPDATES = 1000
"""Of iSAM2: each takes time in proportion to the mission so far, since what all of it shares, such
as the compass's constant bias, changes with each."""
MOST_STATED_UPDATES = 100
"""Where the mission is a pose graph: its closures make each update costly, and none is found on the
way."""
RECENT_SCANS = 6
"""Of a scanner whose scans are taken at once: so many together are what the next one is compared
with."""
RECENT_CELL_M = 0.1
"""One of their points a cell is enough."""


@dataclass(frozen=True)
class OnlinePass:
    """Outcome of the causal pass.

    Attributes
    ----------
    values : gtsam.Values
        Of everything, as iSAM2 knew it in the end.
    keyframes : list of int
        All; of a pose graph those that came last in their update, which alone knew nothing later.
    states, covariances : lists
        Of each of these when it entered.
    matches : list of ScanMatch
        Every registration, by scan index.
    """

    values: Any
    keyframes: list[int]
    states: list[Any]
    covariances: list[Array]
    matches: list[ScanMatch]


@dataclass
class _Running:
    """The pass under way; iSAM2's memory goes with it."""

    backend: Backend
    keyframes: list[int] = field(default_factory=list)
    states: list[Any] = field(default_factory=list)
    covariances: list[Array] = field(default_factory=list)
    matches: list[ScanMatch] = field(default_factory=list)

    @property
    def true_loops(self) -> list[ScanMatch]:
        """Closures that were registered and accepted."""
        return [m for m in self.matches if m.is_loop and m.accepted and not m.is_injected]


def run_online(
    problem: Problem,
    sonar: SonarData | None,
    scan_keyframe: IntArray,
    config: Config,
    progress: Progress,
    faults: Sequence[LoopFault] = (),
) -> OnlinePass:
    """Feed the keyframes to iSAM2, several at a time, and match the scans as they come.

    Parameters
    ----------
    sonar : SonarData or None
        The loops of scans that are taken at once are left for later (`submap_loops`).
    scan_keyframe : ndarray of int
        Keyframe of each scan.
    faults : sequence of LoopFault
        False closures that come among the true ones.
    """
    done = _Running(Backend(problem))
    scans, closes_loops = (sonar.scans, not sonar.at_once) if sonar else ([], False)
    poses: list[PlanarPose] = []
    is_stated = problem.is_pose_graph and sonar is None
    most = _most_updates(problem, sonar)
    step = max(config.graph.keyframes_per_update, -(-len(problem.t) // most))
    for begin in range(0, len(problem.t), step):
        end = min(begin + step, len(problem.t))
        for k in range(begin, end):
            done.backend.add_keyframe(k)
        done.backend.update()
        for k in range(end - 1 if is_stated else begin, end):
            done.keyframes.append(k)
            state, covariance = done.backend.latest(k)
            done.states.append(state)
            done.covariances.append(covariance)
        for s in np.flatnonzero((scan_keyframe >= begin) & (scan_keyframe < end)).tolist():
            k = int(scan_keyframe[s])
            poses.append(planar_pose(done.states[k], done.covariances[k]))
            _match_scan(done, s, scans, scan_keyframe, poses, config, closes_loops)
            for fault in faults:
                for false in fault.drawn(s, done.true_loops, ends=s == len(scans) - 1):
                    _take_in(done, false, scan_keyframe, config.graph.robust.loops)
        progress("iSAM2", end / len(problem.t))
    done.backend.update()
    values = done.backend.values()
    if problem.exact or not (problem.uses_imu or problem.has_compass):
        values = _nearer_start(problem, values)
    elif problem.by_ranges:  # the causal pass knows no side of the beacons
        values = _as_guessed(problem, values)
    return OnlinePass(values, done.keyframes, done.states, done.covariances, done.matches)


def _most_updates(problem: Problem, sonar: SonarData | None) -> int:
    """As few as the graph allows; one where a pose comes before all that it is joined to."""
    if not problem.is_pose_graph or sonar is not None:
        return MOST_UPDATES
    grows = all(_is_tied(problem, k) for k in range(1, len(problem.t)))
    return MOST_STATED_UPDATES if grows else 1


def _is_tied(problem: Problem, k: int) -> bool:
    """Whether anything ties a keyframe to an earlier one."""
    tied = [entry.gaussian.keys() for entry in problem.factors[k]]
    earlier = any(X(0) <= key < X(k) for keys in tied for key in keys)
    return problem.steps[k] is not None or earlier


def _nearer_start(problem: Problem, values: Any) -> Any:
    """The causal estimate, or the first guess of the motion where that costs less: where loops come
    late, or nothing tells the turns, the causal pass may have been led astray."""
    return min((values, _as_guessed(problem, values)), key=lambda start: _cost(problem, start))


def _as_guessed(problem: Problem, values: Any) -> Any:
    """The first guess of the motion, with the causal estimate's biases."""
    as_guessed = gtsam.Values(values)
    for k in range(len(problem.t)):
        as_guessed.update(X(k), nav_state=problem.initial_state(k))
        for key, first in problem.variables[k]:
            if key != B(k):
                as_guessed.update(key, nav_state=first(as_guessed.atNavState))
    return as_guessed


def _cost(problem: Problem, values: Any) -> float:
    """Of all factors, and of the readings under the kernels that they have at first."""
    graph = graph_of(problem.entries)
    graph.push_back(at_first(problem.all_readings, values.atNavState))
    return float(graph.error(values))


def _match_scan(
    done: _Running,
    new: int,
    scans: list[Scan],
    scan_keyframe: IntArray,
    poses: list[PlanarPose],
    config: Config,
    closes_loops: bool,
) -> None:
    """Register a new scan to the one before and to what it may revisit."""
    robustness, least = config.graph.robust.loops, config.sonar.scans.min_points
    if len(scans[new]) < least:
        return
    tried: list[tuple[Scan, int, PlanarPose, bool]] = []
    if new and len(scans[new - 1]) >= least:
        a, b = (int(k) for k in scan_keyframe[new - 1 : new + 1])
        reference = scans[new - 1] if closes_loops else _recent(done, new - 1, scans, scan_keyframe)
        tried.append((reference, new - 1, done.backend.problem.planar_increment(a, b), False))
    if closes_loops and _searches(new, len(scans), config.graph.loops.max_searches):
        t_scans = np.array([scan.t_ref for scan in scans[: new + 1]])
        candidates = loop_candidates(new, poses, t_scans, config.graph.loops)
        candidates = [old for old in candidates if len(scans[old]) >= least]
        priors = _relative_poses(done.backend, candidates, new, scan_keyframe, poses)
        tried += [(scans[old], old, q, True) for old, q in zip(candidates, priors, strict=True)]
    for reference, old, prior, is_loop in tried:
        pair = {old: reference, new: scans[new]}
        found = match_scans(old, new, pair, prior, config.pic, robustness.gate_probability, is_loop)
        _take_in(done, found, scan_keyframe, robustness)


def _searches(new: int, n_scans: int, most: int) -> bool:
    """Whether a scan is one of so many at even intervals."""
    return new * most // n_scans > (new - 1) * most // n_scans


def _relative_poses(
    backend: Backend, earlier: list[int], new: int, scan_keyframe: IntArray, poses: list[PlanarPose]
) -> list[PlanarPose]:
    """Estimated poses of a new scan in earlier ones.

    What their errors share narrows the search, but never below what a registration looks around
    itself anyway: where they are known so well apart, it is not asked for. It costs in proportion
    to the mission's length.
    """
    if not earlier:
        return []
    keyframes = [int(scan_keyframe[old]) for old in earlier]
    apart = [block_diag(poses[old].cov, poses[new].cov) for old in earlier]
    unshared = [
        relative_pose(planar_pose(backend.peek(a), np.eye(9)), poses[new], cov)
        for a, cov in zip(keyframes, apart, strict=True)
    ]
    if all(np.all(np.diagonal(q.cov) <= PRIOR_FLOOR**2) for q in unshared):
        return unshared
    joint = backend.joint_planar_covariances(keyframes, int(scan_keyframe[new]))
    return [
        relative_pose(planar_pose(backend.peek(a), np.eye(9)), poses[new], cov)
        for a, cov in zip(keyframes, joint, strict=True)
    ]


def _recent(done: _Running, last: int, scans: list[Scan], scan_keyframe: IntArray) -> Scan:
    """The last scan with those before it, in its own frame: more than a scan sees of a place."""
    members = range(last, max(last - RECENT_SCANS, -1), -1)
    states = [done.backend.peek(int(scan_keyframe[s])) for s in members]
    poses = np.array([[*state.position()[:2], state.attitude().yaw()] for state in states])
    xy, cov = [], []
    for s, pose in zip(members, poses, strict=True):
        q = between(poses[0], pose)[0]
        B = planar_rotations(q[2])
        xy.append(q[:2] + scans[s].xy @ B.T)
        cov.append(B @ scans[s].cov @ B.T)
    points = np.concatenate(xy)
    _, first = np.unique(np.floor(points / RECENT_CELL_M), axis=0, return_index=True)
    return Scan(scans[last].t_ref, points[first], np.concatenate(cov)[first])


def _take_in(
    done: _Running, found: ScanMatch, scan_keyframe: IntArray, robustness: Robustness
) -> None:
    """Record a match; an accepted one becomes a factor."""
    done.matches.append(found)
    if found.accepted:
        done.backend.add_factor(match_factor(found, scan_keyframe, robustness))


def match_factor(found: ScanMatch, scan_keyframe: IntArray, robustness: Robustness) -> SensorFactor:
    """A scan match as a factor between its keyframes."""
    a, b = (X(int(scan_keyframe[s])) for s in (found.a, found.b))
    factor = factors.planar_match(a, b, found.match.q, found.match.cov)
    return SensorFactor(LOOP if found.is_loop else SCAN_MATCH, factor, robustness, found.b)
