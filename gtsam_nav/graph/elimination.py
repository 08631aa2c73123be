"""What of a sparse factorisation depends on the pattern alone: its fronts, and what each meets."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from gtsam_nav.series import IntArray


class Elimination:
    """Order of elimination of a matrix's columns, of all or of some, and their fronts.

    Parameters
    ----------
    pattern : scipy.sparse array, shape (n, n)
        Symmetric, with an entry wherever the matrix may have one, or columns are to meet.
    columns : sequence of ndarray of int
        Columns of each front, children before parents; the columns in none are left over.
    parent : sequence of int
        Of each front, -1 where what remains goes to the columns left over.

    Attributes
    ----------
    order : ndarray of int, shape (n,)
        Columns as they are eliminated, those left over at the end.
    place : ndarray of int, shape (n,)
        Of each column in that order.
    left_over : ndarray of int
        Columns that are not eliminated.
    parent : sequence of int
    own : list of slice
        Places of each front's own columns.
    border : list of ndarray of int
        Places behind them that each front meets, increasing.
    """

    def __init__(self, pattern: Any, columns: Sequence[IntArray], parent: Sequence[int]) -> None:
        n = pattern.shape[0]
        eliminated = np.concatenate([*columns, np.empty(0, dtype=np.int64)])
        left = np.ones(n, dtype=bool)
        left[eliminated] = False
        self.left_over = np.flatnonzero(left)
        self.order = np.concatenate([eliminated, self.left_over])
        self.place = np.empty(n, dtype=np.int64)
        self.place[self.order] = np.arange(n)
        self.parent = parent
        ends = np.cumsum([0, *(len(own) for own in columns)]).tolist()
        self.own = [slice(a, b) for a, b in pairwise(ends)]
        self.border = self._borders(pattern.tocsc())

    @property
    def n_eliminated(self) -> int:
        """How many columns are not left over."""
        return len(self.order) - len(self.left_over)

    @property
    def touched_left_over(self) -> list[IntArray]:
        """What each front touches of `left_over`, as indices, where fronts have no parents."""
        return [border - self.n_eliminated for border in self.border]

    def rows(self, k: int) -> IntArray:
        """Places of a front's own columns and of its border."""
        return np.concatenate([np.arange(self.own[k].start, self.own[k].stop), self.border[k]])

    def _borders(self, pattern: Any) -> list[IntArray]:
        pattern = pattern[:, self.order]
        brought: list[list[IntArray]] = [[] for _ in self.own]
        borders = []
        for own, parent, children in zip(self.own, self.parent, brought, strict=True):
            met = pattern.indices[pattern.indptr[own.start] : pattern.indptr[own.stop]]
            touched = np.concatenate([self.place[met], *children])
            children.clear()
            border = np.unique(touched[touched >= own.stop])
            if parent >= 0:
                brought[parent].append(border)
            borders.append(border)
        return borders


def pattern_of(blocks: Sequence[IntArray], n: int) -> Any:
    """Ones throughout given blocks of columns, as `Elimination` takes what is to meet; (n, n)."""
    from scipy.sparse import coo_array

    members = np.concatenate([np.empty(0, dtype=np.int32), *blocks], dtype=np.int32)
    sizes = np.array([len(block) for block in blocks], dtype=np.int64)
    # each member meets all of its block, which stands from ``first`` on
    meets = np.repeat(sizes, sizes)
    first = np.repeat(np.cumsum(sizes) - sizes, sizes)
    within = np.arange(np.sum(meets)) - np.repeat(np.cumsum(meets) - meets, meets)
    rows, columns = np.repeat(members, meets), members[np.repeat(first, meets) + within]
    return coo_array((np.ones(len(rows)), (rows, columns)), shape=(n, n)).tocsc()
