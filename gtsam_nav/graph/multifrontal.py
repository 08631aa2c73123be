"""Sparse Cholesky by dense fronts, and the inverse where the factor has entries.

A front holds the rows of the columns it eliminates and hands the rest, their Schur complement, to
its parent (Duff and Reid 1983): all arithmetic is dense. The inverse's entries within fronts
follow from those within their parents (Takahashi et al. 1973), so that all marginal covariances
cost about as much as the factorisation.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.graph.elimination import Elimination
from gtsam_nav.graph.lower_triangle import LowerTriangle
from gtsam_nav.series import IntArray


@dataclass(frozen=True)
class _Front:
    """``[[L L', L W], [W' L', .]]`` over a front's own columns, then its border's, in order.

    L is ``packed``, without the zeros above its diagonal (Gustavson et al. 2010).
    """

    packed: Array
    W: Array

    def unpacked(self) -> Array:
        """L as a square."""
        from scipy.linalg.lapack import dtfttr

        return np.asarray(dtfttr(len(self.W), self.packed, uplo="L")[0])

    def solve(self, y: Array, *, transposed: bool = False) -> Array:
        """``L^-1 y``, or ``L'^-1 y``."""
        from scipy.linalg.lapack import dtfsm

        trans = "T" if transposed else "N"
        return np.asarray(dtfsm(1.0, self.packed, y, uplo="L", trans=trans))


class _Inverse(NamedTuple):
    """The inverse in a front: among its own columns, across to its border, and there."""

    own: Array
    across: Array
    beyond: LowerTriangle

    def taken(self, where: IntArray) -> LowerTriangle:
        """Some rows and columns, which increase."""
        from gtsam_nav.graph._front_kernel import take

        taken = LowerTriangle(len(where))
        take(self.own, self.across, self.beyond.entries, where, taken.entries)
        return taken

    def block(self, where: IntArray) -> Array:
        """Some rows and columns, in any order; dense."""
        from gtsam_nav.graph._front_kernel import block

        return np.asarray(block(self.own, self.across, self.beyond.entries, where))


class Factor:
    """Cholesky factor of a sparse matrix, of all its columns or of the first to be eliminated.

    Parameters
    ----------
    matrix : scipy.sparse.csc_array, shape (n, n)
        Symmetric, both triangles; positive definite in what is eliminated.
    elimination : Elimination
        Of a pattern that has all of the matrix's entries.

    Raises
    ------
    numpy.linalg.LinAlgError
        Where a front is not positive definite.
    """

    def __init__(self, matrix: Any, elimination: Elimination) -> None:
        self.elimination = elimination
        self._remainders: list[tuple[IntArray, LowerTriangle]] = []
        self._fronts = list(self._eliminate(matrix))

    def _eliminate(self, matrix: Any) -> Iterator[_Front]:
        plan = self.elimination
        brought: list[list[tuple[IntArray, LowerTriangle]]] = [[] for _ in plan.own]
        for k, (border, parent) in enumerate(zip(plan.border, plan.parent, strict=True)):
            front, left = _eliminated(*_assembled(matrix, plan, k, brought[k]))
            if parent >= 0:
                brought[parent].append((border, left))
            elif len(border):
                self._remainders.append((border - plan.n_eliminated, left))
            del left  # its parent alone is to hold it
            yield front

    def remainder(self, matrix: Any) -> Any:
        """Schur complement of the matrix in the columns left over, sparse."""
        from scipy.sparse import coo_array

        left = self.elimination.left_over
        whole = matrix[left][:, left].tocoo()
        rows, columns, entries = [whole.row], [whole.col], [whole.data]
        for border, triangle in self._remainders:
            rows.append(np.repeat(border, len(border)))
            columns.append(np.tile(border, len(border)))
            entries.append(triangle.dense().ravel())
        places = (np.concatenate(rows), np.concatenate(columns))
        return coo_array((np.concatenate(entries), places), shape=whole.shape).tocsc()

    def forward(self, b: Array) -> Array:
        """``L^-1 b``, shape (n, k), in the order of elimination; of what is left over the rest."""
        plan = self.elimination
        y: Array = b[plan.order]
        for front, own, border in zip(self._fronts, plan.own, plan.border, strict=True):
            y[own] = front.solve(y[own])
            y[border] -= front.W.T @ y[own]
        return y

    def backward(self, y: Array) -> Array:
        """``L'^-1 y`` in the matrix's own order, y being as `forward` gives it; of what is left
        over, y is the solution."""
        plan = self.elimination
        x = y.copy()
        for k in reversed(range(len(self._fronts))):
            front, own, border = self._fronts[k], plan.own[k], plan.border[k]
            x[own] = front.solve(x[own] - front.W @ x[border], transposed=True)
        out = np.empty_like(x)
        out[plan.order] = x
        return out

    def solve(self, b: Array) -> Array:
        """Solution of the whole system, shape (n, k)."""
        return self.backward(self.forward(b))

    def covariances(
        self, wanted: Sequence[IntArray], of_touched: Sequence[Array] | None = None
    ) -> list[Array]:
        """Blocks of the inverse.

        Parameters
        ----------
        wanted : sequence of ndarray of int
            Columns of each block, all of which meet in one front, at least one being eliminated.
        of_touched : sequence of ndarray, optional
            Covariance of what each front touches (see `Elimination.touched_left_over`), where
            columns are left over.
        """
        plan = self.elimination
        places = [plan.place[columns] for columns in wanted]
        ends = [own.stop for own in plan.own]
        at = np.searchsorted(ends, [p.min() for p in places], side="right")
        by_front: list[list[int]] = [[] for _ in self._fronts]
        for block, k in enumerate(at.tolist()):
            by_front[k].append(block)
        found: list[Array] = [np.empty((0, 0))] * len(places)
        for k, rows, inverse in self._inverses(of_touched):
            for block in by_front[k]:
                here = np.searchsorted(rows, places[block])
                assert np.array_equal(rows[np.minimum(here, len(rows) - 1)], places[block])
                found[block] = inverse.block(here)
        return found

    def _inverses(
        self, of_touched: Sequence[Array] | None
    ) -> Iterator[tuple[int, IntArray, _Inverse]]:
        """Each front's rows and the inverse there, parents first; none is held for longer than its
        children need it."""
        plan = self.elimination
        parents = [p for p in plan.parent if p >= 0]
        children = np.bincount(parents, minlength=len(plan.parent)).tolist()
        known: dict[int, tuple[IntArray, _Inverse]] = {}
        for k in reversed(range(len(self._fronts))):
            parent = plan.parent[k]
            if parent >= 0:
                rows, inverse = known[parent]
                beyond = inverse.taken(np.searchsorted(rows, plan.border[k]))
                children[parent] -= 1
                if not children[parent]:
                    del known[parent], inverse
            else:
                beyond = LowerTriangle(0) if of_touched is None else LowerTriangle.of(of_touched[k])
            found = plan.rows(k), _inverse(self._fronts[k], beyond)
            if children[k]:
                known[k] = found
            yield k, *found


def _assembled(
    matrix: Any, plan: Elimination, k: int, brought: list[tuple[IntArray, LowerTriangle]]
) -> tuple[Array, Array, LowerTriangle]:
    """A front's matrix with what its children left, which goes: the lower triangle of its own
    columns, their rows across to the border, and what is beyond."""
    from gtsam_nav.graph._front_kernel import add_entries, add_remainder

    rows, n_border = plan.rows(k), len(plan.border[k])
    width = len(rows) - n_border
    own = np.zeros((width, width), order="F")
    across = np.zeros((width, n_border), order="F")
    beyond = LowerTriangle(n_border)
    columns = plan.order[plan.own[k]]
    entries = (matrix.indptr, matrix.indices, matrix.data)
    add_entries(own, across, columns, plan.place, rows, *entries)
    while brought:
        theirs, left = brought.pop()
        add_remainder(own, across, beyond.entries, np.searchsorted(rows, theirs), left.entries)
    return own, across, beyond


def _eliminated(own: Array, across: Array, beyond: LowerTriangle) -> tuple[_Front, LowerTriangle]:
    """A front, made in its matrix's place, and what is left of its border."""
    from scipy.linalg.blas import dtrsm
    from scipy.linalg.lapack import dpotrf, dtrttf

    L, failure = dpotrf(own, lower=1, overwrite_a=1)
    if failure:
        raise np.linalg.LinAlgError("a front is not positive definite")
    packed, _ = dtrttf(L, uplo="L")
    if beyond.n:
        across = dtrsm(1.0, L, across, lower=1, overwrite_b=1)
        beyond.subtract_square(across)
    return _Front(packed, across), beyond


def _inverse(front: _Front, beyond: LowerTriangle) -> _Inverse:
    """The inverse in a front, from that in its border."""
    from scipy.linalg.lapack import dpotri

    # its pivots are positive: they made the factor
    own, _ = dpotri(front.unpacked(), lower=1, overwrite_c=1)
    own += np.tril(own, -1).T
    gain = front.solve(front.W, transposed=True)
    across = beyond.times(gain)
    own += across @ gain.T
    return _Inverse(own, np.negative(across, out=across), beyond)
