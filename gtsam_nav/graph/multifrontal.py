"""Sparse Cholesky by dense fronts, and the inverse where the factor has entries.

A front holds the rows of the columns it eliminates and hands the rest, their Schur complement, to
its parent (Duff and Reid 1983): all arithmetic is dense. The inverse's entries within fronts
follow from those within their parents (Takahashi et al. 1973), so that all marginal covariances
cost about as much as the factorisation.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.series import IntArray


@dataclass(frozen=True)
class _Front:
    """``[[L L', L W], [W' L', .]]`` over a front's own columns, then its border's, in order."""

    own: slice
    border: IntArray
    L: Array
    W: Array


class Factor:
    """Cholesky factor of a sparse matrix, of all its columns or of the first to be eliminated.

    Parameters
    ----------
    matrix : scipy.sparse array, shape (n, n)
        Symmetric, both triangles; positive definite in what is eliminated.
    columns : sequence of ndarray of int
        Columns of each front, children before parents; the columns in none are left over.
    parent : sequence of int
        Of each front, -1 where what remains goes to the columns left over.
    meeting : scipy.sparse array, shape (n, n), optional
        Pattern of columns that are to meet in a front though the matrix has no entry there.

    Raises
    ------
    numpy.linalg.LinAlgError
        Where a front is not positive definite.
    """

    def __init__(
        self,
        matrix: Any,
        columns: Sequence[IntArray],
        parent: Sequence[int],
        meeting: Any = None,
    ) -> None:
        n = matrix.shape[0]
        eliminated = np.concatenate([*columns, np.empty(0, dtype=np.int64)])
        left = np.ones(n, dtype=bool)
        left[eliminated] = False
        self.left_over = np.flatnonzero(left)
        self.order = np.concatenate([eliminated, self.left_over])
        self.place = np.empty(n, dtype=np.int64)
        self.place[self.order] = np.arange(n)
        self._ends = np.cumsum([len(own) for own in columns])
        self._parent = parent
        self._remainders: list[tuple[IntArray, Array]] = []
        self._fronts = list(self._eliminate(matrix, matrix if meeting is None else meeting))

    @property
    def _n_eliminated(self) -> int:
        return len(self.order) - len(self.left_over)

    def _eliminate(self, matrix: Any, meeting: Any) -> Iterator[_Front]:
        from scipy.linalg import cholesky, solve_triangular

        matrix, meeting = (m.tocsc()[self.order][:, self.order].tocsc() for m in (matrix, meeting))
        brought: list[list[tuple[IntArray, Array]]] = [[] for _ in self._parent]
        first = 0
        for k, end in enumerate(self._ends.tolist()):
            border, A, beyond = _assembled(matrix, meeting, slice(first, end), brought[k])
            brought[k] = []
            width = end - first
            L = cholesky(A[:width], lower=True, check_finite=False)
            W = solve_triangular(L, A[width:].T, lower=True, check_finite=False)
            rest = _less_square(beyond, W)
            if self._parent[k] >= 0:
                brought[self._parent[k]].append((border, rest))
            elif len(border):
                whole = np.tril(rest) + np.tril(rest, -1).T
                self._remainders.append((border - self._n_eliminated, whole))
            yield _Front(slice(first, end), border, L, W)
            first = end

    def remainder(self, matrix: Any) -> Any:
        """Schur complement of the matrix in the columns left over, sparse."""
        from scipy.sparse import coo_array

        whole = matrix[self.left_over][:, self.left_over].tocoo()
        rows, columns, entries = [whole.row], [whole.col], [whole.data]
        for border, rest in self._remainders:
            rows.append(np.repeat(border, len(border)))
            columns.append(np.tile(border, len(border)))
            entries.append(rest.ravel())
        places = (np.concatenate(rows), np.concatenate(columns))
        return coo_array((np.concatenate(entries), places), shape=whole.shape).tocsc()

    def forward(self, b: Array) -> Array:
        """``L^-1 b``, shape (n, k), in the order of elimination; of what is left over the rest."""
        from scipy.linalg import solve_triangular

        y: Array = b[self.order]
        for front in self._fronts:
            y[front.own] = solve_triangular(front.L, y[front.own], lower=True, check_finite=False)
            y[front.border] -= front.W.T @ y[front.own]
        return y

    def backward(self, y: Array) -> Array:
        """``L'^-1 y`` in the matrix's own order, y being as `forward` gives it; of what is left
        over, y is the solution."""
        from scipy.linalg import solve_triangular

        x = y.copy()
        for front in reversed(self._fronts):
            right = x[front.own] - front.W @ x[front.border]
            x[front.own] = solve_triangular(front.L, right, lower=True, trans=1, check_finite=False)
        out = np.empty_like(x)
        out[self.order] = x
        return out

    def solve(self, b: Array) -> Array:
        """Solution of the whole system, shape (n, k)."""
        return self.backward(self.forward(b))

    def borders(self) -> list[IntArray]:
        """Columns left over that each front touches, as places among these, where fronts have no
        parents."""
        return [front.border - self._n_eliminated for front in self._fronts]

    def covariances(
        self, wanted: Sequence[IntArray], of_borders: Sequence[Array] | None = None
    ) -> list[Array]:
        """Blocks of the inverse.

        Parameters
        ----------
        wanted : sequence of ndarray of int
            Columns of each block, all of which meet in one front, at least one being eliminated.
        of_borders : sequence of ndarray, optional
            Covariance of each front's `borders`, where columns are left over and fronts have no
            parents.
        """
        places = [self.place[columns] for columns in wanted]
        at = np.searchsorted(self._ends, [p.min() for p in places], side="right")
        by_front: list[list[int]] = [[] for _ in self._fronts]
        for block, k in enumerate(at.tolist()):
            by_front[k].append(block)
        children = np.bincount(
            [p for p in self._parent if p >= 0], minlength=len(self._parent)
        ).tolist()
        known: dict[int, tuple[IntArray, Array]] = {}
        found: list[Array] = [np.empty((0, 0))] * len(places)
        for k in reversed(range(len(self._fronts))):
            front, parent = self._fronts[k], self._parent[k]
            if parent >= 0:
                rows, cov = known[parent]
                here = np.searchsorted(rows, front.border)
                beyond = cov[np.ix_(here, here)]
                children[parent] -= 1
                if not children[parent]:
                    del known[parent]
            else:
                beyond = np.empty((0, 0)) if of_borders is None else of_borders[k]
            rows, cov = _inverse(front, beyond)
            if children[k]:
                known[k] = rows, cov
            for block in by_front[k]:
                here = np.searchsorted(rows, places[block])
                assert np.array_equal(rows[np.minimum(here, len(rows) - 1)], places[block])
                found[block] = cov[np.ix_(here, here)]
        return found


def pattern_of(blocks: Sequence[IntArray], n: int) -> Any:
    """Ones throughout given blocks of columns, as `Factor` takes what is to meet; shape (n, n)."""
    from scipy.sparse import coo_array

    members = np.concatenate([np.empty(0, dtype=np.int64), *blocks])
    sizes = np.array([len(block) for block in blocks], dtype=np.int64)
    # each member meets all of its block, which stands from ``first`` on
    meets = np.repeat(sizes, sizes)
    first = np.repeat(np.cumsum(sizes) - sizes, sizes)
    within = np.arange(np.sum(meets)) - np.repeat(np.cumsum(meets) - meets, meets)
    rows, columns = np.repeat(members, meets), members[np.repeat(first, meets) + within]
    return coo_array((np.ones(len(rows)), (rows, columns)), shape=(n, n)).tocsc()


def _assembled(
    matrix: Any, meeting: Any, own: slice, brought: list[tuple[IntArray, Array]]
) -> tuple[IntArray, Array, Array]:
    """A front's border, and the lower triangle of its matrix with what its children left: the own
    columns, and those of the border."""
    from gtsam_nav.graph._front_kernel import add_lower

    width = own.stop - own.start
    entries = slice(matrix.indptr[own.start], matrix.indptr[own.stop])
    row, value = matrix.indices[entries], matrix.data[entries]
    column = np.repeat(np.arange(width), np.diff(matrix.indptr[own.start : own.stop + 1]))
    later = row >= own.start
    row, value, column = row[later], value[later], column[later]
    met = meeting.indices[meeting.indptr[own.start] : meeting.indptr[own.stop]]
    touched = np.zeros(matrix.shape[0] - own.stop, dtype=bool)
    for rows in (row, met, *(border for border, _ in brought)):
        touched[rows[rows >= own.stop] - own.stop] = True
    border = np.flatnonzero(touched) + own.stop
    rows = np.concatenate([np.arange(own.start, own.stop), border])
    A = np.zeros((len(rows), width), order="F")
    beyond = np.zeros((len(border), len(border)), order="F")
    A[np.searchsorted(rows, row), column] = value
    for theirs, rest in brought:
        add_lower(A, beyond, np.searchsorted(rows, theirs), rest)
    return border, A, beyond


def _less_square(A: Array, W: Array) -> Array:
    """``A - W' W`` in A's place, of which only the lower triangle means anything."""
    from scipy.linalg.blas import dsyrk

    if A.size == 0:
        return A
    return np.asarray(dsyrk(-1.0, W, 1.0, A, trans=1, lower=1, overwrite_c=1))


def _inverse(front: _Front, beyond: Array) -> tuple[IntArray, Array]:
    """Rows of a front and the inverse there, from that of its border."""
    from scipy.linalg import solve_triangular
    from scipy.linalg.lapack import dpotri

    width = front.own.stop - front.own.start
    own, _ = dpotri(front.L, lower=1)  # its pivots are positive: they made the factor
    gain = solve_triangular(front.L, front.W, lower=True, trans=1, check_finite=False)
    own += np.tril(own, -1).T
    cov = np.empty((width + len(front.border),) * 2)
    across = -gain @ beyond
    own -= across @ gain.T
    cov[:width, :width] = own
    cov[:width, width:], cov[width:, :width] = across, across.T
    cov[width:, width:] = beyond
    rows = np.concatenate([np.arange(front.own.start, front.own.stop), front.border])
    return rows, cov
