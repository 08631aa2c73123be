"""Which landmark each sighting is of, where the sensor does not say: decided late.

Sightings that follow each other are tracklets, and each is a landmark of its own to begin with.
As the map grows, landmarks that coincide with older ones within their joint covariance are merged
with them: first those of which that is surely known, then the largest jointly compatible set of
what is left (Neira and Tardos 2001). Each decision waits until the tracklet is complete, and is
made on a map solved anew; what fits nothing stays apart, which does no harm, and is looked at again
when more is known: at last with everything known, where also tracklets that contradict their
landmark are taken out of it, until nothing changes.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.preprocess.planar_map import MapEstimate, PlanarMap
from gtsam_nav.sensors.association import NONE, joint, nearest
from gtsam_nav.sensors.prediction import chi2_limit
from gtsam_nav.sensors.settings import LandmarkSettings
from gtsam_nav.series import BoolArray, IntArray

log = logging.getLogger(__name__)

DECIDE_EVERY = 20
"""Moments between two decisions."""
FRESH_S = 90.0
"""How long a new landmark is compared again with older ones at each decision."""
MOST_CANDIDATES = 8
"""Nearest landmarks that a tracklet is compared with."""
TIGHT = 0.12
"""How uncertain a sure coincidence may be, as a share of the distance between neighbours."""
MOST_JOINT = 6
"""Tracklets that are compared jointly."""
MOST_ROUNDS = 30


@dataclass(frozen=True)
class Coincidences:
    """Do s landmarks coincide with k others? `sensors.association.Compared`.

    Attributes
    ----------
    p : ndarray, shape (n, 2)
        All of them.
    cov : ndarray, shape (n, 2, n, 2)
        Their joint covariance.
    fresh, old : ndarray of int, shapes (s,) and (k,)
        Which of the n are compared.
    possible : ndarray of bool, shape (s, k)
        False where they cannot be the same: both were seen apart at one moment.
    """

    p: Array
    cov: Array
    fresh: IntArray
    old: IntArray
    possible: BoolArray

    @property
    def m(self) -> int:
        """Values of a comparison."""
        return 2

    def difference_cov(self, a: IntArray, b: IntArray) -> Array:
        """Joint covariance (n, 2, n, 2) of the differences of pairs."""
        C = self.cov
        return C[a][:, :, a] + C[b][:, :, b] - C[a][:, :, b] - C[b][:, :, a]

    @cached_property
    def nis(self) -> Array:
        """Squared normalised distance of each pair, shape (s, k)."""
        nis = np.full(self.possible.shape, np.inf)
        for i, j in np.argwhere(self.possible).tolist():
            nis[i, j] = self.joint_nis([i], [j])
        return nis

    def joint_nis(self, sightings: list[int], landmarks: list[int]) -> float:
        """Squared normalised distance of several pairs together."""
        a, b = self.fresh[sightings], self.old[landmarks]
        n = 2 * len(a)
        S = self.difference_cov(a, b).reshape(n, n)
        off = (self.p[a] - self.p[b]).ravel()
        try:
            L = np.linalg.cholesky(S + 1e-9 * np.eye(n))
        except np.linalg.LinAlgError:
            return np.inf
        return float(np.sum(np.linalg.solve(L, off) ** 2))

    def spread(self, i: int, j: int) -> float:
        """Largest sigma of one pair's difference, m."""
        S = self.difference_cov(self.fresh[[i]], self.old[[j]]).reshape(2, 2)
        return float(np.sqrt(np.linalg.eigvalsh(S)[-1]))

    def pairs(self, settings: LandmarkSettings) -> list[tuple[int, int]]:
        """Which coincide: the largest jointly compatible set, or each with its nearest."""
        match = joint if settings.association == "joint" else nearest
        found = match(self, settings.gate_probability)
        return [(s, int(k)) for s, k in enumerate(found) if k != NONE]


