"""A turn of vehicle and landmarks together, of which their sightings tell nothing.

Errors of a planar state are along fixed axes, so that a turn of all about the origin by an angle is
an error (-e, n) of each position by that angle, and of the course. A correction moves the
positions. Were the covariance left as it is, it would know of the turn about the old ones, and the
next sightings, which are seen about the new ones, would tell a course that they do not know: with
each drive past a landmark the filter would grow too sure of itself. The covariance therefore moves
with the positions. This is what the errors of an invariant filter do by themselves: Barrau and
Bonnabel, *An EKF-SLAM algorithm with consistency properties* (2015); Huang, Mourikis and
Roumeliotis, International Journal of Robotics Research 29(5), 2010.
"""

from __future__ import annotations

import numpy as np

from gtsam_nav.frames import Array

COURSE = 2
"""Place of the course among the errors, after north and east."""


def covariance_after(P: Array, error: Array, first: int, axes: int) -> Array:
    """Covariance of the errors, carried to the state in which one has been put right.

    Parameters
    ----------
    P : ndarray, shape (n, n)
        Symmetric.
    error : ndarray, shape (n,)
        Of north, east and course, what else there is of vehicle and sensor, and each landmark's
        position.
    first : int
        Place of the first landmark's.
    axes : int
        Of each landmark, north and east first.
    """
    swept = _swept(error, first, axes)
    half = np.outer(swept, P[COURSE] + 0.5 * P[COURSE, COURSE] * swept)
    return np.asarray(P + (half + half.T))


def jacobian_before(H: Array, error: Array, first: int, axes: int) -> Array:
    """A Jacobian (k, n) about the state in which an error has been put right, in the errors before;
    parameters as of `covariance_after`."""
    H = H.copy()
    H[:, COURSE] += H @ _swept(error, first, axes)
    return H


def _swept(error: Array, first: int, axes: int) -> Array:
    """By how much more a turn moves each position that this error has moved, shape (n,)."""
    swept = np.zeros_like(error)
    for at in (0, *range(first, len(error), axes)):
        swept[at : at + 2] = -error[at + 1], error[at]
    return swept
