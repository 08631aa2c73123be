"""Compiled correction of a large covariance: one pass, in place, and symmetric to the last bit."""

from __future__ import annotations

import numba

from gtsam_nav.frames import Array


@numba.njit(cache=True)
def subtract_symmetric(P: Array, A: Array, B: Array) -> None:
    """``P := P - A B' - B A'`` for the leading rows and columns; A and B have three columns."""
    n = len(A)
    for i in range(n):
        a0, a1, a2 = A[i, 0], A[i, 1], A[i, 2]
        b0, b1, b2 = B[i, 0], B[i, 1], B[i, 2]
        for j in range(n):
            P[i, j] -= (
                (a0 * B[j, 0] + b0 * A[j, 0])
                + (a1 * B[j, 1] + b1 * A[j, 1])
                + (a2 * B[j, 2] + b2 * A[j, 2])
            )
