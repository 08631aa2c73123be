"""Compiled parts of the joint refinement: residuals of paired echoes and their normal equations."""

from __future__ import annotations

import math

import numba
import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.series import BoolArray, IntArray


@numba.njit(cache=True, error_model="numpy")
def squared_residuals(
    i: IntArray, j: IntArray, xy: Array, cov: Array, normal: Array, is_line: BoolArray
) -> Array:
    """Squared normalised residual of each pair: across the wall, or in the plane (halved)."""
    out = np.empty(len(i))
    for m in range(len(i)):
        a, b = i[m], j[m]
        ex, ey = xy[a, 0] - xy[b, 0], xy[a, 1] - xy[b, 1]
        sxx, sxy = cov[a, 0, 0] + cov[b, 0, 0], cov[a, 0, 1] + cov[b, 0, 1]
        syy = cov[a, 1, 1] + cov[b, 1, 1]
        if is_line[b]:
            nx, ny = normal[b, 0], normal[b, 1]
            r = nx * ex + ny * ey
            out[m] = r * r / (nx * nx * sxx + 2 * nx * ny * sxy + ny * ny * syy)
        else:
            det = sxx * syy - sxy * sxy
            out[m] = 0.5 * (syy * ex * ex - 2 * sxy * ex * ey + sxx * ey * ey) / det
    return out


@numba.njit(cache=True, error_model="numpy")
def outward_residuals(i: IntArray, j: IntArray, xy: Array, vehicle: Array, normal: Array) -> Array:
    """Of echoes i on the walls of j: how far they lie beyond these, seen from where i was heard.

    Parameters
    ----------
    xy, vehicle, normal : ndarray, shape (k, 2)
        Of each echo: its place, the vehicle's, and the normal of its wall.
    """
    out = np.empty(len(i))
    for m in range(len(i)):
        a, b = i[m], j[m]
        nx, ny = normal[b, 0], normal[b, 1]
        out[m] = nx * (xy[a, 0] - xy[b, 0]) + ny * (xy[a, 1] - xy[b, 1])
        if nx * (xy[a, 0] - vehicle[a, 0]) + ny * (xy[a, 1] - vehicle[a, 1]) < 0.0:
            out[m] = -out[m]
    return out


@numba.njit(cache=True, error_model="numpy")
def correlation_excess(
    residual: Array, normal: Array, echo: IntArray, run: IntArray, clip: float, max_lag: int
) -> float:
    """How many times more the mean of a run of residuals varies than if they were independent.

    ``1 + 2 sum rho_k``, the integrated autocorrelation over residuals that follow each other in a
    run and lie on walls of one direction; lags weigh by how often they occur.

    Parameters
    ----------
    residual : ndarray, shape (m,)
        Run by run, in each in the order of its echoes.
    normal : ndarray, shape (k, 2)
        Of all echoes.
    echo, run : ndarray of int, shape (m,)
        Of each residual.
    clip : float
        Residuals count no further than this.
    """
    variance = 0.0
    clipped = np.empty(len(residual))
    for m in range(len(clipped)):
        clipped[m] = min(max(residual[m], -clip), clip)
        variance += clipped[m] * clipped[m]
    if variance <= 0.0:
        return 1.0
    totals = np.zeros(max_lag)
    for m in range(len(clipped)):
        nx, ny = normal[echo[m], 0], normal[echo[m], 1]
        for lag in range(1, min(max_lag, len(clipped) - 1 - m) + 1):
            if run[m] != run[m + lag]:
                break
            along = nx * normal[echo[m + lag], 0] + ny * normal[echo[m + lag], 1]
            if abs(along) > 0.95:
                totals[lag - 1] += clipped[m] * clipped[m + lag]
    excess = 1.0
    for total in totals:
        excess += 2.0 * max(total / variance, 0.0)
    return excess


