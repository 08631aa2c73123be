"""Attitudes as running products of small turns: all at once, without a loop in time."""

from __future__ import annotations

import numpy as np

from gtsam_nav.frames import Array, rotation_from_quaternion
from gtsam_nav.series import IntArray


def running_turns(turns: Array, place: IntArray) -> Array:
    """Products of the turns of a spell up to each.

    Those of 1, 2, 4, 8, ... neighbours: in as many rounds as their number has binary digits.

    Parameters
    ----------
    turns : ndarray, shape (k, 3)
        Rotation vectors, rad, of one spell after the other.
    place : ndarray of int, shape (k,)
        How many turns of its spell come before each.

    Returns
    -------
    ndarray, shape (k, 3, 3)
    """
    angle = np.linalg.norm(turns, axis=1)
    q = np.vstack([np.cos(angle / 2), 0.5 * np.sinc(angle / (2 * np.pi)) * turns.T])
    reach = 1
    while reach <= np.max(place, initial=0):
        (late,) = np.nonzero(place >= reach)
        q[:, late] = _product(q[:, late - reach], q[:, late])
        reach *= 2
    return rotation_from_quaternion(q.T)


def _product(a: Array, b: Array) -> Array:
    """Of quaternions (4, k), scalar first."""
    return np.stack(
        [
            a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
            a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
            a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
            a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
        ]
    )
