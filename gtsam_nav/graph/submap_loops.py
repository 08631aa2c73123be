"""Loops of a scanner whose scans are taken at once: where two submaps show the same place.

A single scan of a laser sees little, and half of it behind a robot that comes back the other way;
the scans of a stretch, put together by the estimate, see the place whole. The poses that the
estimate allows are all tried (``registration.correlative``), and pIC settles the best. What is
accepted sharpens the estimate, so that the search goes on where it was too vague before.
"""

from __future__ import annotations

import logging
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gtsam_nav.config import Config
from gtsam_nav.frames import Array
from gtsam_nav.graph.backend import Covariances, graph_of, planar_rows
from gtsam_nav.graph.factors import X
from gtsam_nav.graph.loop_judging import judged
from gtsam_nav.graph.online import match_factor
from gtsam_nav.graph.problem import Problem, SensorFactor
from gtsam_nav.graph.readings import Reading
from gtsam_nav.graph.scan_matching import PlanarPose, ScanMatch, between, relative_pose
from gtsam_nav.graph.settings import SubmapLoopSettings
from gtsam_nav.graph.settling import Settled, settle
from gtsam_nav.registration.correlative import search, thinned
from gtsam_nav.registration.pic import register
from gtsam_nav.registration.result import PlanarMatch
from gtsam_nav.sensors.prediction import chi2_limit
from gtsam_nav.series import IntArray
from gtsam_nav.solution import Progress
from gtsam_nav.sonar.scans import Scan, planar_rotations

log = logging.getLogger(__name__)

MAX_ROUNDS = 6
SURE_SIGMAS = 2.0
DOUBT = 2.0
"""On the estimate's standard deviations: matches of scans that follow each other share errors, so
that it is surer of itself than it should be. What is found is judged among all (`judged`)."""


@dataclass(frozen=True)
class ScanLoops:
    """All matches, their factors, and the estimate that rests on them."""

    matches: list[ScanMatch]
    factors: list[SensorFactor]
    settled: Settled


def close_submap_loops(
    problem: Problem,
    scans: list[Scan],
    scan_keyframe: IntArray,
    consecutive: Sequence[ScanMatch],
    values: Any,
    config: Config,
    progress: Progress,
) -> ScanLoops:
    """Find loops between submaps until there are no more, and settle the estimate with them.

    Parameters
    ----------
    scan_keyframe : ndarray of int
        Keyframe of each scan.
    consecutive : sequence of ScanMatch
        Those of scans that follow each other.
    values : gtsam.Values
        Start.
    """
    open_loop = done = with_matches(problem, list(consecutive), scan_keyframe, values, config)
    for n in range(MAX_ROUNDS):
        track = _Track(problem, scans, scan_keyframe, done, config)
        known = {(m.a, m.b): m for m in done.matches if m.is_loop and m.accepted}
        pairs = track.candidates()
        found = []
        for i, (a, b) in enumerate(pairs):
            found.append(known.pop((a, b)) if (a, b) in known else track.matched(a, b))
            progress("loops", (n + i / len(pairs)) / MAX_ROUNDS)
        matches = [*consecutive, *known.values(), *found]
        matches, _ = judged(matches, problem, open_loop.settled.values, scan_keyframe, config)
        before = {(m.a, m.b) for m in done.matches if m.accepted}
        done = with_matches(problem, matches, scan_keyframe, done.settled.values, config)
        now = {(m.a, m.b) for m in matches if m.accepted}
        log.info("loops, round %d: %d of %d believed", n + 1, len(now - before), len(pairs))
        if now <= before:
            break
    progress("loops", 1.0)
    return done


def with_matches(
    problem: Problem,
    matches: list[ScanMatch],
    scan_keyframe: IntArray,
    values: Any,
    config: Config,
    believed: Collection[Reading] | None = None,
) -> ScanLoops:
    """Settle the estimate with those of some matches that are accepted.

    The readings that are believed, if that is known, spare the robust start.
    """
    joined = [
        match_factor(m, scan_keyframe, config.graph.robust.loops) for m in matches if m.accepted
    ]
    settled = settle(problem, [*problem.entries, *joined], values, believed)
    return ScanLoops(matches, joined, settled)