@numba.njit(cache=True, error_model="numpy")
def accumulate(
    i: IntArray,
    j: IntArray,
    first: IntArray,
    between: IntArray,
    n_between: int,
    interval: IntArray,
    xy: Array,
    arms: Array,
    cov: Array,
    normal: Array,
    is_line: BoolArray,
    fraction: Array,
    weight: Array,
) -> tuple[Array, Array, Array]:
    """Normal equations of all pairs of echoes.

    A residual ``u . (x_i - x_j)`` changes with the shift and turn (x, y, turn) of its two echoes by
    (u, 0) and (-u, t): the direction u turns with echo j, so that turning everything together costs
    nothing. What an echo's pairs tell about its own motion is summed before it is expressed in the
    knots (see `moved_by_knots`).

    Parameters
    ----------
    first : ndarray of int, shape (p + 1,)
        Where the pairs of each two scans begin.
    between : ndarray of int, shape (p, 4)
        Of these scans a and b: the first interval of a, the first of b, how many b has, and where
        the blocks of their intervals begin.
    n_between : int
        Number of these blocks.
    interval : ndarray of int, shape (k,)
        Of each echo.

    Returns
    -------
    across : ndarray, shape (n_between, 6, 6)
        Between the knots of an interval of a and those of an interval of b.
    own : ndarray, shape (k, 3, 3)
        Of each echo's own motion.
    g : ndarray, shape (k, 3)
        The step solves ``A step = g``.
    """
    across = np.zeros((n_between, 6, 6))
    own, g = np.zeros((len(xy), 3, 3)), np.zeros((len(xy), 3))
    row_i, row_j = np.empty(6), np.empty(6)
    for p in range(len(first) - 1):
        interval_a, interval_b, n_b, begin = between[p]
        for m in range(first[p], first[p + 1]):
            e, f = i[m], j[m]
            ex, ey = xy[e, 0] - xy[f, 0], xy[e, 1] - xy[f, 1]
            sxx, sxy = cov[e, 0, 0] + cov[f, 0, 0], cov[e, 0, 1] + cov[f, 0, 1]
            syy = cov[e, 1, 1] + cov[f, 1, 1]
            if is_line[f]:
                ux, uy, times = normal[f, 0], normal[f, 1], 1
            else:
                # two independent rows along the eigenvectors of the covariance
                angle = 0.5 * math.atan2(2 * sxy, sxx - syy)
                ux, uy, times = math.cos(angle), math.sin(angle), 2
            if e < f:
                block = across[begin + (interval[e] - interval_a) * n_b + interval[f] - interval_b]
            else:
                block = across[begin + (interval[f] - interval_a) * n_b + interval[e] - interval_b]
            for _ in range(times):
                w = weight[m] / (ux * ux * sxx + 2 * ux * uy * sxy + uy * uy * syy)
                turn = ux * ey - uy * ex
                residual = w * (ux * ex + uy * ey)
                _add_own(own[e], g[e], ux, uy, 0.0, w, residual)
                _add_own(own[f], g[f], -ux, -uy, turn, w, residual)
                _moved_by_knots(row_i, arms[e], fraction[e], ux, uy, 0.0)
                _moved_by_knots(row_j, arms[f], fraction[f], -ux, -uy, turn)
                if e < f:
                    for c in range(6):
                        for d in range(6):
                            block[c, d] += w * row_i[c] * row_j[d]
                else:
                    for c in range(6):
                        for d in range(6):
                            block[c, d] += w * row_j[c] * row_i[d]
                ux, uy = -uy, ux
    return across, own, g


@numba.njit(cache=True, error_model="numpy")
def _add_own(
    own: Array, g: Array, qx: float, qy: float, qt: float, w: float, residual: float
) -> None:
    """Add a residual's part in its own echo's motion; ``residual`` is weighed already."""
    own[0, 0] += w * qx * qx
    own[0, 1] += w * qx * qy
    own[0, 2] += w * qx * qt
    own[1, 1] += w * qy * qy
    own[1, 2] += w * qy * qt
    own[2, 2] += w * qt * qt
    g[0] -= residual * qx
    g[1] -= residual * qy
    g[2] -= residual * qt


@numba.njit(cache=True, error_model="numpy")
def _moved_by_knots(
    row: Array, arm: Array, fraction: float, qx: float, qy: float, qt: float
) -> None:
    """A derivative in an echo's motion as one in its two knots.

    An echo at ``fraction`` f of its interval moves by ``(1 - f) d_k + f d_(k+1)`` of what its two
    knots make of it: a knot's shift (dn, de), and its turn dyaw about the knot itself, of which
    ``arm`` (2, 2) are the echo's offsets.
    """
    for end in range(2):
        f = fraction if end == 1 else 1.0 - fraction
        row[3 * end] = f * qx
        row[3 * end + 1] = f * qy
        row[3 * end + 2] = f * (arm[end, 0] * qy - arm[end, 1] * qx + qt)


@numba.njit(cache=True, error_model="numpy")
def own_by_interval(
    own: Array, g: Array, interval: IntArray, n_intervals: int, arms: Array, fraction: Array
) -> tuple[Array, Array]:
    """Echoes' own parts from `accumulate`, summed over the knots of their intervals.

    Returns
    -------
    blocks, gradients : ndarray, shapes (n_intervals, 6, 6) and (n_intervals, 6)
    """
    blocks, gradients = np.zeros((n_intervals, 6, 6)), np.zeros((n_intervals, 6))
    K, HK = np.zeros((3, 6)), np.empty((3, 6))
    axis = np.eye(3)
    for e in range(len(own)):
        if own[e, 0, 0] + own[e, 1, 1] == 0.0:
            continue
        for c in range(3):
            _moved_by_knots(K[c], arms[e], fraction[e], axis[c, 0], axis[c, 1], axis[c, 2])
        block, gradient, H = blocks[interval[e]], gradients[interval[e]], own[e]
        for c in range(6):
            HK[0, c] = H[0, 0] * K[0, c] + H[0, 1] * K[1, c] + H[0, 2] * K[2, c]
            HK[1, c] = H[0, 1] * K[0, c] + H[1, 1] * K[1, c] + H[1, 2] * K[2, c]
            HK[2, c] = H[0, 2] * K[0, c] + H[1, 2] * K[1, c] + H[2, 2] * K[2, c]
            gradient[c] += g[e, 0] * K[0, c] + g[e, 1] * K[1, c] + g[e, 2] * K[2, c]
        for c in range(6):
            for d in range(6):
                block[c, d] += K[0, c] * HK[0, d] + K[1, c] * HK[1, d] + K[2, c] * HK[2, d]
    return blocks, gradients
