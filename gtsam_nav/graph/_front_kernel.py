"""Compiled part of the multifrontal factor."""

from __future__ import annotations

import numba

from gtsam_nav.frames import Array
from gtsam_nav.series import IntArray


@numba.njit(cache=True)
def add_lower(A: Array, where: IntArray, rest: Array) -> None:
    """Add the lower triangle of ``rest`` to rows and columns ``where`` of A, which increase."""
    for c in range(len(where)):
        for r in range(c, len(where)):
            A[where[r], where[c]] += rest[r, c]
