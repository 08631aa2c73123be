"""Compiled Rauch-Tung-Striebel smoother of a scalar signal with a local trend.

The two-state products are written out: matrix operators would make the first call compile for
twenty seconds.
"""

from __future__ import annotations

import numba
import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.series import BoolArray


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
    # level a, trend b and their covariance, filtered and (_p) predicted
    a, b, aa, ab, bb = np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    a_p, aa_p, ab_p, bb_p = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    used = np.ones(n, np.bool_)
    a[0], b[0], aa[0], ab[0], bb[0] = z[0], 0.0, variance[0], 0.0, trend_variance
    for k in range(1, n):
        i, dt = k - 1, t[k] - t[k - 1]
        a_p[k] = a[i] + dt * b[i]
        aa_p[k] = aa[i] + dt * (2 * ab[i] + dt * bb[i] + level_density + trend_density * dt**2 / 3)
        ab_p[k] = ab[i] + dt * (bb[i] + trend_density * dt / 2)
        bb_p[k] = bb[i] + dt * trend_density
        innovation, S = z[k] - a_p[k], aa_p[k] + variance[k]
        used[k] = innovation * innovation <= gate * S
        gain_a = aa_p[k] / S if used[k] else 0.0
        gain_b = ab_p[k] / S if used[k] else 0.0
        a[k], b[k] = a_p[k] + gain_a * innovation, b[i] + gain_b * innovation
        aa[k], ab[k] = (1 - gain_a) * aa_p[k], (1 - gain_a) * ab_p[k]
        bb[k] = bb_p[k] - gain_b * ab_p[k]
    for k in range(n - 2, -1, -1):
        j, dt = k + 1, t[k + 1] - t[k]
        det = aa_p[j] * bb_p[j] - ab_p[j] * ab_p[j]
        if det > 1e-300:
            # C = P F' P_predicted^-1
            u, v = aa[k] + dt * ab[k], ab[k] + dt * bb[k]
            c_aa = (u * bb_p[j] - ab[k] * ab_p[j]) / det
            c_ab = (ab[k] * aa_p[j] - u * ab_p[j]) / det
            c_ba = (v * bb_p[j] - bb[k] * ab_p[j]) / det
            c_bb = (bb[k] * aa_p[j] - v * ab_p[j]) / det
        else:  # no trend: a scalar random walk
            c_aa, c_ab, c_ba, c_bb = aa[k] / aa_p[j], 0.0, 0.0, 0.0
        da, db = a[j] - a_p[j], b[j] - b[k]
        daa, dab, dbb = aa[j] - aa_p[j], ab[j] - ab_p[j], bb[j] - bb_p[j]
        a[k] += c_aa * da + c_ab * db
        b[k] += c_ba * da + c_bb * db
        left, right = c_aa * daa + c_ab * dab, c_aa * dab + c_ab * dbb
        aa[k] += left * c_aa + right * c_ab
        ab[k] += left * c_ba + right * c_bb
        left, right = c_ba * daa + c_bb * dab, c_ba * dab + c_bb * dbb
        bb[k] += left * c_ba + right * c_bb
    return a, b, aa, used
