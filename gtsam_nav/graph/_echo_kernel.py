"""Compiled parts of the joint refinement: local shapes, partners and normal equations."""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.series import BoolArray, IntArray


@numba.njit(cache=True, error_model="numpy")
def local_lines(
    xy: Array, scan_first: IntArray, radius: float, max_thickness: float
) -> tuple[Array, BoolArray]:
    """Normal of the wall at each echo, from its neighbours in the same scan.

    The line is fitted twice, the second time without neighbours far from the first (clutter,
    second echoes).

    Returns
    -------
    normal : ndarray, shape (k, 2)
    is_line : ndarray of bool, shape (k,)
        The echo is one of at least four neighbours on a line longer than three times its thickness.
    """
    n = len(xy)
    normal, is_line = np.zeros((n, 2)), np.zeros(n, np.bool_)
    for s in range(len(scan_first) - 1):
        for i in range(scan_first[s], scan_first[s + 1]):
            nx, ny, offset = 0.0, 0.0, 0.0
            keep_within = np.inf
            for _ in range(2):
                count, mx, my, sxx, sxy, syy = 0, 0.0, 0.0, 0.0, 0.0, 0.0
                for j in range(scan_first[s], scan_first[s + 1]):
                    dx, dy = xy[j, 0] - xy[i, 0], xy[j, 1] - xy[i, 1]
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
    the walls differ in direction, and a scatterer stands alone.
    """
    cx, cy, nx, ny, order, first = cells
    out = np.zeros(len(xy), np.bool_)
    for i in range(len(xy)):
        if is_line[i]:
            continue
        total, lines, txx, txy, tyy = 0, 0, 0.0, 0.0, 0.0
        for ix in range(max(cx[i] - 1, 0), min(cx[i] + 2, nx)):
            for iy in range(max(cy[i] - 1, 0), min(cy[i] + 2, ny)):
                for m in range(first[ix * ny + iy], first[ix * ny + iy + 1]):
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
    xy: Array,
    cells: Grid,
    scan: IntArray,
    n_scans: int,
    scan_xy: Array,
    scan_radius: float,
    gate: float,
    normal: Array,
    is_line: BoolArray,
    eligible: BoolArray,
) -> tuple[IntArray, IntArray]:
    """For each echo, the nearest echo of each other scan taken nearby, within a gate.

    An echo on a wall pairs only with echoes on walls of like direction, another only with others.

    Returns
    -------
    i, j : ndarray of int, shape (m,)
        Pairs, sorted by i and then by the scan of j.
    """
    n = len(xy)
    cx, cy, nx, ny, order, first = cells
    out_i, out_j = np.empty(n * 8, np.int64), np.empty(n * 8, np.int64)
    count = 0
    best = np.full(n_scans, -1, np.int64)
    best_d2 = np.empty(n_scans)
    touched = np.empty(n_scans, np.int64)
    for i in range(n):
        if not eligible[i]:
            continue
        n_touched = 0
        for ix in range(max(cx[i] - 1, 0), min(cx[i] + 2, nx)):
            for iy in range(max(cy[i] - 1, 0), min(cy[i] + 2, ny)):
                c = ix * ny + iy
                for m in range(first[c], first[c + 1]):
                    j = order[m]
                    s = scan[j]
                    if s == scan[i] or is_line[j] != is_line[i] or not eligible[j]:
                        continue
                    dx, dy = xy[j, 0] - xy[i, 0], xy[j, 1] - xy[i, 1]
                    d2 = dx * dx + dy * dy
                    if d2 >= gate * gate:
                        continue
                    if best[s] >= 0 and d2 >= best_d2[s]:
                        continue
                    sx = scan_xy[s, 0] - scan_xy[scan[i], 0]
                    sy = scan_xy[s, 1] - scan_xy[scan[i], 1]
                    if sx * sx + sy * sy > scan_radius * scan_radius:
                        continue
                    if is_line[i]:
                        along = normal[i, 0] * normal[j, 0] + normal[i, 1] * normal[j, 1]
                        if abs(along) < 0.9:
                            continue
                    if best[s] < 0:
                        touched[n_touched] = s
                        n_touched += 1
                    best[s], best_d2[s] = j, d2
        if count + n_touched > len(out_i):
            out_i, out_j = _doubled(out_i), _doubled(out_j)
        _sort(touched, n_touched)
        for k in range(n_touched):
            s = touched[k]
            out_i[count], out_j[count] = i, best[s]
            count += 1
            best[s] = -1
    return out_i[:count].copy(), out_j[:count].copy()


@numba.njit(cache=True)
def _doubled(values: IntArray) -> IntArray:
    longer = np.empty(2 * len(values), np.int64)
    longer[: len(values)] = values
    return longer


@numba.njit(cache=True)
def _sort(values: IntArray, n: int) -> None:
    """Insertion sort of the first n values: they are few, and compiling a library sort is slow."""
    for k in range(1, n):
        value, m = values[k], k
        while m > 0 and values[m - 1] > value:
            values[m] = values[m - 1]
            m -= 1
        values[m] = value


@numba.njit(cache=True, error_model="numpy")
def mutual(i: IntArray, j: IntArray, scan: IntArray, n: int) -> BoolArray:
    """Which pairs are each other's choice."""
    first = np.zeros(n + 1, np.int64)
    for m in range(len(i)):
        first[i[m] + 1] += 1
    for k in range(n):
        first[k + 1] += first[k]
    keep = np.zeros(len(i), np.bool_)
    for m in range(len(i)):
        for k in range(first[j[m]], first[j[m] + 1]):
            if scan[j[k]] == scan[i[m]]:
                keep[m] = j[k] == i[m]
                break
    return keep


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
def correlation_excess(
    residual: Array, normal: Array, run: IntArray, clip: float, max_lag: int
) -> float:
    """How many times more the mean of a run of residuals varies than if they were independent.

    ``1 + 2 sum rho_k``, the integrated autocorrelation over residuals that follow each other in a
    run and lie on walls of one direction; lags weigh by how often they occur.

    Parameters
    ----------
    residual, normal : ndarray, shapes (m,) and (m, 2)
        In the order of their runs.
    run : ndarray of int, shape (m,)
        Which run each belongs to.
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
    excess = 1.0
    for lag in range(1, max_lag + 1):
        total = 0.0
        for m in range(len(clipped) - lag):
            if run[m] != run[m + lag]:
                continue
            along = normal[m, 0] * normal[m + lag, 0] + normal[m, 1] * normal[m + lag, 1]
            if abs(along) > 0.95:
                total += clipped[m] * clipped[m + lag]
        excess += 2.0 * max(total / variance, 0.0)
    return excess


@numba.njit(cache=True, error_model="numpy")
def accumulate(
    i: IntArray,
    j: IntArray,
    block: IntArray,
    n_blocks: int,
    xy: Array,
    arms: Array,
    cov: Array,
    normal: Array,
    is_line: BoolArray,
    fraction: Array,
    weight: Array,
) -> tuple[Array, Array]:
    """Normal equations of all pairs, by block of the two knot intervals that a pair touches.

    An echo at ``fraction`` f of its interval moves by ``(1 - f) d_k + f d_(k+1)`` of what its two
    knots make of it: a knot's shift (dn, de), and its turn dyaw about the knot itself, of which
    ``arms`` (k, 2, 2) are the echo's offsets. The direction of a residual turns with echo j, so
    that turning everything together costs nothing.

    Returns
    -------
    A : ndarray, shape (n_blocks, 12, 12)
        Over the knots (k_i, k_i + 1, k_j, k_j + 1).
    g : ndarray, shape (n_blocks, 12)
        Right-hand side: the step solves ``A step = g``.
    """
    A, g = np.zeros((n_blocks, 12, 12)), np.zeros((n_blocks, 12))
    J = np.zeros((2, 12))
    row = np.zeros(12)
    for m in range(len(i)):
        a, b, k = i[m], j[m], block[m]
        for side in range(2):
            e, sign = (a, 1.0) if side == 0 else (b, -1.0)
            for end in range(2):
                f = sign * (fraction[e] if end == 1 else 1.0 - fraction[e])
                c = 6 * side + 3 * end
                J[0, c], J[1, c + 1] = f, f
                J[0, c + 2], J[1, c + 2] = -f * arms[e, end, 1], f * arms[e, end, 0]
        ex, ey = xy[a, 0] - xy[b, 0], xy[a, 1] - xy[b, 1]
        sxx, sxy = cov[a, 0, 0] + cov[b, 0, 0], cov[a, 0, 1] + cov[b, 0, 1]
        syy = cov[a, 1, 1] + cov[b, 1, 1]
        if is_line[b]:
            ux, uy = normal[b, 0], normal[b, 1]
            w = weight[m] / (ux * ux * sxx + 2 * ux * uy * sxy + uy * uy * syy)
            _add_row(A[k], g[k], ux, uy, ex, ey, fraction[b], w, J, row)
        else:
            # two independent rows along the eigenvectors of the covariance
            angle = 0.5 * math.atan2(2 * sxy, sxx - syy)
            for _ in range(2):
                ux, uy = math.cos(angle), math.sin(angle)
                w = weight[m] / (ux * ux * sxx + 2 * ux * uy * sxy + uy * uy * syy)
                _add_row(A[k], g[k], ux, uy, ex, ey, fraction[b], w, J, row)
                angle += 0.5 * math.pi
    for k in range(n_blocks):
        for c in range(12):
            for d in range(c):
                A[k, c, d] = A[k, d, c]
    return A, g


@numba.njit(cache=True, error_model="numpy")
def _add_row(
    A: Array,
    g: Array,
    ux: float,
    uy: float,
    ex: float,
    ey: float,
    fraction_j: float,
    w: float,
    J: Array,
    row: Array,
) -> None:
    """Add the scalar residual ``u . e`` whose direction u turns with echo j; upper half of A."""
    for c in range(12):
        row[c] = ux * J[0, c] + uy * J[1, c]
    turned = ux * ey - uy * ex
    row[8] += (1.0 - fraction_j) * turned
    row[11] += fraction_j * turned
    residual = ux * ex + uy * ey
    for c in range(12):
        wc = w * row[c]
        g[c] -= wc * residual
        for d in range(c, 12):
            A[c, d] += wc * row[d]
