"""Open-loop strapdown integration of a whole mission: a first guess of its motion.

All readings at once, without a loop in time: attitudes as running products of small turns, and
what depends on the motion itself (Coriolis, gravity that leans as the Earth curves) by a few
rounds of substitution.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtsam_nav.frames import STANDARD_GRAVITY_M_S2, Array, Origin, earth_rate_n, gravity_m_s2
from gtsam_nav.mission import Sensor
from gtsam_nav.preprocess.running_turns import running_turns
from gtsam_nav.series import ImuSeries

EARTH_RADIUS_M = 6.371e6
ROUNDS = 4


@dataclass(frozen=True)
class Strapdown:
    """Attitude, velocity and position at each reading: shapes (n, 3, 3), (n, 3), (n, 3)."""

    R_nb: Array
    v_n: Array
    p_n: Array


def gravity_at(p_n: Array, origin: Origin | None) -> Array:
    """Gravity at positions (..., 3) about the origin, m/s^2.

    To first order in the distance: it points to the Earth's centre and weakens with height.
    """
    p_n = np.asarray(p_n, dtype=float)
    if origin is None:
        return np.broadcast_to([0.0, 0.0, STANDARD_GRAVITY_M_S2], p_n.shape)
    g = gravity_m_s2(origin.latitude_deg, origin.height_m)
    return np.asarray(g * (p_n / EARTH_RADIUS_M * [-1.0, -1.0, 2.0] + [0.0, 0.0, 1.0]))


def readings_at_origin(imu: Sensor) -> tuple[Array, Array]:
    """Angular rate (rad/s) and specific force (m/s^2) at the body's origin, along body axes.

    The lever arm's centripetal force is that of the readings, its Euler force that of their
    central differences.
    """
    series = imu.series
    assert isinstance(series, ImuSeries)
    gyro_b, accel_b = series.gyro_i @ imu.R_bs.T, series.accel_i @ imu.R_bs.T
    if np.any(imu.xyz_b) and len(series) > 1:
        accel_b -= np.cross(np.gradient(gyro_b, series.t, axis=0), imu.xyz_b)
        accel_b -= np.cross(gyro_b, np.cross(gyro_b, imu.xyz_b))
    return gyro_b, accel_b


def integrate(
    t: Array,
    gyro_b: Array,
    accel_b: Array,
    R_nb: Array,
    v_n: Array,
    p_n: Array,
    origin: Origin | None,
    max_gap_s: float = np.inf,
) -> Strapdown:
    """Integrate readings that are linear in between, from the state at the first of them.

    Parameters
    ----------
    t, gyro_b, accel_b : ndarray, shapes (n,), (n, 3), (n, 3)
        At the body's origin, biases taken off.
    R_nb, v_n, p_n : ndarray, shapes (3, 3), (3,), (3,)
        At the first reading.
    max_gap_s : float
        Over a longer silence the vehicle keeps attitude and velocity.
    """
    from scipy.spatial.transform import Rotation

    dt = np.diff(t)[:, None]
    earth_n = np.zeros(3) if origin is None else earth_rate_n(origin.latitude_deg)
    silent = dt[:, 0] > max_gap_s
    half_turns = 0.25 * (gyro_b[1:] + gyro_b[:-1]) * dt
    half_turns[silent] = 0.0
    turns = np.vstack([np.zeros(3), 2 * half_turns])
    R_inertial = running_turns(turns, np.arange(len(turns)))
    # the navigation frame itself turns with the Earth
    back = Rotation.from_rotvec(-np.outer(t - t[0], earth_n)).as_matrix()
    R = back @ R_nb @ R_inertial
    R_half_way = R[:-1] @ Rotation.from_rotvec(half_turns).as_matrix()
    force_n = np.einsum("nij,nj->ni", R_half_way, 0.5 * (accel_b[1:] + accel_b[:-1]))
    v, p = np.tile(v_n, (len(t), 1)), np.tile(p_n, (len(t), 1))
    for _ in range(ROUNDS):
        a_n = force_n + (gravity_at(p, origin) - 2 * np.cross(earth_n, v))[:-1]
        a_n[silent] = 0.0
        v = v_n + np.vstack([np.zeros(3), np.cumsum(a_n * dt, axis=0)])
        p = p_n + np.vstack([np.zeros(3), np.cumsum(0.5 * (v[1:] + v[:-1]) * dt, axis=0)])
    return Strapdown(R, v, p)
