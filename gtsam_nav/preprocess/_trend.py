"""Compiled Rauch-Tung-Striebel smoother of a scalar signal with a local trend."""

from __future__ import annotations

import numba
import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.mission import BoolArray


@numba.njit(cache=True, error_model="numpy")
def smooth_trend(
    t: Array,
    z: Array,
    variance: Array,
    level_density: float,
    trend_density: float,
    trend_variance: float,
    gate: float,
) -> tuple[Array, Array, Array, BoolArray]:
    """Smooth readings of a level that drifts with a slowly changing trend.

    ``level' = trend + white(level_density)``, ``trend' = white(trend_density)``, densities being
    variances per second. A reading whose squared normalised innovation exceeds ``gate`` is skipped.

    Parameters
    ----------
    t, z, variance : ndarray, shape (n,)
        Times, readings and their variances.
    trend_variance : float
        Of the trend at the start; zero with a zero density makes a plain random walk.

    Returns
    -------
    level, trend, level_variance : ndarray, shape (n,)
    used : ndarray of bool, shape (n,)
    """
    n = len(t)
    x, P = np.zeros((n, 2)), np.zeros((n, 2, 2))
    x_predicted, P_predicted = np.zeros((n, 2)), np.zeros((n, 2, 2))
    used = np.ones(n, np.bool_)
    x[0, 0], P[0, 0, 0], P[0, 1, 1] = z[0], variance[0], trend_variance
    x_predicted[0], P_predicted[0] = x[0], P[0]
    F, Q = np.eye(2), np.zeros((2, 2))
    for k in range(1, n):
        dt = t[k] - t[k - 1]
        F[0, 1] = dt
        Q[0, 0] = level_density * dt + trend_density * dt**3 / 3
        Q[0, 1] = Q[1, 0] = trend_density * dt**2 / 2
        Q[1, 1] = trend_density * dt
        x_predicted[k] = F @ x[k - 1]
        P_predicted[k] = F @ P[k - 1] @ F.T + Q
        S = P_predicted[k, 0, 0] + variance[k]
        innovation = z[k] - x_predicted[k, 0]
        used[k] = innovation * innovation <= gate * S
        if used[k]:
            K = P_predicted[k, :, 0] / S
            x[k] = x_predicted[k] + K * innovation
            P[k] = P_predicted[k] - np.outer(K, P_predicted[k, 0, :])
        else:
            x[k], P[k] = x_predicted[k], P_predicted[k]
    for k in range(n - 2, -1, -1):
        F[0, 1] = t[k + 1] - t[k]
        A = P_predicted[k + 1]
        det = A[0, 0] * A[1, 1] - A[0, 1] * A[1, 0]
        C = np.zeros((2, 2))
        if det > 1e-300:
            inverse = np.array([[A[1, 1], -A[0, 1]], [-A[1, 0], A[0, 0]]]) / det
            C = P[k] @ F.T @ inverse
        elif A[0, 0] > 0.0:  # no trend: a scalar random walk
            C[0, 0] = P[k, 0, 0] / A[0, 0]
        x[k] = x[k] + C @ (x[k + 1] - x_predicted[k + 1])
        P[k] = P[k] + C @ (P[k + 1] - A) @ C.T
    return x[:, 0].copy(), x[:, 1].copy(), P[:, 0, 0].copy(), used
