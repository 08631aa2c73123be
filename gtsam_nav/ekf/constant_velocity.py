"""The constant-velocity filter in plain NumPy: what its compiled twin in ``_filter`` computes.

State: n, e, d and yaw in the navigation frame, velocities u, v, w ahead, to starboard and down in
level axes of that yaw, and yaw rate r. Mallios et al., *Scan matching SLAM in underwater
environments*, Autonomous Robots 36 (2014), section 3.1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.series import BoolArray, IntArray

DEPTH, YAW, VELOCITY, YAW_RATE = 2, 3, slice(4, 7), 7


@dataclass(frozen=True)
class Measurements:
    """Direct measurements of neighbouring entries of the state, in the order of time.

    Attributes
    ----------
    t : ndarray, shape (m,)
    first, size : ndarray of int, shape (m,)
        Measurement k is of the entries ``first[k]`` to ``first[k] + size[k] - 1``.
    value, variance : ndarray, shape (m, 4)
        What is measured, and the variance of its white noise; zero beyond ``size``.
    sensor : ndarray of int, shape (m,)
        Index in ``names``.
    row : ndarray of int, shape (m,)
        Sample number in the source.
    names : tuple of str
        The sensors.
    """

    t: Array
    first: IntArray
    size: IntArray
    value: Array
    variance: Array
    sensor: IntArray
    row: IntArray
    names: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.t)


@dataclass(frozen=True)
class Start:
    """State (8,) and covariance (8, 8) at a time, s."""

    t: float
    x: Array
    P: Array


@dataclass(frozen=True)
class Restarts:
    """After which records (n,) the covariance of which entries of the state starts from zero.

    The covariance of the next record is then that of the displacement between both: Mallios et al.
    2014, section 3.2. The state itself runs on.
    """

    after: BoolArray
    entries: IntArray


@dataclass(frozen=True)
class Filtered:
    """States (n, 8) and covariances (n, 8, 8) at the times asked for, and what became of each
    measurement: its normalised innovation squared (m,), the innovation in uncorrelated standard
    deviations (m, 4), zero beyond its size, and whether it passed the gate (m,)."""

    t: Array
    x: Array
    P: Array
    nis: Array
    whitened: Array
    used: BoolArray


def run(
    measurements: Measurements,
    start: Start,
    t: Array,
    gate: Array,
    accel_variance: Array,
    restarts: Restarts | None = None,
) -> Filtered:
    """Filter all measurements.

    Parameters
    ----------
    measurements : Measurements
        None before the start.
    start : Start
    t : ndarray, shape (n,)
        When to record the state; a measurement of the same time comes after it.
    gate : ndarray, shape (5,)
        Largest normalised innovation squared of a measurement that is used, by its size. A run of
        failures makes the filter doubt its state instead.
    accel_variance : ndarray, shape (4,)
        Densities of the white acceleration of u, v, w and r; those of u and v are equal.
    restarts : Restarts, optional
        None where absent.
    """
    from gtsam_nav.ekf import _filter

    z, restarts = measurements, restarts or _no_restarts(t)
    x, P, nis, whitened, used = _filter.run(
        *events(z, t),
        len(t),
        z.first,
        z.size,
        z.value,
        z.variance,
        gate,
        start.t,
        start.x,
        start.P,
        accel_variance,
        restarts.after,
        restarts.entries,
    )
    return Filtered(t, x, P, nis, whitened, used)


def events(z: Measurements, t: Array) -> tuple[Array, IntArray]:
    """Times and numbers of all events in order: the records, then the measurements, count up."""
    both = np.concatenate([t, z.t])
    order = np.argsort(both, kind="stable")
    return both[order], order


def _no_restarts(t: Array) -> Restarts:
    return Restarts(np.zeros(len(t), dtype=bool), np.empty(0, dtype=np.int64))


def run_readable(
    measurements: Measurements,
    start: Start,
    t: Array,
    gate: Array,
    accel_variance: Array,
    restarts: Restarts | None = None,
) -> Filtered:
    """The same as `run`, step by step."""
    from gtsam_nav.ekf._filter import PATIENCE

    z, restarts = measurements, restarts or _no_restarts(t)
    now, x, P = start.t, start.x, start.P
    x_record, P_record = np.empty((len(t), 8)), np.empty((len(t), 8, 8))
    nis, used, refused = np.empty(len(z)), np.zeros(len(z), dtype=bool), np.zeros(8, dtype=int)
    fitted_s, whitened = np.full(8, start.t), np.zeros((len(z), 4))
    for then, event in zip(*events(z, t), strict=True):
        x, P = predict(x, P, then - now, accel_variance)
        now = then
        if event < len(t):
            x_record[event], P_record[event] = x, P
            if restarts.after[event]:
                P = P.copy()
                P[restarts.entries], P[:, restarts.entries] = 0.0, 0.0
            continue
        k, size = event - len(t), z.size[event - len(t)]
        entries = z.first[k] + np.arange(size)
        value, variance = z.value[k, :size], z.variance[k, :size]
        x_new, P_new, whitened[k, :size] = update(x, P, entries, value, variance)
        nis[k] = whitened[k] @ whitened[k]
        if nis[k] > gate[size] and refused[z.first[k]] >= PATIENCE:
            doubted = doubt(x, P, entries, value, now - fitted_s[z.first[k]])
            x_new, P_new, whitened[k, :size] = update(x, doubted, entries, value, variance)
            nis[k] = whitened[k] @ whitened[k]
        used[k] = nis[k] <= gate[size]
        refused[z.first[k]] = 0 if used[k] else refused[z.first[k]] + 1
        if used[k]:
            x, P = x_new, P_new
            fitted_s[z.first[k]] = now
    return Filtered(t, x_record, P_record, nis, whitened, used)


def predict(x: Array, P: Array, dt: float, accel_variance: Array) -> tuple[Array, Array]:
    """State and covariance after a while; the noise is integrated white acceleration."""
    F = transition(x, dt)
    B = transition(x, 1.0)[:4, 4:]
    x = x.copy()
    x[:4] += B @ x[4:] * dt
    x[YAW] = wrap_angle(x[YAW])
    q = accel_variance
    Q = np.empty((8, 8))
    Q[:4, :4] = (B * q) @ B.T * dt**3 / 3
    Q[:4, 4:] = B * q * dt**2 / 2
    Q[4:, :4] = Q[:4, 4:].T
    Q[4:, 4:] = np.diag(q * dt)
    return x, F @ P @ F.T + Q


def transition(x: Array, dt: float) -> Array:
    """Jacobian (8, 8) of the state after a while in the state before."""
    c, s = np.cos(x[YAW]), np.sin(x[YAW])
    u, v = x[4], x[5]
    F = np.eye(8)
    F[:4, 4:] = dt * np.eye(4)
    F[:2, 4:6] = [[c * dt, -s * dt], [s * dt, c * dt]]
    F[0, YAW], F[1, YAW] = (-s * u - c * v) * dt, (c * u - s * v) * dt
    return F


def doubt(x: Array, P: Array, entries: IntArray, value: Array, elapsed_s: float) -> Array:
    """Covariance of a state whose entries lie off what is measured, and of where that has led.

    An error that arose at some time since the last reading that fitted, ``elapsed_s`` ago, has led
    as far as it would in half of that time, with the spread of a time that is anything within.
    """
    off = value - x[entries]
    off = np.where(entries == YAW, wrap_angle(off), off)
    whole = transition(x, elapsed_s / 2)[:, entries] * off
    way = whole - np.eye(8)[:, entries] * off
    return np.asarray(P + whole @ whole.T + way @ way.T / 3)


def update(
    x: Array, P: Array, entries: IntArray, value: Array, variance: Array
) -> tuple[Array, Array, Array]:
    """Kalman update in Joseph form, and the innovation in uncorrelated standard deviations."""
    H = np.eye(8)[entries]
    innovation = value - x[entries]
    innovation = np.where(entries == YAW, wrap_angle(innovation), innovation)
    S = H @ P @ H.T + np.diag(variance)
    K = P @ H.T @ np.linalg.inv(S)
    x = x + K @ innovation
    x[YAW] = wrap_angle(x[YAW])
    left = np.eye(8) - K @ H
    P = left @ P @ left.T + (K * variance) @ K.T
    return x, P, np.linalg.solve(np.linalg.cholesky(S), innovation)
