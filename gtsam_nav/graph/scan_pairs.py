"""Which scans the refinement compares, and where each pair's information goes."""

from __future__ import annotations

from typing import Any, NamedTuple

import numba
import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.graph._echo_equations import accumulate, own_by_interval
from gtsam_nav.series import BoolArray, IntArray


class PlacedEchoes(NamedTuple):
    """Echoes in n, (k, 2), their arms from their two knots, (k, 2, 2), their covariances, and the
    fraction of the interval between the knots."""

    xy: Array
    arms: Array
    cov: Array
    fraction: Array


def nearby_scans(ne: Array, sizes: IntArray, radius_m: float, most: int) -> IntArray:
    """Pairs of scans that were taken near each other, shape (p, 2), the earlier one first.

    They are in the order of the places where they lie: those at one place share their echoes, which
    a processor's cache holds while it goes through them.

    Where a mission sees a place more often, a scan is compared with the nearest one of each
    passage, then with the second nearest, until it has enough: what all of them know together
    grows with their number, not with that of their pairs.

    Parameters
    ----------
    ne : ndarray, shape (n, 2)
        Where each scan was taken.
    sizes : ndarray of int, shape (n,)
        Number of their echoes; scans without any are left out.
    most : int
        Scans that each one chooses.
    """
    from scipy.spatial import cKDTree

    tree = cKDTree(ne)
    near = tree.query_pairs(radius_m, output_type="ndarray").astype(np.int64)
    near = near[np.all(sizes[near] > 0, axis=1)]
    scan, other = np.concatenate([near, near[:, ::-1]]).T
    order = np.lexsort((other, scan))
    scan, other = scan[order], other[order]
    distance = np.linalg.norm(ne[other] - ne[scan], axis=1)
    starts = np.diff(scan, prepend=-1) != 0
    passage = np.cumsum(starts | (np.diff(other, prepend=-1) != 1))
    rank = _rank_within(passage, distance)
    chosen = _rank_within(scan, rank + distance / (1.0 + radius_m)) < most
    pairs = np.unique(np.sort(np.column_stack([scan, other])[chosen], axis=1), axis=0)
    leaf = np.argsort(tree.indices)
    return pairs[np.lexsort(leaf[pairs].T[::-1])]


def _rank_within(group: IntArray, value: Array) -> IntArray:
    """Place of each value among those of its group; groups follow each other, in order."""
    order = np.lexsort((value, group))
    first = np.searchsorted(group, group)
    rank = np.empty(len(group), dtype=np.int64)
    rank[order] = np.arange(len(group)) - first[order]
    return rank


class ScanPairs:
    """Pairs of scans, and the blocks of information on knots that their echoes can touch.

    Parameters
    ----------
    scans : ndarray of int, shape (p, 2)
        The earlier scan first.
    knot : ndarray of int, shape (k,)
        Knot before each echo.
    scan_first : ndarray of int
        Where each scan's echoes begin.
    n_knots : int
    """

    def __init__(self, scans: IntArray, knot: IntArray, scan_first: IntArray, n_knots: int) -> None:
        self.scans = scans
        self._knot, self._n_knots = knot, n_knots
        occupied = np.diff(scan_first) > 0
        low, count = np.zeros(len(occupied), np.int64), np.zeros(len(occupied), np.int64)
        low[occupied] = knot[scan_first[:-1][occupied]]
        count[occupied] = knot[scan_first[1:][occupied] - 1] - low[occupied] + 1
        (low_a, low_b), (count_a, count_b) = low[scans.T], count[scans.T]
        ends = np.cumsum(count_a * count_b)
        self._n_between = int(ends[-1]) if len(ends) else 0
        begin = ends - count_a * count_b
        self._between = np.column_stack([low_a, low_b, count_b, begin])
        within = np.arange(self._n_between) - np.repeat(begin, count_a * count_b)
        a, b = np.divmod(within, np.repeat(count_b, count_a * count_b))
        a += np.repeat(low_a, count_a * count_b)
        b += np.repeat(low_b, count_a * count_b)
        every = np.arange(n_knots - 1)
        self._codes, self._slot = np.unique(
            np.concatenate([self._of_knots(*ends) for ends in ((a, b), (b, a), (every, every))]),
            return_inverse=True,
        )

    @property
    def touching(self) -> Any:
        """Ones where the echoes of compared scans may tell something, sparse (3 n, 3 n)."""
        return self._sparse(self._codes, np.ones((len(self._codes), 3, 3)))

    def _sparse(self, codes: IntArray, blocks: Array) -> Any:
        from scipy.sparse import bsr_array

        n = self._n_knots
        ends = np.searchsorted(codes, n * np.arange(n + 1))
        return bsr_array((blocks, codes % n, ends), shape=(3 * n, 3 * n))

    def _of_knots(self, a: IntArray, b: IntArray) -> IntArray:
        """Row times ``n_knots`` plus column of the four blocks of each two intervals, (4 n,)."""
        row, column = np.divmod(np.arange(4), 2)
        codes = np.add.outer(a, row) * self._n_knots + np.add.outer(b, column)
        return np.asarray(codes.ravel(), dtype=np.int64)

    def normal_equations(
        self,
        i: IntArray,
        j: IntArray,
        first: IntArray,
        placed: PlacedEchoes,
        normal: Array,
        is_line: BoolArray,
        weight: Array,
    ) -> tuple[Any, Array]:
        """Information of paired echoes, sparse (3 n, 3 n), and gradient (3 n,).

        Parameters
        ----------
        i, j, first
            As from `partners`, for these pairs of scans.
        normal, is_line : ndarray, shapes (k, 2) and (k,)
        weight : ndarray, shape (m,)
        """
        n, (xy, arms, cov, fraction) = self._n_knots, placed
        across, own, g = accumulate(
            i,
            j,
            first,
            self._between,
            self._n_between,
            self._knot,
            xy,
            arms,
            cov,
            normal,
            is_line,
            fraction,
            weight,
        )
        beside, gradients = own_by_interval(own, g, self._knot, n - 1, arms, fraction)
        blocks = np.zeros((len(self._codes), 3, 3))
        slots = np.split(self._slot, 4 * np.cumsum([len(across), len(across)]))
        for slot, parts in zip(slots, (across, across.swapaxes(1, 2), beside), strict=True):
            _scatter(blocks, slot, parts)
        gradient = np.zeros((n, 3))
        gradient[:-1] += gradients[:, :3]
        gradient[1:] += gradients[:, 3:]
        told = np.any(blocks, axis=(1, 2))
        return self._sparse(self._codes[told], blocks[told]), gradient.ravel()


@numba.njit(cache=True)
def _scatter(blocks: Array, slot: IntArray, parts: Array) -> None:
    """Add the quarters of (6, 6) parts to the (3, 3) blocks where they belong."""
    for p in range(len(parts)):
        for quarter in range(4):
            into = blocks[slot[4 * p + quarter]]
            r, c = 3 * (quarter // 2), 3 * (quarter % 2)
            for d in range(3):
                for e in range(3):
                    into[d, e] += parts[p, r + d, c + e]
