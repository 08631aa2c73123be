"""Compiled parts of the joint refinement: local shapes, and which echoes belong together."""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.series import BoolArray, IntArray

MOST_AROUND = 1000
"""Echoes around one that tell what surrounds it."""


@numba.njit(cache=True, error_model="numpy")
def carried_by_knots(
    knot_ne: Array,
    turn: Array,
    motion_knot_ne: Array,
    knot: IntArray,
    fraction: Array,
    motion_ne: Array,
    motion_yaw: Array,
    xy_b: Array,
    cov_b: Array,
) -> tuple[Array, Array, Array]:
    """Echoes in n by the poses of the two knots between which each is heard.

    Each of the two carries the motion's path to the echo along, turned by its own correction; the
    echo lies between the two by its fraction of the interval.

    Parameters
    ----------
    knot_ne, turn : ndarray, shapes (m, 2) and (m,)
        Where the knots lie, and by how much they are turned from the motion, rad.
    motion_knot_ne : ndarray, shape (m, 2)
        Where the motion has the knots.
    knot, fraction : ndarray, shape (k,)
        The knot before each echo, and the fraction of the interval to the next.
    motion_ne, motion_yaw : ndarray, shapes (k, 2) and (k,)
        Where the motion has the vehicle when each echo is heard.
    xy_b, cov_b : ndarray, shapes (k, 2) and (k, 2, 2)

    Returns
    -------
    xy, arms, cov : ndarray, shapes (k, 2), (k, 2, 2) and (k, 2, 2)
        Places, offsets from the two knots, and covariances.
    """
    n = len(knot)
    xy, arms, cov = np.zeros((n, 2)), np.empty((n, 2, 2)), np.empty((n, 2, 2))
    for e in range(n):
        f = fraction[e]
        first = knot[e]
        heading = motion_yaw[e] + (1.0 - f) * turn[first] + f * turn[first + 1]
        c, s = math.cos(heading), math.sin(heading)
        bx, by = c * xy_b[e, 0] - s * xy_b[e, 1], s * xy_b[e, 0] + c * xy_b[e, 1]
        for end in range(2):
            k, share = first + end, f if end == 1 else 1.0 - f
            px, py = motion_ne[e, 0] - motion_knot_ne[k, 0], motion_ne[e, 1] - motion_knot_ne[k, 1]
            ct, st = math.cos(turn[k]), math.sin(turn[k])
            arms[e, end, 0] = ct * px - st * py + bx
            arms[e, end, 1] = st * px + ct * py + by
            xy[e, 0] += share * (knot_ne[k, 0] + arms[e, end, 0])
            xy[e, 1] += share * (knot_ne[k, 1] + arms[e, end, 1])
        sxx, sxy, syy = cov_b[e, 0, 0], cov_b[e, 0, 1], cov_b[e, 1, 1]
        cov[e, 0, 0] = c * c * sxx - 2.0 * c * s * sxy + s * s * syy
        cov[e, 0, 1] = c * s * (sxx - syy) + (c * c - s * s) * sxy
        cov[e, 1, 0] = cov[e, 0, 1]
        cov[e, 1, 1] = s * s * sxx + 2.0 * c * s * sxy + c * c * syy
    return xy, arms, cov


class ByX(NamedTuple):
    """Echoes of each scan in the order of their north coordinate: neighbours lie in a window.

    Echo ``order[u]`` of scan s has ``scan_first[s] <= u < scan_first[s + 1]`` and lies at x, y.
    """

    order: IntArray
    x: Array
    y: Array
    scan_first: IntArray


def sorted_by_x(xy: Array, scan: IntArray, scan_first: IntArray) -> ByX:
    """Sort the echoes (k, 2) within their scans, which follow each other."""
    order = np.lexsort((xy[:, 0], scan))
    x, y = np.ascontiguousarray(xy[order].T)
    return ByX(order, x, y, scan_first)


