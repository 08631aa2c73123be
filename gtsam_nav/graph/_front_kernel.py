"""Compiled part of the multifrontal factor."""

from __future__ import annotations

import numba

from gtsam_nav.frames import Array
from gtsam_nav.series import IntArray


@numba.njit(cache=True)
def add_lower(A: Array, beyond: Array, where: IntArray, rest: Array) -> None:
    """Add the lower triangle of ``rest`` to rows and columns ``where`` of a front, which increase:
    to its own columns A, or to those of its border, ``beyond``."""
    width = A.shape[1]
    for c in range(len(where)):
        if where[c] < width:
            for r in range(c, len(where)):
                A[where[r], where[c]] += rest[r, c]
        else:
            for r in range(c, len(where)):
                beyond[where[r] - width, where[c] - width] += rest[r, c]
