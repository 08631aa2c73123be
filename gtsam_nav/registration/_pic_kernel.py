"""Compiled loop of pIC; ``pic.register_readable`` says the same in NumPy."""

from __future__ import annotations

import math

import numba
import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.registration._pic_partners import (
    columns,
    mean_partner,
    nearest_partner,
    strips,
    window,
)
from gtsam_nav.series import IntArray

WALL_ELONGATION = 9.0
"""Surroundings whose variances differ by more than this factor are a wall."""
WALL_EXTENT = 2.0
"""And which are longer than the echoes' own noise makes them, by this factor in variance: the
bearing draws a pile out across its ray."""
WIDER = 3.0
"""Where the surroundings hold too few points to tell, they are this many times as wide: far along a
wall its echoes lie metres apart."""


@numba.njit(cache=True, error_model="numpy")
def iterate(
    xy_ref: Array,
    cov_ref: Array,
    xy_new: Array,
    cov_new: Array,
    prior: Array,
    cov_prior: Array,
    gate: float,
    max_iterations: int,
    shrink: float,
    scale_floor: float,
    cauchy_k: float,
    nearest: bool,
    converged_m: float,
    converged_rad: float,
) -> tuple[Array, int, int]:
    """Associate and solve until the pose settles.

    Returns
    -------
    q : ndarray, shape (3,)
    paired : int
        Points with a partner in the last iteration.
    iterations : int
    """
    order = np.argsort(xy_ref[:, 0])
    ref, new = columns(xy_ref[order], cov_ref[order]), columns(xy_new, cov_new)
    first, width = strips(ref[0])
    q = prior.copy()
    H, g = np.zeros((3, 3)), np.zeros(3)
    scale, paired, iteration = 1.0, 0, 0
    for _ in range(max_iterations):
        iteration += 1
        H[:], g[:] = 0.0, 0.0
        P = cov_prior * scale
        paired = _accumulate(ref, first, width, new, q, P, gate, cauchy_k, nearest, H, g)
        step, solvable = _solve3(H, g)
        if not solvable:
            break
        q[0] += step[0]
        q[1] += step[1]
        q[2] = (q[2] + step[2] + math.pi) % (2 * math.pi) - math.pi
        settled = math.hypot(step[0], step[1]) < converged_m and abs(step[2]) < converged_rad
        if settled and scale <= scale_floor:
            break
        scale = max(scale * shrink, scale_floor)
    return q, paired, iteration


@numba.njit(cache=True, error_model="numpy")
def _accumulate(
    ref: Array,
    first: IntArray,
    width: float,
    new: Array,
    q: Array,
    P: Array,
    gate: float,
    cauchy_k: float,
    nearest: bool,
    H: Array,
    g: Array,
) -> int:
    """Add every paired point to the normal equations; returns how many there are.

    Points are `columns`, and the first of the reference's in each strip of a width is given.
    """
    c, s = math.cos(q[2]), math.sin(q[2])
    widest = np.max(ref[2])
    paired = 0
    for i in range(new.shape[1]):
        tx = c * new[0, i] - s * new[1, i]
        ty = s * new[0, i] + c * new[1, i]
        px, py = q[0] + tx, q[1] + ty
        a, b, d = new[2, i], new[3, i], new[4, i]
        cxx = c * c * a - 2 * c * s * b + s * s * d
        cxy = c * s * (a - d) + (c * c - s * s) * b
        cyy = s * s * a + 2 * c * s * b + c * c * d
        # J P J' with J = [I, (-ty, tx)]
        gxx = cxx + P[0, 0] - 2 * ty * P[0, 2] + ty * ty * P[2, 2]
        gyy = cyy + P[1, 1] + 2 * tx * P[1, 2] + tx * tx * P[2, 2]
        gxy = cxy + P[0, 1] + tx * P[0, 2] - ty * P[1, 2] - tx * ty * P[2, 2]
        # the Mahalanobis distance is at least |e_x| / sqrt(s_xx)
        m, n = window(ref, first, width, px, math.sqrt(gate * (gxx + widest)))
        near = ref[0, m:n], ref[1, m:n], ref[2, m:n], ref[3, m:n], ref[4, m:n]
        if nearest:
            sums = nearest_partner(*near, px, py, gxx, gxy, gyy, gate)
        else:
            sums = mean_partner(*near, px, py, gxx, gxy, gyy, gate)
        sw, mx, my, vxx, vxy, vyy = sums
        if sw <= 0.0:
            continue
        paired += 1
        ex, ey = mx / sw, my / sw
        exx = vxx / sw - ex * ex + cxx
        exy = vxy / sw - ex * ey + cxy
        eyy = vyy / sw - ey * ey + cyy
        det = exx * eyy - exy * exy
        wxx, wxy, wyy = eyy / det, -exy / det, exx / det
        d2 = wxx * ex * ex + 2 * wxy * ex * ey + wyy * ey * ey
        w = 1.0 / (1.0 + d2 / (cauchy_k * cauchy_k))
        # rows of J' W
        r2x, r2y = -ty * wxx + tx * wxy, -ty * wxy + tx * wyy
        _add(H, w, wxx, wxy, wyy, tx, ty)
        g[0] += w * (wxx * ex + wxy * ey)
        g[1] += w * (wxy * ex + wyy * ey)
        g[2] += w * (r2x * ex + r2y * ey)
    return paired


