"""The causal pass: iSAM2 takes the mission in as it was measured, scan matches included."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from gtsam_nav.config import Config
from gtsam_nav.frames import Array
from gtsam_nav.graph import factors
from gtsam_nav.graph.backend import Backend, planar_pose
from gtsam_nav.graph.factors import X
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
from gtsam_nav.series import IntArray
from gtsam_nav.solution import Progress
from gtsam_nav.sonar.preparation import SonarData
from gtsam_nav.sonar.scans import Scan, planar_rotations

RECENT_SCANS = 6
"""Of a scanner whose scans are taken at once: so many together are what the next one is compared
with."""
RECENT_CELL_M = 0.1
"""One of their points a cell is enough."""


@dataclass
class OnlinePass:
    """Outcome of the causal pass.

    Attributes
    ----------
    backend : Backend
        Holds all factors, scan matches included.
    states, covariances : lists
        Of each keyframe when it entered.
    matches : list of ScanMatch
        Every registration, by scan index.
    """

    backend: Backend
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
    done = OnlinePass(Backend(problem))
    scans, closes_loops = (sonar.scans, not sonar.at_once) if sonar else ([], False)
    poses: list[PlanarPose] = []
    step = config.graph.keyframes_per_update
    for begin in range(0, len(problem.t), step):
        end = min(begin + step, len(problem.t))
        for k in range(begin, end):
            done.backend.add_keyframe(k)
        done.backend.update()
        for k in range(begin, end):
            done.states.append(done.backend.state(k))
            done.covariances.append(done.backend.covariance(k))
        for s in np.flatnonzero((scan_keyframe >= begin) & (scan_keyframe < end)).tolist():
            k = int(scan_keyframe[s])
            poses.append(planar_pose(done.states[k], done.covariances[k]))
            _match_scan(done, s, scans, scan_keyframe, poses, config, closes_loops)
            for fault in faults:
                for false in fault.drawn(s, done.true_loops, ends=s == len(scans) - 1):
                    _take_in(done, false, scan_keyframe, config.graph.robust.loops)
        progress("iSAM2", end / len(problem.t))
    done.backend.update()
    return done


def _match_scan(
    done: OnlinePass,
    new: int,
    scans: list[Scan],
    scan_keyframe: IntArray,
    poses: list[PlanarPose],
    config: Config,
    closes_loops: bool,
) -> None:
    """Register a new scan to the one before and to what it may revisit."""
    settings, robustness = config.graph.loops, config.graph.robust.loops
    if len(scans[new]) < config.sonar.scans.min_points:
        return
    t_scans = np.array([scan.t_ref for scan in scans[: new + 1]])
    chosen = [(new - 1, False)] if new else []
    if closes_loops:
        chosen += [(old, True) for old in loop_candidates(new, poses, t_scans, settings)]
    for old, is_loop in chosen:
        if len(scans[old]) < config.sonar.scans.min_points:
            continue
        a, b = int(scan_keyframe[old]), int(scan_keyframe[new])
        pair = {old: scans[old], new: scans[new]}
        if is_loop:
            here = planar_pose(done.backend.peek(a), np.eye(9))
            prior = relative_pose(here, poses[new], done.backend.joint_planar_covariance(a, b))
        else:
            prior = done.backend.problem.planar_increment(a, b)
            if not closes_loops:
                pair[old] = _recent(done, old, scans, scan_keyframe)
        found = match_scans(old, new, pair, prior, config.pic, robustness.gate_probability, is_loop)
        _take_in(done, found, scan_keyframe, robustness)


def _recent(done: OnlinePass, last: int, scans: list[Scan], scan_keyframe: IntArray) -> Scan:
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
    done: OnlinePass, found: ScanMatch, scan_keyframe: IntArray, robustness: Robustness
) -> None:
    """Record a match; an accepted one becomes a factor."""
    done.matches.append(found)
    if found.accepted:
        done.backend.add_factor(match_factor(found, scan_keyframe, robustness))


def match_factor(found: ScanMatch, scan_keyframe: IntArray, robustness: Robustness) -> SensorFactor:
    """A scan match as a factor between its keyframes."""
    a, b = (X(int(scan_keyframe[s])) for s in (found.a, found.b))
    factor = factors.planar_match(a, b, found.match.q, found.match.cov)
    return SensorFactor(LOOP if found.is_loop else SCAN_MATCH, factor, robustness)
