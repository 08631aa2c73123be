"""Compiled parts of the multifrontal factor: what goes into a front, and what comes out of one.

A front is symmetric: ``own`` (w, w) and ``across`` (w, b) hold the rows of its own columns,
``beyond`` the entries of a `LowerTriangle` among the b columns of its border.
"""

from __future__ import annotations

import numba
import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.series import IntArray

PANEL = 128
"""Columns of a symmetric matrix that are held together, from their diagonal block down."""


@numba.njit(cache=True)
def _column(n: int, c: int) -> int:
    """Where row r of column c of a `LowerTriangle` of n rows stands, less r."""
    first = c - c % PANEL
    before = first * n - first * (first - PANEL) // 2
    return before + (c - first) * (n - first) - first


@numba.njit(cache=True)
def add_entries(
    own: Array,
    across: Array,
    columns: IntArray,
    place: IntArray,
    rows: IntArray,
    indptr: IntArray,
    indices: IntArray,
    data: Array,
) -> None:
    """Add a sparse matrix's entries in a front's columns: the own ones' lower triangle, and those
    across to the border.

    Parameters
    ----------
    columns : ndarray of int, shape (w,)
    place : ndarray of int, shape (n,)
        In the order of elimination, of each of the matrix's rows.
    rows : ndarray of int, shape (w + b,)
        Places of the front's.
    """
    w = len(columns)
    for c in range(w):
        for entry in range(indptr[columns[c]], indptr[columns[c] + 1]):
            p = place[indices[entry]]
            if p < rows[c]:
                continue
            r = np.searchsorted(rows, p)
            if r >= len(rows) or rows[r] != p:
                raise ValueError("an entry that the pattern has not")
            if r < w:
                own[r, c] += data[entry]
            else:
                across[c, r - w] += data[entry]


@numba.njit(cache=True)
def add_remainder(
    own: Array, across: Array, beyond: Array, where: IntArray, remainder: Array
) -> None:
    """Add the lower triangle of what a child left to rows and columns ``where``, which increase."""
    w, b = across.shape
    n = len(where)
    n_own = np.searchsorted(where, w)
    for c in range(n):
        column = _column(n, c)
        if c < n_own:
            for r in range(c, n_own):
                own[where[r], where[c]] += remainder[column + r]
            for r in range(n_own, n):
                across[where[c], where[r] - w] += remainder[column + r]
        else:
            into = _column(b, where[c] - w) - w
            for r in range(c, n):
                beyond[into + where[r]] += remainder[column + r]


@numba.njit(cache=True)
def take(own: Array, across: Array, beyond: Array, where: IntArray, into: Array) -> None:
    """Rows and columns ``where``, which increase, as a `LowerTriangle` whose diagonal blocks are
    whole."""
    w, b = across.shape
    n = len(where)
    n_own = np.searchsorted(where, w)
    for c in range(n):
        column = _column(n, c)
        if c < n_own:
            for r in range(c, n_own):
                into[column + r] = own[where[r], where[c]]
            for r in range(n_own, n):
                into[column + r] = across[where[c], where[r] - w]
        else:
            source = _column(b, where[c] - w) - w
            for r in range(c, n):
                into[column + r] = beyond[source + where[r]]
        for r in range(c - c % PANEL, c):
            into[column + r] = into[_column(n, r) + c]


@numba.njit(cache=True)
def block(own: Array, across: Array, beyond: Array, where: IntArray) -> Array:
    """Rows and columns ``where``, dense."""
    w, b = across.shape
    out = np.empty((len(where), len(where)))
    for i in range(len(where)):
        for j in range(i + 1):
            low, high = min(where[i], where[j]), max(where[i], where[j])
            if high < w:
                out[i, j] = own[high, low]
            elif low < w:
                out[i, j] = across[low, high - w]
            else:
                out[i, j] = beyond[_column(b, low - w) + high - w]
            out[j, i] = out[i, j]
    return out