@numba.njit(cache=True, error_model="numpy")
def _add(H: Array, weight: float, wxx: float, wxy: float, wyy: float, tx: float, ty: float) -> None:
    """Add ``weight J' W J`` of a point whose turned coordinates are (tx, ty)."""
    r2x, r2y = -ty * wxx + tx * wxy, -ty * wxy + tx * wyy
    H[0, 0] += weight * wxx
    H[0, 1] += weight * wxy
    H[1, 0] += weight * wxy
    H[1, 1] += weight * wyy
    H[0, 2] += weight * r2x
    H[2, 0] += weight * r2x
    H[1, 2] += weight * r2y
    H[2, 1] += weight * r2y
    H[2, 2] += weight * (-ty * r2x + tx * r2y)


@numba.njit(cache=True, error_model="numpy")
def information(
    xy_ref: Array,
    cov_ref: Array,
    xy_new: Array,
    cov_new: Array,
    q: Array,
    radius: float,
    cauchy_k: float,
) -> tuple[Array, Array]:
    """Hessian and its noise-driven twin at a solution: ``pic.information_at``, compiled."""
    H, M = np.zeros((3, 3)), np.zeros((3, 3))
    c, s = math.cos(q[2]), math.sin(q[2])
    for i in range(len(xy_new)):
        tx = c * xy_new[i, 0] - s * xy_new[i, 1]
        ty = s * xy_new[i, 0] + c * xy_new[i, 1]
        count, nearest, mx, my, vxx, vxy, vyy = _surroundings(xy_ref, q[0] + tx, q[1] + ty, radius)
        if count == 0:
            continue
        if count < 3:
            count, nearest, mx, my, vxx, vxy, vyy = _surroundings(
                xy_ref, q[0] + tx, q[1] + ty, WIDER * radius
            )
        a, b, d = cov_new[i, 0, 0], cov_new[i, 0, 1], cov_new[i, 1, 1]
        sxx = c * c * a - 2 * c * s * b + s * s * d + cov_ref[nearest, 0, 0]
        sxy = c * s * (a - d) + (c * c - s * s) * b + cov_ref[nearest, 0, 1]
        syy = s * s * a + 2 * c * s * b + c * c * d + cov_ref[nearest, 1, 1]
        half, root = 0.5 * (vxx + vyy), math.sqrt(0.25 * (vxx - vyy) ** 2 + vxy * vxy)
        angle = 0.5 * math.atan2(2 * vxy, vxx - vyy)
        nx, ny = -math.sin(angle), math.cos(angle)
        noise2 = nx * nx * sxx + 2 * nx * ny * sxy + ny * ny * syy
        drawn_out2 = sxx + syy - noise2
        is_long = half + root > WALL_EXTENT * drawn_out2
        if is_long and half + root > WALL_ELONGATION * max(half - root, 0.0):
            precision = 1.0 / noise2
            wxx, wxy, wyy = nx * nx * precision, nx * ny * precision, ny * ny * precision
            ex, ey = mx, my
            lent = precision * max(half - root, noise2) / (count * (half + root))
        else:
            det = sxx * syy - sxy * sxy
            wxx, wxy, wyy = syy / det, -sxy / det, sxx / det
            ex, ey = xy_ref[nearest, 0] - q[0] - tx, xy_ref[nearest, 1] - q[1] - ty
            lent = 0.0
        d2 = wxx * ex * ex + 2 * wxy * ex * ey + wyy * ey * ey
        w = 1.0 / (1.0 + d2 / (cauchy_k * cauchy_k))
        _add(M, w * w, wxx, wxy, wyy, tx, ty)
        # what a wall's uncertain direction lends the information along it is not there
        wxx, wxy, wyy = wxx - lent * ny * ny, wxy + lent * nx * ny, wyy - lent * nx * nx
        _add(H, w, wxx, wxy, wyy, tx, ty)
    return H, M


@numba.njit(cache=True, error_model="numpy")
def _surroundings(
    xy_ref: Array, x: float, y: float, radius: float
) -> tuple[int, int, float, float, float, float, float]:
    """Number of points around a place, the nearest one, their mean offset and its scatter."""
    count, nearest, least = 0, -1, radius * radius
    mx = my = vxx = vxy = vyy = 0.0
    for j in range(len(xy_ref)):
        ex, ey = xy_ref[j, 0] - x, xy_ref[j, 1] - y
        d2 = ex * ex + ey * ey
        if d2 >= radius * radius:
            continue
        if d2 < least or nearest < 0:
            least, nearest = d2, j
        count += 1
        mx += ex
        my += ey
        vxx += ex * ex
        vxy += ex * ey
        vyy += ey * ey
    if count > 0:
        mx, my = mx / count, my / count
        vxx, vxy, vyy = vxx / count - mx * mx, vxy / count - mx * my, vyy / count - my * my
    return count, nearest, mx, my, vxx, vxy, vyy


@numba.njit(cache=True, error_model="numpy")
def _solve3(H: Array, g: Array) -> tuple[Array, bool]:
    """Solve a symmetric 3 x 3 system by cofactors; False where it is singular."""
    c00 = H[1, 1] * H[2, 2] - H[1, 2] * H[1, 2]
    c01 = H[0, 2] * H[1, 2] - H[0, 1] * H[2, 2]
    c02 = H[0, 1] * H[1, 2] - H[0, 2] * H[1, 1]
    det = H[0, 0] * c00 + H[0, 1] * c01 + H[0, 2] * c02
    x = np.zeros(3)
    if not det > 0.0:
        return x, False
    c11 = H[0, 0] * H[2, 2] - H[0, 2] * H[0, 2]
    c12 = H[0, 1] * H[0, 2] - H[0, 0] * H[1, 2]
    c22 = H[0, 0] * H[1, 1] - H[0, 1] * H[0, 1]
    x[0] = (c00 * g[0] + c01 * g[1] + c02 * g[2]) / det
    x[1] = (c01 * g[0] + c11 * g[1] + c12 * g[2]) / det
    x[2] = (c02 * g[0] + c12 * g[1] + c22 * g[2]) / det
    return x, True
