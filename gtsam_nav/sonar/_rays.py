"""Compiled count of the rays that cross or end in each cell of a grid."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from gtsam_nav.series import BoolArray, IntArray

Counts = NDArray[np.int32]


@numba.njit(cache=True)
def count_rays(
    begin: IntArray, end: IntArray, is_seen_through: BoolArray, rows: int, columns: int
) -> tuple[Counts, Counts]:
    """Ends and crossings of each cell.

    Parameters
    ----------
    begin, end : ndarray of int, shape (k, 2)
        Row and column of both ends of each ray, inside the grid.
    is_seen_through : ndarray of bool, shape (k,)
        Whether the cells before the ray's end count as crossed.
    rows, columns : int

    Returns
    -------
    hits, misses : ndarray of int, shape (rows, columns)
    """
    hits = np.zeros((rows, columns), np.int32)
    misses = np.zeros((rows, columns), np.int32)
    for k in range(len(end)):
        hits[end[k, 0], end[k, 1]] += 1
        if not is_seen_through[k]:
            continue
        down, right = end[k, 0] - begin[k, 0], end[k, 1] - begin[k, 1]
        steps = max(abs(down), abs(right))
        for step in range(steps):
            row = begin[k, 0] + int(np.floor(down * step / steps + 0.5))
            column = begin[k, 1] + int(np.floor(right * step / steps + 0.5))
            misses[row, column] += 1
    return hits, misses
