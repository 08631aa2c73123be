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
        Pairs of echoes, scans' pair by scans' pair.
    first : ndarray of int, shape (p + 1,)
        Where each pair of scans begins.
    """
    order, x, y, scan_first = by_x
    longest = np.max(scan_first[1:] - scan_first[:-1])
    best = np.empty((2, longest), np.int64)
    best_d2 = np.empty((2, longest))
    first = np.zeros(len(scans) + 1, np.int64)
    out_i, out_j = np.empty(1024, np.int64), np.empty(1024, np.int64)
    count = 0
    for p in range(len(scans)):
        a0, a1 = scan_first[scans[p, 0]], scan_first[scans[p, 0] + 1]
        b0, b1 = scan_first[scans[p, 1]], scan_first[scans[p, 1] + 1]
        best[:] = -1
        best_d2[:] = gate * gate
        low = b0
        for u in range(a0, a1):
            i = order[u]
            if not eligible[i]:
                continue
            while low < b1 and x[low] <= x[u] - gate:
                low += 1
            for v in range(low, b1):
                if x[v] >= x[u] + gate:
                    break
                dx, dy = x[v] - x[u], y[v] - y[u]
                d2 = dx * dx + dy * dy
                if d2 >= best_d2[0, u - a0] and d2 >= best_d2[1, v - b0]:
                    continue
                j = order[v]
                if not eligible[j] or is_line[i] != is_line[j]:
                    continue
                along = normal[i, 0] * normal[j, 0] + normal[i, 1] * normal[j, 1]
                if is_line[i] and abs(along) < 0.9:
                    continue
                if d2 < best_d2[0, u - a0]:
                    best[0, u - a0], best_d2[0, u - a0] = v, d2
                if d2 < best_d2[1, v - b0]:
                    best[1, v - b0], best_d2[1, v - b0] = u, d2
        if count + a1 - a0 + b1 - b0 > len(out_i):
            longer = 2 * len(out_i) + 2 * longest
            out_i, out_j = _lengthened(out_i, longer), _lengthened(out_j, longer)
        for u in range(a0, a1):
            v = best[0, u - a0]
            if v >= 0 and (is_line[order[u]] or best[1, v - b0] == u):
                out_i[count], out_j[count] = order[u], order[v]
                count += 1
        for v in range(b0, b1):
            u = best[1, v - b0]
            if u >= 0 and (is_line[order[v]] or best[0, u - a0] == v):
                out_i[count], out_j[count] = order[v], order[u]
                count += 1
        first[p + 1] = count
    return out_i[:count].copy(), out_j[:count].copy(), first


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