@numba.njit(cache=True, error_model="numpy")
def local_lines(by_x: ByX, radius: float, max_thickness: float) -> tuple[Array, BoolArray]:
    """Normal of the wall at each echo, from its neighbours in the same scan.

    The line is fitted twice, the second time without neighbours far from the first (clutter,
    second echoes).

    Returns
    -------
    normal : ndarray, shape (k, 2)
    is_line : ndarray of bool, shape (k,)
        The echo is one of at least four neighbours on a line longer than three times its thickness.
    """
    order, x, y, scan_first = by_x
    n = len(order)
    normal, is_line = np.zeros((n, 2)), np.zeros(n, np.bool_)
    for s in range(len(scan_first) - 1):
        low = scan_first[s]
        for u in range(scan_first[s], scan_first[s + 1]):
            i = order[u]
            while x[low] < x[u] - radius:
                low += 1
            nx, ny, offset = 0.0, 0.0, 0.0
            keep_within = np.inf
            for _ in range(2):
                count, mx, my, sxx, sxy, syy = 0, 0.0, 0.0, 0.0, 0.0, 0.0
                for v in range(low, scan_first[s + 1]):
                    dx, dy = x[v] - x[u], y[v] - y[u]
                    if dx > radius:
                        break
                    near = dx * dx + dy * dy <= radius * radius
                    if near and abs(nx * dx + ny * dy - offset) <= keep_within:
                        count += 1
                        mx += dx
                        my += dy
                        sxx += dx * dx
                        sxy += dx * dy
                        syy += dy * dy
                if count < 4:
                    break
                mx, my = mx / count, my / count
                sxx, sxy, syy = sxx / count - mx * mx, sxy / count - mx * my, syy / count - my * my
                angle = 0.5 * math.atan2(2 * sxy, sxx - syy)
                nx, ny = -math.sin(angle), math.cos(angle)
                offset = nx * mx + ny * my
                keep_within = 2.0 * max_thickness
            if count < 4:
                continue
            half = 0.5 * (sxx + syy)
            root = math.sqrt(max(0.25 * (sxx - syy) ** 2 + sxy * sxy, 0.0))
            small, large = max(half - root, 0.0), half + root
            thin = small < max_thickness * max_thickness and large > 9.0 * small
            normal[i, 0], normal[i, 1] = nx, ny
            is_line[i] = thin and abs(offset) <= 2.0 * max_thickness
    return normal, is_line


class Grid(NamedTuple):
    """Points bucketed into square cells.

    Points ``order[first[c]:first[c + 1]]`` lie in cell ``c = cx * ny + cy``; each point's own
    cell is (cx, cy).
    """

    cx: IntArray
    cy: IntArray
    nx: int
    ny: int
    order: IntArray
    first: IntArray


def grid(xy: Array, cell: float) -> Grid:
    """Bucket points (k, 2); neighbours within ``cell`` lie in the same or an adjacent cell."""
    cx, cy = ((xy - xy.min(axis=0)) / cell).astype(np.int64).T
    nx, ny = int(cx.max()) + 1, int(cy.max()) + 1
    index = cx * ny + cy
    order = np.argsort(index, kind="stable")
    first = np.searchsorted(index[order], np.arange(nx * ny + 1))
    return Grid(np.ascontiguousarray(cx), np.ascontiguousarray(cy), nx, ny, order, first)


@numba.njit(cache=True, error_model="numpy")
def fixed_points(
    xy: Array, cells: Grid, normal: Array, is_line: BoolArray, radius: float
) -> BoolArray:
    """Echoes that fix a place in both directions: scatterers and corners, not stray wall echoes.

    Seen by all scans together, what surrounds an echo of a wall is mostly one wall; at a corner
    the walls differ in direction, and a scatterer stands alone. Shares tell it: where a mission saw
    the place very often, every second echo around is looked at, or third.
    """
    cx, cy, nx, ny, order, first = cells
    out = np.zeros(len(xy), np.bool_)
    for i in order:  # what lies beside each other is looked at together, while it is in the cache
        if is_line[i]:
            continue
        around = 0
        for ix in range(max(cx[i] - 1, 0), min(cx[i] + 2, nx)):
            row = ix * ny
            around += first[row + min(cy[i] + 2, ny)] - first[row + max(cy[i] - 1, 0)]
        every = 1 + around // MOST_AROUND
        total, lines, txx, txy, tyy = 0, 0, 0.0, 0.0, 0.0
        for ix in range(max(cx[i] - 1, 0), min(cx[i] + 2, nx)):
            for iy in range(max(cy[i] - 1, 0), min(cy[i] + 2, ny)):
                for m in range(first[ix * ny + iy], first[ix * ny + iy + 1], every):
                    j = order[m]
                    dx, dy = xy[j, 0] - xy[i, 0], xy[j, 1] - xy[i, 1]
                    if j == i or dx * dx + dy * dy > radius * radius:
                        continue
                    total += 1
                    if is_line[j]:
                        lines += 1
                        txx += normal[j, 0] * normal[j, 0]
                        txy += normal[j, 0] * normal[j, 1]
                        tyy += normal[j, 1] * normal[j, 1]
        root = math.sqrt(0.25 * (txx - tyy) ** 2 + txy * txy)
        smaller = 0.5 * (txx + tyy) - root
        out[i] = total > 0 and (2 * lines < total or smaller > 0.2 * lines)
    return out


