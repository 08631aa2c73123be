"""Compiled search of a point's partner among the reference points, for pIC.

Reference points are columns x, y, s_xx, s_xy, s_yy of one array, shape (5, n), sorted by x. A
partner is told by sums over the points that are compatible with the new one: of weights w, of
w e with e the way to them, and of w (their covariance + e e'), that is w, x, y, xx, xy, yy.
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
"""Sums may be taken in another order, without which no loop is compiled to vectors; unlike with
all of fast math, what is not a number stays so."""

Sums = tuple[float, float, float, float, float, float]


@numba.njit(cache=True, error_model="numpy")
def columns(xy: Array, cov: Array) -> Array:
    """Points (n, 2) and their covariances (n, 2, 2) as columns, shape (5, n)."""
    found = np.empty((5, len(xy)))
    for i in range(len(xy)):
        found[0, i], found[1, i] = xy[i, 0], xy[i, 1]
        found[2, i], found[3, i], found[4, i] = cov[i, 0, 0], cov[i, 0, 1], cov[i, 1, 1]
    return found


@numba.njit(cache=True, error_model="numpy")
def strips(x: Array) -> tuple[IntArray, float]:
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
def window(ref: Array, first: IntArray, width: float, x: float, reach: float) -> tuple[int, int]:
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
def mean_partner(
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

    (px, py) is the new point, (gxx, gxy, gyy) the covariance of its place. No branch: the loop is
    compiled to vectors.
    """
    w_sum = mx = my = vxx = vxy = vyy = 0.0
    for j in range(len(x)):
        ex, ey = x[j] - px, y[j] - py
        sxx, sxy, syy = gxx + rxx[j], gxy + rxy[j], gyy + ryy[j]
        inverse = 1.0 / (sxx * syy - sxy * sxy)
        d2 = (syy * ex * ex - 2 * sxy * ex * ey + sxx * ey * ey) * inverse
        w = (d2 < gate) * _decay(d2) * math.sqrt(inverse)
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
    """``exp(-d2 / 2)`` to 1e-8 for d2 below 10, by a series that is compiled to vectors.

    A series of the growth, whose terms are all positive: the decay stays one however large d2 is.
    """
    t = d2 / 32.0
    growth = 1 + t / 5 * (1 + t / 6 * (1 + t / 7))
    growth = 1 + t * (1 + t / 2 * (1 + t / 3 * (1 + t / 4 * growth)))
    growth *= growth
    growth *= growth
    growth *= growth
    return 1.0 / (growth * growth)


@numba.njit(cache=True, error_model="numpy")
def nearest_partner(
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
    """Sums over the nearest point within the gate, with weight one: `mean_partner` of one point."""
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
