"""Compiled information of a match, for its covariance: ``pic.information_at`` in NumPy."""

from __future__ import annotations

import math

import numba
import numpy as np

from gtsam_nav.frames import Array

WALL_ELONGATION = 9.0
"""Surroundings whose variances differ by more than this factor are a wall."""
WALL_EXTENT = 2.0
"""And which are longer than the echoes' own noise makes them, by this factor in variance: the
bearing draws a pile out across its ray."""
WIDER = 3.0
"""Where the surroundings hold too few points to tell, they are this many times as wide: far along a
wall its echoes lie metres apart."""


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
        nearest, tx, ty, w, wxx, wxy, wyy, lxx, lxy, lyy = _weighed(
            xy_ref, cov_ref, xy_new[i], cov_new[i], q, c, s, radius, cauchy_k
        )
        if nearest < 0:
            continue
        _add(M, w * w, wxx, wxy, wyy, tx, ty)
        # what a wall's uncertain direction lends the information along it is not there
        _add(H, w, wxx - lxx, wxy - lxy, wyy - lyy, tx, ty)
    return H, M


@numba.njit(cache=True, error_model="numpy")
def pulls(
    xy_ref: Array,
    cov_ref: Array,
    xy_new: Array,
    cov_new: Array,
    q: Array,
    radius: float,
    cauchy_k: float,
    moved_ref: Array,
    moved_new: Array,
) -> tuple[Array, Array, Array]:
    """Hessian at a solution, and how its gradient (3, m) answers to points (k, 2, m) that are moved
    in m ways, of the reference and of the new scan."""
    H = np.zeros((3, 3))
    by_ref, by_new = np.zeros((3, moved_ref.shape[2])), np.zeros((3, moved_new.shape[2]))
    c, s = math.cos(q[2]), math.sin(q[2])
    for i in range(len(xy_new)):
        nearest, tx, ty, w, wxx, wxy, wyy, lxx, lxy, lyy = _weighed(
            xy_ref, cov_ref, xy_new[i], cov_new[i], q, c, s, radius, cauchy_k
        )
        if nearest < 0:
            continue
        _add(H, w, wxx - lxx, wxy - lxy, wyy - lyy, tx, ty)
        for k in range(moved_ref.shape[2]):
            dx, dy = moved_ref[nearest, 0, k], moved_ref[nearest, 1, k]
            _pull(by_ref, k, w * (wxx * dx + wxy * dy), w * (wxy * dx + wyy * dy), tx, ty)
        for k in range(moved_new.shape[2]):
            dx = s * moved_new[i, 1, k] - c * moved_new[i, 0, k]
            dy = -s * moved_new[i, 0, k] - c * moved_new[i, 1, k]
            _pull(by_new, k, w * (wxx * dx + wxy * dy), w * (wxy * dx + wyy * dy), tx, ty)
    return H, by_ref, by_new


@numba.njit(cache=True, error_model="numpy")
def _weighed(
    xy_ref: Array,
    cov_ref: Array,
    point: Array,
    cov_point: Array,
    q: Array,
    c: float,
    s: float,
    radius: float,
    cauchy_k: float,
) -> tuple[int, float, float, float, float, float, float, float, float, float]:
    """What a point tells at a pose, c and s being cosine and sine of its yaw: the nearest reference
    point, or -1; itself turned; the weight for its misfit; its information (xx, xy, yy); and what a
    wall's lean lends of it."""
    tx = c * point[0] - s * point[1]
    ty = s * point[0] + c * point[1]
    count, nearest, mx, my, vxx, vxy, vyy = _surroundings(xy_ref, q[0] + tx, q[1] + ty, radius)
    if count == 0:
        return -1, tx, ty, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if count < 3:
        count, nearest, mx, my, vxx, vxy, vyy = _surroundings(
            xy_ref, q[0] + tx, q[1] + ty, WIDER * radius
        )
    a, b, d = cov_point[0, 0], cov_point[0, 1], cov_point[1, 1]
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
    lxx, lxy, lyy = lent * ny * ny, -lent * nx * ny, lent * nx * nx
    return nearest, tx, ty, w, wxx, wxy, wyy, lxx, lxy, lyy


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
def _pull(pulled: Array, column: int, fx: float, fy: float, tx: float, ty: float) -> None:
    """Add ``J' f`` of a point whose turned coordinates are (tx, ty) to a column."""
    pulled[0, column] += fx
    pulled[1, column] += fy
    pulled[2, column] += tx * fy - ty * fx
