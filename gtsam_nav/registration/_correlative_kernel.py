"""Compiled sums of ``correlative.search``."""

from __future__ import annotations

import math

import numba
import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.series import IntArray


@numba.njit(cache=True, error_model="numpy")
def score_volume(
    field: Array,
    bound: Array,
    block: int,
    corner: Array,
    cell_m: float,
    xy_new: Array,
    q_prior: Array,
    information: Array,
    gate: float,
    turns: Array,
    blocks: int,
    keep: float,
) -> Array:
    """Mean of a field under the new points at each pose; NaN where it cannot matter.

    Parameters
    ----------
    field : ndarray, shape (rows, columns)
        Over the reference's x and y; zero beyond.
    bound : ndarray, of the same shape
        Its greatest value in the ``block`` x ``block`` cells from each one on.
    corner : ndarray, shape (2,)
        Middle of the field's first cell, m.
    turns : ndarray, shape (k,)
        From the prior, rad.
    blocks : int
        Tried to either side of the prior.
    keep : float
        Poses that score less than this share of the best one need not be told.

    Returns
    -------
    ndarray, shape (k, 2 blocks block, 2 blocks block)
        By turn, and by shift along x and y from the prior in cells, beginning with -blocks block.
    """
    places = np.empty((len(turns), len(xy_new), 2), dtype=np.int64)
    upper = np.full((len(turns), 2 * blocks, 2 * blocks), -1.0)
    for k in range(len(turns)):
        _cells(places[k], xy_new, q_prior, turns[k], corner, cell_m)
        for i in range(2 * blocks):
            for j in range(2 * blocks):
                x, y = (i - blocks) * block, (j - blocks) * block
                # a block counts where its middle lies within the gate, or nearly so
                half = 0.5 * (block - 1)
                if _squared(x + half, y + half, turns[k], cell_m, information) <= gate:
                    upper[k, i, j] = _mean(bound, places[k], x, y)
    n = 2 * blocks * block
    volume = np.full((len(turns), n, n), np.nan)
    best = 0.0
    first = int(np.argmax(upper))
    for m in range(-1, upper.size):
        # the most promising block first: it spares many others
        flat = first if m < 0 else m
        k, rest = flat // (4 * blocks * blocks), flat % (4 * blocks * blocks)
        i, j = rest // (2 * blocks), rest % (2 * blocks)
        if upper[k, i, j] < keep * best or upper[k, i, j] <= 0.0:
            continue
        for row in range(i * block, (i + 1) * block):
            for column in range(j * block, (j + 1) * block):
                x, y = row - blocks * block, column - blocks * block
                volume[k, row, column] = _mean(field, places[k], x, y)
                best = max(best, volume[k, row, column])
    return volume


@numba.njit(cache=True, error_model="numpy")
def _cells(
    places: IntArray, xy_new: Array, q: Array, turn: float, corner: Array, cell_m: float
) -> None:
    """Cells of the new points at the prior's place, turned."""
    c, s = math.cos(q[2] + turn), math.sin(q[2] + turn)
    for p in range(len(xy_new)):
        x = q[0] + c * xy_new[p, 0] - s * xy_new[p, 1]
        y = q[1] + s * xy_new[p, 0] + c * xy_new[p, 1]
        places[p, 0] = round((x - corner[0]) / cell_m)
        places[p, 1] = round((y - corner[1]) / cell_m)


@numba.njit(cache=True, error_model="numpy")
def _squared(x: float, y: float, turn: float, cell_m: float, A: Array) -> float:
    """Squared Mahalanobis distance of a pose from the prior."""
    x, y = x * cell_m, y * cell_m
    across = A[0, 1] * x * y + A[0, 2] * x * turn + A[1, 2] * y * turn
    return float(A[0, 0] * x * x + A[1, 1] * y * y + A[2, 2] * turn * turn + 2 * across)


@numba.njit(cache=True, error_model="numpy")
def _mean(field: Array, places: IntArray, x: int, y: int) -> float:
    total = 0.0
    for p in range(len(places)):
        row, column = places[p, 0] + x, places[p, 1] + y
        if 0 <= row < field.shape[0] and 0 <= column < field.shape[1]:
            total += field[row, column]
    return total / len(places)
