"""False loop closures among the true: what a registration to the wrong place would bring.

They come as accepted registrations do, with the covariance and overlap of a true one, and pass
for true in all that follows but the record. A false closure joins scans that have nothing to do
with each other, as near as a registration looks; its turn is that of the vehicle's own motion but
for as much as a registration may correct. A group takes a passage for another: its closures agree
with each other and with the motion along both.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass, replace

import numpy as np

from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.graph.problem import Problem
from gtsam_nav.graph.scan_matching import ScanMatch, between, compounded
from gtsam_nav.graph.settings import LoopSettings
from gtsam_nav.registration.prior import PRIOR_CAP
from gtsam_nav.series import IntArray
from gtsam_nav.simulation.fault_specs import parse_fault
from gtsam_nav.simulation.faults import FalseLoops


@dataclass
class LoopFault:
    """One fault's closures, drawn while the true ones come in so that its share is kept.

    Attributes
    ----------
    fault : FalseLoops
    t_scans, poses : ndarray, shapes (n,) and (n, 3)
        Times of the scans, and north, east and yaw there by the vehicle's own motion.
    settings : LoopSettings
    rng : numpy.random.Generator
    """

    fault: FalseLoops
    t_scans: Array
    poses: Array
    settings: LoopSettings
    rng: np.random.Generator
    _drawn: int = 0

    def drawn(self, new: int, true: list[ScanMatch], ends: bool = False) -> list[ScanMatch]:
        """False closures that are due at a scan, whole groups of them.

        Parameters
        ----------
        new : int
            The scan.
        true : list of ScanMatch
            All true closures so far that were accepted.
        ends : bool
            Whether no other scan follows: then the last group may be smaller.
        """
        due = round(len(true) * self.fault.share / (1.0 - self.fault.share)) - self._drawn
        false: list[ScanMatch] = []
        while due >= self.fault.group or (ends and due > 0):
            group = self._group(new, min(due, self.fault.group), true)
            if not group:
                break
            false += group
            due -= len(group)
        self._drawn += len(false)
        return false

    def _group(self, new: int, size: int, true: list[ScanMatch]) -> list[ScanMatch]:
        """Closures of the last scans with as many earlier ones; none where these are too few."""
        oldest = new - size + 1
        latest_s = self.t_scans[max(oldest, 0)] - self.settings.min_separation_s
        earlier = np.flatnonzero(self.t_scans[:new] <= latest_s)[size - 1 :]
        if oldest < 0 or not len(earlier):
            return []
        first = int(self.rng.choice(earlier))
        q_first = self._wrong_pose(first, new)
        closures = []
        for j in range(size):
            a, b = first - j, new - j
            like = true[int(self.rng.integers(len(true)))].match
            # b in a, by way of the first pair and the motion on either side
            q = compounded(
                between(self.poses[a], self.poses[first])[0],
                compounded(q_first, between(self.poses[new], self.poses[b])[0]),
            )
            q = q + self.rng.multivariate_normal(np.zeros(3), like.cov)
            q[2] = wrap_angle(q[2])
            match = replace(like, q=q)
            closures.append(ScanMatch(a, b, match, reason="", is_loop=True, is_injected=True))
        return closures

    def _wrong_pose(self, a: int, b: int) -> Array:
        """Somewhere within the search radius, turned as far as a registration may be."""
        distance = self.settings.radius_m * np.sqrt(self.rng.uniform())
        bearing, turn = self.rng.uniform(-np.pi, np.pi), self.rng.uniform(-1.0, 1.0)
        yaw = self.poses[b, 2] - self.poses[a, 2] + turn * PRIOR_CAP[2]
        return np.array([distance * np.cos(bearing), distance * np.sin(bearing), yaw])


def loop_faults(
    faults: tuple[str, ...],
    seed: int,
    problem: Problem,
    scan_keyframe: IntArray,
    settings: LoopSettings,
) -> list[LoopFault]:
    """Those of a mission's faults that are the graph's own."""
    keyframes = np.asarray(scan_keyframe)
    poses = np.column_stack([problem.p_n[keyframes, :2], problem.rpy[keyframes, 2]])
    own = [fault for fault in map(parse_fault, faults) if isinstance(fault, FalseLoops)]
    return [
        LoopFault(
            fault,
            problem.t[keyframes],
            poses,
            settings,
            np.random.default_rng([seed, zlib.crc32(str(fault).encode())]),
        )
        for fault in own
    ]
