"""What a perfect inertial unit feels: the Earth turns under it and pulls at it."""

from __future__ import annotations

import numpy as np

from gtsam_nav.frames import (
    STANDARD_GRAVITY_M_S2,
    Array,
    Origin,
    earth_rate_n,
    geodetic_from_ned,
    gravity_m_s2,
)
from gtsam_nav.simulation.motion import Kinematics, to_body


def ideal_imu(
    truth: Kinematics, origin: Origin | None, *, flat: bool = False
) -> tuple[Array, Array]:
    """Angular rate (rad/s) and specific force (m/s^2) at the body's origin, without noise.

    The navigation frame is tangent at the origin and turns with the Earth, so that its rates are
    the Earth's alone; the curvature of the Earth (transport rate, Schuler) is in the gravity.

    Parameters
    ----------
    truth : Kinematics
    origin : Origin or None
        None is a frame that does not turn.
    flat : bool
        Gravity is that of the origin everywhere.
    """
    earth_n = np.zeros(3) if origin is None else earth_rate_n(origin.latitude_deg)
    pull_n = uniform_gravity_n(origin) if flat or origin is None else gravity_n(truth.p_n, origin)
    R_nb = truth.R_nb
    gyro_b = truth.omega_nb_b + to_body(R_nb, np.broadcast_to(earth_n, truth.p_n.shape))
    force_n = truth.a_n + 2 * np.cross(earth_n, truth.v_n) - pull_n
    return gyro_b, to_body(R_nb, force_n)


def uniform_gravity_n(origin: Origin | None) -> Array:
    """Gravity at the origin, shape (3,), m/s^2."""
    if origin is None:
        return np.array([0.0, 0.0, STANDARD_GRAVITY_M_S2])
    return np.array([0.0, 0.0, gravity_m_s2(origin.latitude_deg, origin.height_m)])


def gravity_n(p_n: Array, origin: Origin) -> Array:
    """WGS-84 gravity at positions (n, 3), along the axes of the origin's NED, shape (n, 3), m/s^2.

    It points along the ellipsoid's normal at each place: a mile away it is not quite down.
    """
    latitude_deg, longitude_deg, height_m = geodetic_from_ned(p_n, origin)
    places = zip(latitude_deg.tolist(), height_m.tolist(), strict=True)
    magnitude = np.array([gravity_m_s2(latitude, height) for latitude, height in places])
    lat, lat_0 = np.radians(latitude_deg), np.radians(origin.latitude_deg)
    east = np.radians(longitude_deg - origin.longitude_deg)
    down_n = -np.column_stack(
        [
            np.cos(lat_0) * np.sin(lat) - np.sin(lat_0) * np.cos(lat) * np.cos(east),
            np.cos(lat) * np.sin(east),
            -np.cos(lat_0) * np.cos(lat) * np.cos(east) - np.sin(lat_0) * np.sin(lat),
        ]
    )
    return np.asarray(magnitude[:, None] * down_n)
