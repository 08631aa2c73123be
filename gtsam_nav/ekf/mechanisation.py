"""The strapdown mechanisation in plain NumPy: what its compiled twin in ``_strapdown`` computes.

Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems* (2013),
sections 5.4 and 14.2; Titterton and Weston, *Strapdown Inertial Navigation Technology* (2004),
chapter 11.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtsam_nav.ekf._strapdown import (
    COAST_STEP_S,
    ECCENTRICITY2,
    HOLD_S,
    SEMI_MAJOR_M,
)
from gtsam_nav.frames import (
    STANDARD_GRAVITY_M_S2,
    Array,
    earth_rate_n,
    gravity_m_s2,
    rotation_from_quaternion,
    skew,
)


@dataclass(frozen=True)
class Readings:
    """Angular rates and specific forces (n, 3) in body axes at times (n,), and when the IMU is
    silent: where its samples lie more than ``max_gap_s`` apart."""

    t: Array
    gyro_b: Array
    accel_b: Array
    max_gap_s: float


@dataclass(frozen=True)
class Surroundings:
    """Earth rate and transport rate (3,) in NED, rad/s; radii of motion north and east, m; and
    gravity, m/s^2, at a place."""

    earth: Array
    transport: Array
    radii_m: Array
    gravity_m_s2: float


def integrate_readable(
    x: Array,
    place: Array,
    curved: bool,
    readings: Readings,
    from_s: float,
    to_s: float,
    growth: Array,
) -> tuple[Array, Array, Array, Array]:
    """State (13,), place (3,), transition and noise (15, 15) of a span; see ``_strapdown``."""
    t, now = readings.t, from_s
    Phi, Q = np.eye(15), np.zeros((15, 15))
    while now < to_s:
        k = int(np.searchsorted(t, now, side="right")) - 1
        before = t[k] if k >= 0 else -np.inf
        after = t[k + 1] if k + 1 < len(t) else np.inf
        measured = after - before <= readings.max_gap_s
        held = not measured and now < before + HOLD_S
        if measured:
            then = min(after, to_s)
        elif held:
            then = min(after, to_s, now + COAST_STEP_S, before + HOLD_S)
        else:
            then = min(after, to_s, now + COAST_STEP_S)
        dt = then - now
        if measured or held:
            ends = np.clip([now, then], before, after if measured else before)
            w = np.stack([np.interp(ends, t, a) for a in readings.gyro_b.T], axis=1) - x[7:10]
            f = np.stack([np.interp(ends, t, a) for a in readings.accel_b.T], axis=1) - x[10:]
            x, place, F = step(x, place, w, f, dt, curved)
        else:
            F = np.zeros((15, 15))
            F[3:6, 6:9] = np.eye(3)
            place = moved(place, x[4:7], dt, surroundings(x[4:7], place, curved), curved)
        A = np.eye(15) + F * dt + F @ F * dt**2 / 2
        Phi = A @ Phi
        Q = A @ Q @ A.T + np.diag(growth[0 if measured else 1 if held else 2]) * dt
        now = then
    return x, place, Phi, Q


def surroundings(v: Array, place: Array, curved: bool) -> Surroundings:
    """What the Earth does at a place to a vehicle of velocity v (north, east, down)."""
    if not curved:
        return Surroundings(np.zeros(3), np.zeros(3), np.full(2, np.inf), STANDARD_GRAVITY_M_S2)
    latitude, _, height_m = place
    w2 = 1 - ECCENTRICITY2 * np.sin(latitude) ** 2
    meridian_m = SEMI_MAJOR_M * (1 - ECCENTRICITY2) / w2**1.5
    transverse_m = SEMI_MAJOR_M / np.sqrt(w2)
    north_m, east_m = meridian_m + height_m, transverse_m + height_m
    return Surroundings(
        earth=earth_rate_n(np.degrees(latitude)),
        transport=np.array([v[1] / east_m, -v[0] / north_m, -v[1] * np.tan(latitude) / east_m]),
        radii_m=np.array([north_m, east_m]),
        gravity_m_s2=gravity_m_s2(float(np.degrees(latitude)), height_m),
    )


def step(
    x: Array, place: Array, w: Array, f: Array, dt: float, curved: bool
) -> tuple[Array, Array, Array]:
    """State and place after a step, and the errors' rate of change over it.

    Rates and forces (2, 3) are those at its ends, biases taken off, and linear in between.
    """
    from scipy.spatial.transform import Rotation

    R_nb = rotation_from_quaternion(x[:4])
    mean_w, mean_f = w.mean(axis=0), f.mean(axis=0)
    turn = mean_w * dt + np.cross(w[0], w[1]) * dt**2 / 12
    sculling = (np.cross(w[0], f[1]) - np.cross(w[1], f[0])) / 12
    push_b = mean_f * dt + (np.cross(mean_w, mean_f) / 2 + sculling) * dt**2
    v, push_n = x[4:7], R_nb @ push_b
    around = surroundings(v + push_n / 2, place, curved)
    gravity, frame = np.array([0.0, 0.0, around.gravity_m_s2]), around.earth + around.transport
    coriolis = np.cross(frame + around.earth, v + (push_n + gravity * dt) / 2)
    v_after = v + push_n - np.cross(frame, push_n) * dt / 2 + (gravity - coriolis) * dt
    R = (
        Rotation.from_rotvec(-frame * dt).as_matrix()
        @ R_nb
        @ Rotation.from_rotvec(turn).as_matrix()
    )
    q = np.roll(Rotation.from_matrix(R).as_quat(), 1)
    place = moved(place, (v + v_after) / 2, dt, around, curved)
    F = error_rates(x, mean_w, mean_f, around, curved)
    return np.concatenate([q, v_after, x[7:]]), place, F


def moved(place: Array, v: Array, dt: float, around: Surroundings, curved: bool) -> Array:
    """The place after a while at a velocity."""
    if not curved:
        return place + v * dt
    latitude = place[0] + v[0] * dt / around.radii_m[0]
    mean_latitude = (place[0] + latitude) / 2
    longitude = place[1] + v[1] * dt / (around.radii_m[1] * np.cos(mean_latitude))
    return np.array([latitude, longitude, place[2] - v[2] * dt])


def error_rates(x: Array, w: Array, f: Array, around: Surroundings, curved: bool) -> Array:
    """Rate of change of the errors (theta_b, rho_b, nu_b, biases), shape (15, 15).

    The errors are vectors against the Earth in axes that turn with the body: the rates of the
    place's own NED do not enter, and all but the gravity gradient is exact to first order.
    """
    R_nb = rotation_from_quaternion(x[:4])
    earth_b = R_nb.T @ around.earth
    F = np.zeros((15, 15))
    F[0:3, 0:3] = -skew(w)
    F[0:3, 9:12] = -np.eye(3)
    F[3:6, 3:6] = -skew(w - earth_b)
    F[3:6, 6:9] = np.eye(3)
    F[6:9, 0:3] = -skew(f)
    F[6:9, 6:9] = -skew(w + earth_b)
    F[6:9, 12:15] = -np.eye(3)
    if curved:
        # gravity turns with the horizontal place and weakens with height
        level = -1 / around.radii_m
        gradient = around.gravity_m_s2 * np.diag([*level, -level.sum()])
        F[6:9, 3:6] = R_nb.T @ gradient @ R_nb
    return F