class _Track:
    """The scans where the present estimate puts them, and how sure it is."""

    def __init__(
        self,
        problem: Problem,
        scans: list[Scan],
        scan_keyframe: IntArray,
        done: ScanLoops,
        config: Config,
    ) -> None:
        values = done.settled.values
        whole = graph_of([*problem.entries, *done.factors])
        whole.push_back(done.settled.factors)
        self._covariances = Covariances(whole, values, problem.is_stiff)
        self._states = [values.atNavState(X(int(k))) for k in scan_keyframe]
        self._keyframe, self._scans, self._config = scan_keyframe, scans, config
        self._settings: SubmapLoopSettings = config.graph.submap_loops
        self.t = np.array([scan.t_ref for scan in scans])
        self.poses = np.array(
            [[*state.position()[:2], state.attitude().yaw()] for state in self._states]
        )
        steps = np.linalg.norm(np.diff(self.poses[:, :2], axis=0), axis=1)
        self.along = np.concatenate([[0.0], np.cumsum(steps)])
        self._submaps: dict[int, Array] = {}

    def candidates(self) -> list[tuple[int, int]]:
        """Pairs of scans in the middle of submaps, the earlier first, that may be of one place."""
        s = self._settings
        _, middles = np.unique(np.floor(self.along / s.spacing_m), return_index=True)
        spread = np.sqrt([np.trace(self._cov([k])[:2, :2]) for k in middles.tolist()])
        chosen = []
        for n, new in enumerate(middles.tolist()):
            old = middles[:n]
            distance = np.linalg.norm(self.poses[old, :2] - self.poses[new, :2], axis=1)
            allowed = s.radius_m + SURE_SIGMAS * np.hypot(spread[:n], spread[n])
            near = (distance <= allowed) & (self.along[new] - self.along[old] > 2 * s.reach_m)
            passages: list[int] = []
            for k in old[near][np.argsort(distance[near], kind="stable")].tolist():
                if all(abs(self.along[k] - self.along[p]) > s.reach_m for p in passages):
                    passages.append(k)
            chosen += [(k, new) for k in passages[: s.max_candidates]]
        return chosen

    def matched(self, a: int, b: int) -> ScanMatch:
        """Register the submap around scan b to that around scan a, and judge the result."""
        prior = self._prior(a, b)
        q_prior = np.array([*prior.ne, prior.yaw])
        settings, gate = self._config.correlative, self._config.graph.robust.loops.gate_probability
        reference, new = self._submap(a), self._submap(b)
        least = self._config.sonar.scans.min_points
        if min(len(reference), len(new)) < least:
            match = PlanarMatch(q_prior, prior.cov, 0.0, 0, f"fewer than {least} points")
            return ScanMatch(a, b, match, match.failure, is_loop=True)
        found = search(reference, new, q_prior, prior.cov, settings)
        if found.failure:
            match = PlanarMatch(found.q, prior.cov, found.score, 1, found.failure)
            return ScanMatch(a, b, match, found.failure, is_loop=True)
        near = np.diag([settings.cell_m, settings.cell_m, np.radians(2.0)]) ** 2
        match = register(
            _as_scan(reference, settings.cell_m),
            _as_scan(new, settings.cell_m),
            found.q,
            near,
            self._config.pic,
        )
        reason, residual = match.failure, None
        if match.ok and gate is not None:
            off = between(q_prior, match.q)[0]
            d2 = float(off @ np.linalg.solve(prior.cov + match.cov, off))
            if d2 > chi2_limit(gate, 3):
                reason, residual = f"contradicts the estimate (chi2 {d2:.1f})", float(np.sqrt(d2))
        return ScanMatch(a, b, replace(match, overlap=found.score), reason, True, residual)

    def _submap(self, middle: int) -> Array:
        """Points of the scans around one, in its own frame, one a cell; shape (k, 2)."""
        if middle not in self._submaps:
            off = np.abs(self.along - self.along[middle])
            parts = []
            for k in np.flatnonzero(off <= self._settings.reach_m).tolist():
                q = between(self.poses[middle], self.poses[k])[0]
                parts.append(q[:2] + self._scans[k].xy @ planar_rotations(q[2]).T)
            points = np.concatenate(parts)
            self._submaps[middle] = thinned(points, self._config.correlative.cell_m)
        return self._submaps[middle]

    def _prior(self, a: int, b: int) -> PlanarPose:
        """Scan b in scan a by the estimate."""
        cov = DOUBT**2 * self._cov([a, b])
        here, there = (PlanarPose(self.poses[k, :2], self.poses[k, 2], np.eye(3)) for k in (a, b))
        return relative_pose(here, there, cov)

    def _cov(self, scans: list[int]) -> Array:
        """Joint covariance of north, east and yaw of some scans."""
        from scipy.linalg import block_diag

        rows = block_diag(*(planar_rows(self._states[k].attitude().matrix()) for k in scans))
        joint = self._covariances.joint([X(int(self._keyframe[k])) for k in scans])
        return np.asarray(rows @ joint @ rows.T)


def _as_scan(xy: Array, cell_m: float) -> Scan:
    """Points of a submap with the spread of what lies in a cell."""
    return Scan(0.0, xy, np.tile((0.5 * cell_m) ** 2 * np.eye(2), (len(xy), 1, 1)))
