"""Compiled loop of pIC; ``pic.register_readable`` says the same in NumPy.

Points are columns x, y, s_xx, s_xy, s_yy of one array, shape (5, n); those of the reference are
sorted by x. A partner is told by sums over the reference points that are compatible with a point:
of weights w, of w e with e the way to them, and of w (their covariance + e e'); in this order w, x,
y, xx, xy, yy.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.series import IntArray

LANES = 16
"""Windows hold whole multiples of so many points: a loop's rest outside the processor's vectors
costs more than the points that this adds."""
REORDER = {"reassoc", "contract", "nsz", "arcp"}
"""Sums may be taken in another order, without which no loop is compiled to vectors: their last bits
are those of the processor's kind. Unlike with all of fast math, what is not a number stays so."""

Sums = tuple[float, float, float, float, float, float]


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
    gate_in_steps: float,
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
    ref, new = _columns(xy_ref[order], cov_ref[order]), _columns(xy_new, cov_new)
    first, width = _strips(ref[0])
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
        # the gate stays as wide as the pose still moves
        whitened, _ = _solve3(cov_prior, step)
        moved = gate_in_steps * gate_in_steps * np.dot(step, whitened)
        scale = max(min(scale, max(scale * shrink, moved)), scale_floor)
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

    Of the Hessian its upper triangle. ``first`` and ``width`` are the reference's `_strips`.
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
        m, n = _window(ref, first, width, px, math.sqrt(gate * (gxx + widest)))
        near = ref[0, m:n], ref[1, m:n], ref[2, m:n], ref[3, m:n], ref[4, m:n]
        if nearest:
            sums = _nearest_partner(*near, px, py, gxx, gxy, gyy, gate)
        else:
            sums = _mean_partner(*near, px, py, gxx, gxy, gyy, gate)
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
        H[0, 0] += w * wxx
        H[0, 1] += w * wxy
        H[1, 1] += w * wyy
        H[0, 2] += w * r2x
        H[1, 2] += w * r2y
        H[2, 2] += w * (tx * r2y - ty * r2x)
        g[0] += w * (wxx * ex + wxy * ey)
        g[1] += w * (wxy * ex + wyy * ey)
        g[2] += w * (r2x * ex + r2y * ey)
    return paired


@numba.njit(cache=True, error_model="numpy")
def _columns(xy: Array, cov: Array) -> Array:
    """Points (n, 2) and their covariances (n, 2, 2) as columns, shape (5, n)."""
    found = np.empty((5, len(xy)))
    for i in range(len(xy)):
        found[0, i], found[1, i] = xy[i, 0], xy[i, 1]
        found[2, i], found[3, i], found[4, i] = cov[i, 0, 0], cov[i, 0, 1], cov[i, 1, 1]
    return found


@numba.njit(cache=True, error_model="numpy")
def _strips(x: Array) -> tuple[IntArray, float]:
    """First of the rising x in each of as many equally wide strips, and their width.

    The last entry, of a strip behind the last point, is their number.
    """
    n = len(x)
    width = max((x[-1] - x[0]) / n, 1e-9)
    first, j = np.empty(n + 1, np.int64), 0
    for k in range(n):
        while j < n and x[j] < x[0] + k * width:
            j += 1
        first[k] = j
    first[n] = n
    return first, width


@numba.njit(cache=True, error_model="numpy")
def _window(ref: Array, first: IntArray, width: float, x: float, reach: float) -> tuple[int, int]:
    """Range of the points whose x is within reach; it may hold some more."""
    n = len(first) - 1
    begin = first[_strip((x - reach - ref[0, 0]) / width, n)]
    end = first[_strip((x + reach - ref[0, 0]) / width + 1.0, n)]
    count = min((end - begin + LANES - 1) // LANES * LANES, n)
    begin = min(begin, n - count)
    return begin, begin + count


@numba.njit(cache=True, error_model="numpy")
def _strip(position: float, n: int) -> int:
    """The strip at a position, the first or last one beyond; the first where there is none."""
    if position >= n:
        return n
    return int(position) if position > 0.0 else 0


@numba.njit(cache=True, error_model="numpy", fastmath=REORDER)
def _mean_partner(
    x: Array,
    y: Array,
    rxx: Array,
    rxy: Array,
    ryy: Array,
    px: float,
    py: float,
    gxx: float,
    gxy: float,
    gyy: float,
    gate: float,
) -> Sums:
    """Sums over all points within the gate, weighted by how likely each is the same.

    (px, py) is the new point, (gxx, gxy, gyy) the covariance of its place.
    """
    w_sum = mx = my = vxx = vxy = vyy = 0.0
    for j in range(len(x)):
        ex, ey = x[j] - px, y[j] - py
        sxx, sxy, syy = gxx + rxx[j], gxy + rxy[j], gyy + ryy[j]
        inverse = 1.0 / (sxx * syy - sxy * sxy)
        d2 = (syy * ex * ex - 2 * sxy * ex * ey + sxx * ey * ey) * inverse
        w = _decay(d2) * math.sqrt(inverse) if d2 < gate else 0.0
        wx, wy = w * ex, w * ey
        w_sum += w
        mx += wx
        my += wy
        vxx += w * rxx[j] + wx * ex
        vxy += w * rxy[j] + wx * ey
        vyy += w * ryy[j] + wy * ey
    return w_sum, mx, my, vxx, vxy, vyy


@numba.njit(cache=True, error_model="numpy", inline="always")
def _decay(d2: float) -> float:
    """``exp(-d2 / 2)``, to 3e-10 of itself for d2 below 10, in what is compiled to vectors.

    By the series of its inverse, whose terms are all positive: it never grows, however large d2 is.
    """
    t = d2 / 64.0
    growth = 1 + t / 5 * (1 + t / 6 * (1 + t / 7))
    growth = 1 + t * (1 + t / 2 * (1 + t / 3 * (1 + t / 4 * growth)))
    for _ in range(5):
        growth *= growth
    return 1.0 / growth


@numba.njit(cache=True, error_model="numpy")
def _nearest_partner(
    x: Array,
    y: Array,
    rxx: Array,
    rxy: Array,
    ryy: Array,
    px: float,
    py: float,
    gxx: float,
    gxy: float,
    gyy: float,
    gate: float,
) -> Sums:
    """`_mean_partner` of one point: the nearest within the gate, with weight one."""
    best, nearest = gate, -1
    for j in range(len(x)):
        ex, ey = x[j] - px, y[j] - py
        sxx, sxy, syy = gxx + rxx[j], gxy + rxy[j], gyy + ryy[j]
        d2 = (syy * ex * ex - 2 * sxy * ex * ey + sxx * ey * ey) / (sxx * syy - sxy * sxy)
        if d2 < best:
            best, nearest = d2, j
    if nearest < 0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    ex, ey = x[nearest] - px, y[nearest] - py
    vxx, vxy = rxx[nearest] + ex * ex, rxy[nearest] + ex * ey
    return 1.0, ex, ey, vxx, vxy, ryy[nearest] + ey * ey


@numba.njit(cache=True, error_model="numpy")
def _solve3(H: Array, g: Array) -> tuple[Array, bool]:
    """Solve a symmetric 3 x 3 system, given its upper triangle, by cofactors; False where it is
    singular."""
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
