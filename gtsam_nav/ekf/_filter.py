"""Compiled loop of the dead-reckoning filter; ``constant_velocity.run_readable`` is its oracle.

Loops are written out: matrix operators would make the first call compile for many seconds.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.series import BoolArray, IntArray

PATIENCE = 10
"""So many measurements of one kind in a row that fail the gate prove the state wrong, not them."""


@numba.njit(cache=True, error_model="numpy")
def run(
    t_event: Array,
    event: IntArray,
    n: int,
    first: IntArray,
    size: IntArray,
    value: Array,
    variance: Array,
    gate: Array,
    start_s: float,
    x_start: Array,
    P_start: Array,
    accel_variance: Array,
    restart_after: BoolArray,
    restarted: IntArray,
) -> tuple[Array, Array, Array, Array, BoolArray]:
    """Go through the events of ``constant_velocity.events``: n records, the rest measurements.

    Returns
    -------
    x : ndarray, shape (n, 8)
    P : ndarray, shape (n, 8, 8)
    nis : ndarray, shape (m,)
        Normalised innovation squared of every measurement, used or not.
    whitened : ndarray, shape (m, 4)
        Its innovation in uncorrelated standard deviations; zero beyond its size.
    used : ndarray of bool, shape (m,)
    """
    x_record, P_record, nis = np.empty((n, 8)), np.empty((n, 8, 8)), np.empty(len(first))
    whitened = np.zeros((len(first), 4))
    x, P, x_new, P_new = np.empty(8), np.empty((8, 8)), np.empty(8), np.empty((8, 8))
    G = np.zeros((4, 8))
    used, refused = np.zeros(len(first), dtype=np.bool_), np.zeros(8, dtype=np.int64)
    fitted_s = np.full(8, start_s)
    _copy(x_start, P_start, x, P)
    now = start_s
    for j in range(len(event)):
        _predict(x, P, G, t_event[j] - now, accel_variance)
        now = t_event[j]
        if event[j] < n:
            _copy(x, P, x_record[event[j]], P_record[event[j]])
            if restart_after[event[j]]:
                for entry in restarted:
                    P[entry, :], P[:, entry] = 0.0, 0.0
            continue
        k = event[j] - n
        _copy(x, P, x_new, P_new)
        nis[k] = _update(x_new, P_new, first[k], size[k], value[k], variance[k], whitened[k])
        if nis[k] > gate[size[k]] and refused[first[k]] >= PATIENCE:
            _copy(x, P, x_new, P_new)
            _doubt(x_new, P_new, G, now - fitted_s[first[k]], first[k], size[k], value[k])
            nis[k] = _update(x_new, P_new, first[k], size[k], value[k], variance[k], whitened[k])
        used[k] = nis[k] <= gate[size[k]]
        refused[first[k]] = 0 if used[k] else refused[first[k]] + 1
        if used[k]:
            x, P, x_new, P_new = x_new, P_new, x, P
            fitted_s[first[k]] = now
    return x_record, P_record, nis, whitened, used


@numba.njit(cache=True, error_model="numpy")
def _doubt(
    x: Array, P: Array, G: Array, elapsed_s: float, first: int, size: int, value: Array
) -> None:
    """Widen the measured entries by how far they lie off, and with them where this has led."""
    _motion(x, G, elapsed_s / 2)
    for h in range(first, first + size):
        off = value[h - first] - x[h]
        if h == 3:
            off = _wrap(off)
        way, whole = np.zeros(8), np.zeros(8)
        way[:4] = off * G[:, h]
        whole[:] = way
        whole[h] += off
        for i in range(8):
            for j in range(8):
                P[i, j] += whole[i] * whole[j] + way[i] * way[j] / 3


@numba.njit(cache=True, error_model="numpy")
def _copy(x: Array, P: Array, x_to: Array, P_to: Array) -> None:
    for i in range(8):
        x_to[i] = x[i]
        for j in range(8):
            P_to[i, j] = P[i, j]


@numba.njit(cache=True, error_model="numpy")
def _motion(x: Array, G: Array, dt: float) -> None:
    """Fill G, the first four rows of the transition F over ``dt`` less the identity."""
    c, s = math.cos(x[3]) * dt, math.sin(x[3]) * dt
    G[0, 3], G[0, 4], G[0, 5] = -s * x[4] - c * x[5], c, -s
    G[1, 3], G[1, 4], G[1, 5] = c * x[4] - s * x[5], s, c
    G[2, 6], G[3, 7] = dt, dt


@numba.njit(cache=True, error_model="numpy")
def _predict(x: Array, P: Array, G: Array, dt: float, accel_variance: Array) -> None:
    """``P := F P F' + Q`` in place, by way of G."""
    _motion(x, G, dt)
    for i in range(4):
        for j in range(4, 8):
            x[i] += G[i, j] * x[j]
    x[3] = _wrap(x[3])
    # rows, then columns, in rising order: none is read after it changed
    for i in range(4):
        for j in range(3, 8):
            for k in range(8):
                P[i, k] += G[i, j] * P[j, k]
    for i in range(4):
        for j in range(3, 8):
            for k in range(8):
                P[k, i] += G[i, j] * P[k, j]
    for j in range(4, 8):
        q = accel_variance[j - 4]
        P[j, j] += q * dt
        for i in range(4):
            P[i, j] += G[i, j] * q * dt / 2
            P[j, i] += G[i, j] * q * dt / 2
            for k in range(4):
                P[i, k] += G[i, j] * G[k, j] * q * dt / 3


@numba.njit(cache=True, error_model="numpy")
def _update(
    x: Array, P: Array, first: int, size: int, value: Array, variance: Array, whitened: Array
) -> float:
    """Update in place, entry by entry; the terms of the normalised innovation add up."""
    nis = 0.0
    for e in range(size):
        h = first + e
        innovation, S = value[e] - x[h], P[h, h] + variance[e]
        if h == 3:
            innovation = _wrap(innovation)
        whitened[e] = innovation / math.sqrt(S)
        nis += innovation * innovation / S
        column = P[:, h].copy()
        for i in range(8):
            x[i] += column[i] * innovation / S
            for j in range(8):
                P[i, j] -= column[i] * column[j] / S
    x[3] = _wrap(x[3])
    return nis


@numba.njit(cache=True, error_model="numpy")
def _wrap(angle: float) -> float:
    return (angle + math.pi) % (2.0 * math.pi) - math.pi
