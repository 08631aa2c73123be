"""From the mission's NED to latitude, longitude, height and the NED axes of that place, and back.

The mission's NED is a plane: away from its origin the vertical leans (1.6 mrad in 10 km), and the
mechanisation needs the vertical of where the vehicle is. What its compiled twin in ``_strapdown``
computes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gtsam_nav.frames import Array, Origin, earth_rate_n, gravity_m_s2

SEMI_MAJOR_M = 6378137.0
FLATTENING = 1 / 298.257223563
ECCENTRICITY2 = FLATTENING * (2 - FLATTENING)
SEMI_MINOR_M = SEMI_MAJOR_M * (1 - FLATTENING)

Quaternion = tuple[float, float, float, float]


@dataclass(frozen=True)
class LevelState:
    """Attitude quaternion wxyz and velocity in the NED axes of a place: latitude, longitude (rad)
    and height (m)."""

    q_wxyz: Array
    v: Array
    place: Array


class LocalLevel:
    """The mission's NED at its origin against the NED of other places.

    Parameters
    ----------
    origin : Origin
    """

    def __init__(self, origin: Origin) -> None:
        latitude, longitude = math.radians(origin.latitude_deg), math.radians(origin.longitude_deg)
        self.origin = latitude, longitude, origin.height_m
        self.earth_rate_n = earth_rate_n(origin.latitude_deg)
        self._q_en = _axes(latitude, longitude)
        self._R_en = rotation(np.array(self._q_en))
        self._origin_e = _ecef(latitude, longitude, origin.height_m)

    def enter(self, q_nb_wxyz: Array, p_n: Array, v_n: Array) -> LevelState:
        """A state in the mission's NED, seen from its own place."""
        place = self.place(p_n)
        q_ln = np.array(_product(_inverse(_axes(place[0], place[1])), self._q_en))
        q_lb = _product(tuple(q_ln.tolist()), tuple(q_nb_wxyz.tolist()))
        return LevelState(np.array(q_lb), rotation(q_ln) @ v_n, np.array(place))

    def leave(self, state: LevelState) -> tuple[Array, Array, Array]:
        """Attitude, position and velocity in the mission's NED."""
        latitude, longitude, height_m = state.place.tolist()
        q_nl = _product(_inverse(self._q_en), _axes(latitude, longitude))
        q_nb = _product(q_nl, tuple(state.q_wxyz.tolist()))
        p_n = self._R_en.T @ (_ecef(latitude, longitude, height_m) - self._origin_e)
        return np.array(q_nb), p_n, rotation(np.array(q_nl)) @ state.v

    def place(self, p_n: Array) -> tuple[float, float, float]:
        """Latitude, longitude (rad) and height (m) of a position in the mission's NED."""
        return _geodetic(*(self._origin_e + self._R_en @ p_n).tolist())

    def gravity_n(self, p_n: Array) -> Array:
        """Normal gravity at a position, along the axes of the mission's NED, m/s^2."""
        latitude, longitude, height_m = self.place(p_n)
        g = gravity_m_s2(math.degrees(latitude), height_m)
        q_nl = _product(_inverse(self._q_en), _axes(latitude, longitude))
        return np.asarray(g * rotation(np.array(q_nl))[:, 2])

    def sag_m(self, p_n: Array) -> float:
        """How far a level surface through the origin lies below its tangent plane, m."""
        return float(p_n[2]) + self.place(p_n)[2] - self.origin[2]


def _axes(latitude: float, longitude: float) -> Quaternion:
    """The NED axes of a place in ECEF: Rz(longitude) Ry(-latitude - 90 deg)."""
    a, b = longitude / 2, -(latitude + math.pi / 2) / 2
    ca, sa, cb, sb = math.cos(a), math.sin(a), math.cos(b), math.sin(b)
    return ca * cb, -sa * sb, ca * sb, sa * cb


def _ecef(latitude: float, longitude: float, height_m: float) -> Array:
    s, c = math.sin(latitude), math.cos(latitude)
    normal_m = SEMI_MAJOR_M / math.sqrt(1 - ECCENTRICITY2 * s * s)
    out_m = (normal_m + height_m) * c
    return np.array(
        [
            out_m * math.cos(longitude),
            out_m * math.sin(longitude),
            ((1 - ECCENTRICITY2) * normal_m + height_m) * s,
        ]
    )


def _geodetic(x: float, y: float, z: float) -> tuple[float, float, float]:
    """Bowring's method; two rounds are exact to the nanometre near the surface."""
    axis_m = math.hypot(x, y)
    second = ECCENTRICITY2 / (1 - ECCENTRICITY2)
    latitude, reduced = 0.0, math.atan2(z * SEMI_MAJOR_M, axis_m * SEMI_MINOR_M)
    for _ in range(2):
        latitude = math.atan2(
            z + second * SEMI_MINOR_M * math.sin(reduced) ** 3,
            axis_m - ECCENTRICITY2 * SEMI_MAJOR_M * math.cos(reduced) ** 3,
        )
        reduced = math.atan2((1 - FLATTENING) * math.sin(latitude), math.cos(latitude))
    s, c = math.sin(latitude), math.cos(latitude)
    height_m = axis_m * c + z * s - SEMI_MAJOR_M * math.sqrt(1 - ECCENTRICITY2 * s * s)
    return latitude, math.atan2(y, x), height_m


def rotation(q_wxyz: Array) -> Array:
    """Rotation matrix of one unit quaternion; `frames` turns many at once, and takes longer."""
    w, x, y, z = q_wxyz.tolist()
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def turned(q_nb_wxyz: Array, theta_b: Array) -> Array:
    """Attitude after a rotation by a vector along body axes."""
    x, y, z = theta_b.tolist()
    angle = math.sqrt(x * x + y * y + z * z)
    scale = math.sin(angle / 2) / angle if angle > 1e-8 else 0.5
    small = math.cos(angle / 2), scale * x, scale * y, scale * z
    q = np.array(_product(tuple(q_nb_wxyz.tolist()), small))
    return np.asarray(q / math.sqrt(float(q @ q)))


def _inverse(q: Quaternion) -> Quaternion:
    return q[0], -q[1], -q[2], -q[3]


def _product(left: Quaternion, right: Quaternion) -> Quaternion:
    a, b, c, d = left
    w, x, y, z = right
    return (
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    )