class Identities:
    """Decides for the sightings of a mission.

    Parameters
    ----------
    planar_map : PlanarMap
        With these sightings.
    t : ndarray, shape (m,)
        Times of its poses.
    tracklet : ndarray of int, shape (k,)
        Of each sighting.
    resolution : float
        Landmarks that are nearer to each other the sensor does not tell apart, m.
    settings : LandmarkSettings
    """

    def __init__(
        self,
        planar_map: PlanarMap,
        t: Array,
        tracklet: IntArray,
        resolution: float,
        settings: LandmarkSettings,
    ) -> None:
        self.map, self.t, self.tracklet, self.settings = planar_map, t, tracklet, settings
        self.pose = planar_map.seen.pose
        n = int(np.max(tracklet, initial=-1)) + 1
        self.landmark = np.arange(n)
        """Landmark of each tracklet, named by its first one."""
        order = np.argsort(tracklet, kind="stable")
        bounds = np.searchsorted(tracklet[order], np.arange(n + 1))
        poses = [self.pose[order[a:b]] for a, b in pairwise(bounds)]
        self.first = np.array([p[0] for p in poses], dtype=np.int64)
        self.last = np.array([p[-1] for p in poses], dtype=np.int64)
        self.resolution = resolution
        self.distinct = self._seen_apart()

    def _seen_apart(self) -> BoolArray:
        """Which tracklets, (n, n), were seen at one moment and told apart there."""
        distinct = np.zeros((len(self.landmark), len(self.landmark)), dtype=bool)
        p_b = self.map.seen.p_b
        for after in range(1, len(self.pose)):
            a = np.arange(len(self.pose) - after)
            a = a[self.pose[a] == self.pose[a + after]]
            if not len(a):
                break
            far = np.linalg.norm(p_b[a] - p_b[a + after], axis=1) > self.resolution
            i, j = self.tracklet[a[far]], self.tracklet[a[far] + after]
            distinct[i, j] = distinct[j, i] = True
        return distinct

    def run(self) -> IntArray:
        """Number of the landmark of each sighting, shape (k,); NONE of what was seen once."""
        n_poses = len(self.t)
        for now in range(DECIDE_EVERY, n_poses, DECIDE_EVERY):
            closed = (self.last < now) & (self.t[self.first] > self.t[now - 1] - FRESH_S)
            if np.any(closed):
                self._decide(closed, now)
        everything = np.ones(len(self.landmark), dtype=bool)
        for _ in range(MOST_ROUNDS):
            self._decide(everything, n_poses)
            if not self._part(self._solved(n_poses)[0]):
                break
        return self._numbered()

    def _is_single(self) -> BoolArray:
        count = np.bincount(self.landmark, minlength=len(self.landmark))
        return np.asarray(count[self.landmark] == 1)

    def _solved(self, n_poses: int, *, merged: bool = False) -> tuple[MapEstimate, IntArray]:
        """The map of the first poses, and the names of its landmarks."""
        k = int(np.searchsorted(self.pose, n_poses))
        names, of = np.unique(self.landmark[self.tracklet[:k]], return_inverse=True)
        return self.map.solve(of, n_poses, merged=merged), names

    def _decide(self, candidates: BoolArray, now: int) -> None:
        """Merge landmarks that began with one of some tracklets, as far as that is clear: first
        those that lie where others surely are."""
        tight, merged = True, False
        while True:
            estimate, names = self._solved(now, merged=merged)
            own = names[candidates[names]]
            groups = np.array_split(own, int(np.ceil(len(own) / MOST_JOINT))) if len(own) else []
            verdicts = [self._merge(estimate, names, group, tight) for group in groups]
            merged = any(verdicts)
            if merged:
                tight = True
            elif tight:
                tight = False
            else:
                return

    def _merge(self, estimate: MapEstimate, names: IntArray, fresh: IntArray, tight: bool) -> bool:
        row = np.searchsorted(names, fresh)
        distance = np.linalg.norm(estimate.landmarks[row][:, None] - estimate.landmarks, axis=2)
        near = np.argsort(distance, axis=1, kind="stable")[:, 1 : MOST_CANDIDATES + 1]
        old = np.unique(near)
        possible = np.zeros((len(fresh), len(old)), dtype=bool)
        for i, own in enumerate(fresh.tolist()):
            for j in np.flatnonzero(np.isin(old, near[i])):
                possible[i, j] = names[old[j]] < own and self._may_be_one(own, int(names[old[j]]))
        if not np.any(possible):
            return False
        rows = np.union1d(row, old)
        cov = estimate.landmark_cov(rows).reshape(len(rows), 2, len(rows), 2)
        compared = Coincidences(
            estimate.landmarks[rows],
            cov,
            np.searchsorted(rows, row),
            np.searchsorted(rows, old),
            possible,
        )
        if tight:
            spacing = _spacing(estimate.landmarks, self._landmarks_seen_apart(names))[old]
            for s, k in np.argwhere(possible).tolist():
                possible[s, k] = compared.spread(s, k) <= TIGHT * spacing[k]
        pairs = compared.pairs(self.settings)
        for s, k in pairs:
            self._join(int(fresh[s]), int(names[old[k]]))
        return bool(pairs)

    def _join(self, a: int, b: int) -> None:
        older, younger = sorted(self.landmark[[a, b]].tolist())
        if older != younger and self._may_be_one(older, younger):
            self.landmark[self.landmark == younger] = older

    def _members(self, name: int) -> list[int]:
        return np.flatnonzero(self.landmark == name).tolist()

    def _may_be_one(self, a: int, b: int) -> bool:
        """Whether no tracklets of two landmarks were seen apart, or parted before."""
        return not np.any(self.distinct[np.ix_(self._members(a), self._members(b))])

    def _landmarks_seen_apart(self, names: IntArray) -> BoolArray:
        """Which of the named landmarks, (n, n), hold tracklets that were seen apart."""
        of = np.searchsorted(names, self.landmark)
        known = np.isin(self.landmark, names)
        apart = np.zeros((len(names), len(names)), dtype=bool)
        i, j = np.nonzero(self.distinct & known[:, None] & known)
        apart[of[i], of[j]] = True
        return apart

    def _part(self, estimate: MapEstimate) -> bool:
        """Take tracklets out of landmarks that their sightings contradict."""
        limit = chi2_limit(self.settings.gate_probability, 2)
        count = np.bincount(self.tracklet)
        off = np.bincount(self.tracklet, estimate.squared) / count > limit
        parted = False
        for i in np.flatnonzero(off & ~self._is_single()).tolist():
            rest = [j for j in self._members(int(self.landmark[i])) if j != i]
            if not rest:
                continue
            self.distinct[i, rest] = self.distinct[rest, i] = True
            self.landmark[rest] = min(rest)
            self.landmark[i] = i
            parted = True
        return parted

    def _numbered(self) -> IntArray:
        """Landmarks in the order of discovery, without those that were seen once."""
        landmark = self.landmark[self.tracklet]
        names, first, of, count = np.unique(
            landmark, return_index=True, return_inverse=True, return_counts=True
        )
        number = np.full(len(names), NONE)
        kept = np.flatnonzero(count > 1)
        number[kept[np.argsort(first[kept], kind="stable")]] = np.arange(len(kept))
        return np.asarray(number[of])


def _spacing(p: Array, distinct: BoolArray) -> Array:
    """Distance from each landmark to the nearest that is certainly another, but not below the usual
    one."""
    distance = np.linalg.norm(p[:, None] - p, axis=2)
    distance[~distinct] = np.inf
    nearest_m = np.min(distance, axis=1)
    known = np.isfinite(nearest_m)
    usual = float(np.median(nearest_m[known])) if np.any(known) else np.inf
    return np.where(known, np.maximum(nearest_m, usual), usual)