@numba.njit(cache=True, error_model="numpy")
def partners(
    scans: IntArray,
    by_x: ByX,
    gate: float,
    normal: Array,
    is_line: BoolArray,
    eligible: BoolArray,
) -> tuple[IntArray, IntArray, IntArray]:
    """For each echo of two scans, the nearest of the other one within a gate.

    An echo on a wall pairs only with echoes on walls of like direction, another only with others,
    and only where the choice is mutual.

    Parameters
    ----------
    scans : ndarray of int, shape (p, 2)
        Pairs of scans.

    Returns
    -------
    i, j : ndarray of int, shape (m,)
        Pairs of echoes, scans' pair by scans' pair: first i of the one in order, then of the other.
    first : ndarray of int, shape (p + 1,)
        Where each pair of scans begins.
    """
    scan_first = by_x.scan_first
    seekers = _by_kind(by_x, normal, is_line, eligible)
    longest = np.max(scan_first[1:] - scan_first[:-1])
    nearest_a, nearest_b = np.empty(longest, np.int64), np.empty(longest, np.int64)
    first = np.zeros(len(scans) + 1, np.int64)
    out_i, out_j = np.empty(1024, np.int64), np.empty(1024, np.int64)
    count = 0
    for p in range(len(scans)):
        a, b = scans[p]
        a0, b0 = scan_first[a], scan_first[b]
        n_a, n_b = scan_first[a + 1] - a0, scan_first[b + 1] - b0
        nearest_a[:n_a], nearest_b[:n_b] = -1, -1
        for kind in range(2):
            _find_nearest(seekers, 2 * a + kind, 2 * b + kind, gate, nearest_a, a0)
            _find_nearest(seekers, 2 * b + kind, 2 * a + kind, gate, nearest_b, b0)
        if count + n_a + n_b > len(out_i):
            longer = 2 * len(out_i) + 2 * longest
            out_i, out_j = _lengthened(out_i, longer), _lengthened(out_j, longer)
        for k in range(n_a):
            j = nearest_a[k]
            if j >= 0 and (is_line[a0 + k] or nearest_b[j - b0] == a0 + k):
                out_i[count], out_j[count] = a0 + k, j
                count += 1
        for k in range(n_b):
            j = nearest_b[k]
            if j >= 0 and (is_line[b0 + k] or nearest_a[j - a0] == b0 + k):
                out_i[count], out_j[count] = b0 + k, j
                count += 1
        first[p + 1] = count
    return out_i[:count].copy(), out_j[:count].copy(), first


class _ByKind(NamedTuple):
    """Eligible echoes that may pair, side by side in the order of their north coordinate.

    Those of scan s on walls are ``first[2 s] <= u < first[2 s + 1]``, its others those up to
    ``first[2 s + 2]``; each has a place and its wall's normal.
    """

    echo: IntArray
    x: Array
    y: Array
    nx: Array
    ny: Array
    first: IntArray


@numba.njit(cache=True)
def _by_kind(by_x: ByX, normal: Array, is_line: BoolArray, eligible: BoolArray) -> _ByKind:
    order, x, y, scan_first = by_x
    n, n_scans = int(np.sum(eligible)), len(scan_first) - 1
    echo = np.empty(n, np.int64)
    out_x, out_y, nx, ny = np.empty(n), np.empty(n), np.zeros(n), np.zeros(n)
    first = np.zeros(2 * n_scans + 1, np.int64)
    count = 0
    for s in range(n_scans):
        for kind in range(2):
            for u in range(scan_first[s], scan_first[s + 1]):
                i = order[u]
                if eligible[i] and is_line[i] == (kind == 0):
                    echo[count], out_x[count], out_y[count] = i, x[u], y[u]
                    nx[count], ny[count] = normal[i]
                    count += 1
            first[2 * s + kind + 1] = count
    return _ByKind(echo, out_x, out_y, nx, ny, first)


@numba.njit(cache=True, error_model="numpy")
def _find_nearest(
    seekers: _ByKind, own: int, other: int, gate: float, nearest: IntArray, offset: int
) -> None:
    """Of each echo of one group the nearest of the other, sought from its own north coordinate to
    both sides, no further than the nearest so far."""
    echo, x, y, nx, ny, first = seekers
    begin, end = first[other], first[other + 1]
    walls = own % 2 == 0
    at = begin
    for u in range(first[own], first[own + 1]):
        while at < end and x[at] < x[u]:
            at += 1
        least, found = gate * gate, -1
        for step in (1, -1):
            v = at if step > 0 else at - 1
            while begin <= v < end:
                dx, dy = x[v] - x[u], y[v] - y[u]
                if dx * dx >= least:
                    break
                d2 = dx * dx + dy * dy
                if d2 < least and (not walls or abs(nx[u] * nx[v] + ny[u] * ny[v]) >= 0.9):
                    least, found = d2, v
                v += step
        if found >= 0:
            nearest[echo[u] - offset] = echo[found]


@numba.njit(cache=True)
def _lengthened(values: IntArray, length: int) -> IntArray:
    longer = np.empty(length, np.int64)
    longer[: len(values)] = values
    return longer


@numba.njit(cache=True)
def kept(keep: BoolArray, first: IntArray) -> IntArray:
    """Where each group begins once only some of its members are kept."""
    out = np.zeros(len(first), np.int64)
    for p in range(len(first) - 1):
        out[p + 1] = out[p] + np.sum(keep[first[p] : first[p + 1]])
    return out
