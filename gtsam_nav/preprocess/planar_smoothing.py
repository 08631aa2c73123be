"""Planar poses that agree best with the motion between them and with sightings of known points.

Gauss-Newton with Cauchy's weights on the sightings: a false one loses its say. A few dozen poses,
so the normal equations are dense.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.preprocess.planar_motion import Increments
from gtsam_nav.series import IntArray

LEAST_VARIANCE = 1e-10
"""Of an increment, m^2 or rad^2: a standing vehicle still has a solvable problem."""
STEPS, LEAST_STEP = 12, 1e-5
"""Of the least squares: most, and the size (m or rad) that ends them."""


@dataclass(frozen=True)
class SightedPoints:
    """Points that were seen from the poses.

    Attributes
    ----------
    pose : ndarray of int, shape (k,)
        From which.
    p_b : ndarray, shape (k, 2)
        Level, in the axes of that pose, m.
    cov_b : ndarray, shape (k, 2, 2)
    """

    pose: IntArray
    p_b: Array
    cov_b: Array


def smooth(
    x: Array,
    increments: Increments,
    seen: SightedPoints,
    known: Callable[[Array], Array],
    doubt: float,
) -> tuple[Array, Array]:
    """Least squares over all poses.

    Parameters
    ----------
    x : ndarray, shape (m, 3)
        Poses n, e, course to begin with.
    increments : Increments
        Between successive poses.
    seen : SightedPoints
    known : callable
        Where the seen points truly are, (k, 2), given where they seem to be.
    doubt : float
        Squared normalised residual at which a sighting counts half.

    Returns
    -------
    x : ndarray, shape (m, 3)
    cov : ndarray, shape (3 m, 3 m)
    """
    x = x.copy()
    normal = np.eye(x.size)
    for _ in range(STEPS):
        normal, gradient = _along_the_motion(x, increments)
        _add_sightings(normal, gradient, x, seen, known, doubt)
        step = np.linalg.solve(normal, gradient)
        x -= step.reshape(-1, 3)
        if np.max(np.abs(step)) < LEAST_STEP:
            break
    return x, np.asarray(np.linalg.inv(normal))


def _along_the_motion(x: Array, increments: Increments) -> tuple[Array, Array]:
    """Normal matrix and gradient of the increments."""
    m = len(x)
    normal, gradient = np.zeros((3 * m, 3 * m)), np.zeros(3 * m)
    for k in range(m - 1):
        c, s = np.cos(x[k, 2]), np.sin(x[k, 2])
        to_body = np.array([[c, s], [-s, c]])
        moved_b = to_body @ (x[k + 1, :2] - x[k, :2])
        turn_off = wrap_angle(x[k + 1, 2] - x[k, 2] - increments.turn[k])
        residual = np.append(moved_b - increments.displacement_b[k], turn_off)
        J = np.zeros((3, 6))
        J[:2, :2], J[:2, 3:5] = -to_body, to_body
        J[:2, 2] = moved_b[1], -moved_b[0]
        J[2, 2], J[2, 5] = -1.0, 1.0
        JtW = J.T / np.maximum(increments.variance[k], LEAST_VARIANCE)
        both = slice(3 * k, 3 * k + 6)
        normal[both, both] += JtW @ J
        gradient[both] += JtW @ residual
    return normal, gradient


def _add_sightings(
    normal: Array,
    gradient: Array,
    x: Array,
    seen: SightedPoints,
    known: Callable[[Array], Array],
    doubt: float,
) -> None:
    at = x[seen.pose]
    c, s = np.cos(at[:, 2]), np.sin(at[:, 2])
    R = np.moveaxis(np.array([[c, -s], [s, c]]), 2, 0)
    arm = np.einsum("kij,kj->ki", R, seen.p_b)
    residual = at[:, :2] + arm
    residual -= known(residual)
    information = np.linalg.inv(R @ seen.cov_b @ np.swapaxes(R, 1, 2))
    squared = np.einsum("ki,kij,kj->k", residual, information, residual)
    J: Array = np.tile(np.eye(2, 3), (len(at), 1, 1))
    J[:, 0, 2], J[:, 1, 2] = -arm[:, 1], arm[:, 0]
    JtW = np.swapaxes(J, 1, 2) @ information / (1.0 + squared / doubt)[:, None, None]
    for k, pose in enumerate(seen.pose):
        own = slice(3 * pose, 3 * pose + 3)
        normal[own, own] += JtW[k] @ J[k]
        gradient[own] += JtW[k] @ residual[k]
