"""Geodesy, rotations and angles: the only place where frames are converted.

Rotation matrices are stacked as (..., 3, 3); quaternions are ``wxyz`` and scalar-first everywhere;
``rpy`` is roll, pitch, yaw in radians with ``R = Rz(yaw) Ry(pitch) Rx(roll)``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

EARTH_RATE_RAD_S = 7.292115e-5
"""WGS-84 Earth rotation rate."""

STANDARD_GRAVITY_M_S2 = 9.80665
"""The g of datasheets, and gravity of a frame without an origin."""

ENU_FROM_NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""Maps NED coordinates to ENU, and back: the matrix is its own inverse."""

FLU_FROM_FRD = np.diag([1.0, -1.0, -1.0])
"""Maps forward-right-down coordinates to forward-left-up, and back."""


@dataclass(frozen=True)
class Origin:
    """Origin of the local NED frame on WGS-84."""

    latitude_deg: float
    longitude_deg: float
    height_m: float = 0.0

    def __post_init__(self) -> None:
        if not (-90.0 <= self.latitude_deg <= 90.0):
            raise ValueError(f"latitude_deg is {self.latitude_deg}; it must lie in [-90, 90]")
        if not (-180.0 <= self.longitude_deg <= 360.0):
            raise ValueError(f"longitude_deg is {self.longitude_deg}; it must lie in [-180, 360]")
        if not np.isfinite(self.height_m):
            raise ValueError(f"height_m is {self.height_m}; it must be finite")


def wrap_angle(angle: ArrayLike) -> Array:
    """Wrap angles to [-pi, pi)."""
    return np.asarray((np.asarray(angle, dtype=float) + np.pi) % (2.0 * np.pi) - np.pi)


def rotation_from_rpy(rpy: ArrayLike) -> Array:
    """Rotation matrices R_nb from roll, pitch, yaw.

    Parameters
    ----------
    rpy : array_like, shape (..., 3)
        Radians.

    Returns
    -------
    ndarray, shape (..., 3, 3)
    """
    angles = np.asarray(rpy, dtype=float)
    cr, cp, cy = np.moveaxis(np.cos(angles), -1, 0)
    sr, sp, sy = np.moveaxis(np.sin(angles), -1, 0)
    # filled in place: stacking would cost a single rotation most of its time
    R = np.empty((*angles.shape, 3))
    R[..., 0, 0], R[..., 1, 0], R[..., 2, 0] = cy * cp, sy * cp, -sp
    R[..., 0, 1], R[..., 1, 1] = cy * sp * sr - sy * cr, sy * sp * sr + cy * cr
    R[..., 0, 2], R[..., 1, 2] = cy * sp * cr + sy * sr, sy * sp * cr - cy * sr
    R[..., 2, 1], R[..., 2, 2] = cp * sr, cp * cr
    return R


def rpy_from_rotation(R: ArrayLike) -> Array:
    """Roll, pitch, yaw of rotation matrices, shape (..., 3), radians."""
    m = np.asarray(R, dtype=float)
    yaw = np.arctan2(m[..., 1, 0], m[..., 0, 0])
    # what yaw leaves over, Ry(pitch) Rx(roll), is exact where pitch nears 90 degrees too
    c, s = np.cos(yaw), np.sin(yaw)
    pitch = np.arctan2(-m[..., 2, 0], c * m[..., 0, 0] + s * m[..., 1, 0])
    roll = np.arctan2(s * m[..., 0, 2] - c * m[..., 1, 2], c * m[..., 1, 1] - s * m[..., 0, 1])
    return np.stack([roll, pitch, yaw], axis=-1)


def quaternion_from_rotation(R: ArrayLike) -> Array:
    """Unit quaternions ``wxyz`` with w >= 0 of rotation matrices, shape (..., 4)."""
    from scipy.spatial.transform import Rotation

    m = np.asarray(R, dtype=float)
    flat = Rotation.from_matrix(m.reshape(-1, 3, 3)).as_quat(canonical=True)
    return np.asarray(flat[:, [3, 0, 1, 2]].reshape(*m.shape[:-2], 4))


def rotation_from_quaternion(q_wxyz: ArrayLike) -> Array:
    """Rotation matrices of quaternions ``wxyz``, shape (..., 3, 3); normalises first."""
    q = np.asarray(q_wxyz, dtype=float)
    w, x, y, z = np.moveaxis(q / np.linalg.norm(q, axis=-1, keepdims=True), -1, 0)
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def quaternion_from_rpy(rpy: ArrayLike) -> Array:
    """Unit quaternions ``wxyz`` of roll, pitch, yaw, shape (..., 4)."""
    return quaternion_from_rotation(rotation_from_rpy(rpy))


def rpy_from_quaternion(q_wxyz: ArrayLike) -> Array:
    """Roll, pitch, yaw of quaternions ``wxyz``, shape (..., 3), radians."""
    return rpy_from_rotation(rotation_from_quaternion(q_wxyz))


def yaw_from_quaternion(q_wxyz: ArrayLike) -> Array:
    """Yaw of quaternions ``wxyz`` alone, shape (...,), radians; normalises first."""
    q = np.asarray(q_wxyz, dtype=float)
    w, x, y, z = np.moveaxis(q / np.linalg.norm(q, axis=-1, keepdims=True), -1, 0)
    return np.asarray(np.arctan2(2 * (x * y + w * z), 1 - 2 * (y * y + z * z)))


def slerp(q_a: ArrayLike, q_b: ArrayLike, fraction: ArrayLike) -> Array:
    """Unit quaternions ``wxyz`` with w >= 0, so far along the shorter arc from a to b.

    Parameters
    ----------
    q_a, q_b : array_like, shape (n, 4)
        Of unit length.
    fraction : array_like, shape (n,)
        Of the arc: 0 gives a, 1 gives b.

    Returns
    -------
    ndarray, shape (n, 4)
    """
    a, b = np.asarray(q_a, dtype=float), np.asarray(q_b, dtype=float)
    along = np.sum(a * b, axis=1)[:, None]
    across = np.where(along < 0.0, -1.0, 1.0) * (b - along * a)
    length = np.linalg.norm(across, axis=1)[:, None]
    arc = np.asarray(fraction, dtype=float)[:, None] * np.arctan2(length, np.abs(along))
    # where the two are one there is no way, whatever its direction
    q = np.cos(arc) * a + np.sin(arc) * across / np.maximum(length, np.finfo(float).tiny)
    return np.asarray(np.where(q[:, :1] < 0.0, -q, q))


def skew(v: ArrayLike) -> Array:
    """Cross-product matrices [v]x, shape (..., 3, 3)."""
    vectors = np.asarray(v, dtype=float)
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    out = np.zeros((*vectors.shape, 3))  # filled in place: filters call this often
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -z, y, -x
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = z, -y, x
    return out


def ned_from_geodetic(
    latitude_deg: ArrayLike, longitude_deg: ArrayLike, height_m: ArrayLike, origin: Origin
) -> Array:
    """Local NED coordinates of WGS-84 positions, shape (n, 3), metres."""
    import pymap3d

    return np.stack(
        pymap3d.geodetic2ned(
            np.asarray(latitude_deg, dtype=float),
            np.asarray(longitude_deg, dtype=float),
            np.asarray(height_m, dtype=float),
            origin.latitude_deg,
            origin.longitude_deg,
            origin.height_m,
        ),
        axis=-1,
    )


def geodetic_from_ned(p_n: ArrayLike, origin: Origin) -> tuple[Array, Array, Array]:
    """Latitude (deg), longitude (deg) and height (m) of local NED positions (n, 3)."""
    import pymap3d

    n, e, d = np.moveaxis(np.asarray(p_n, dtype=float), -1, 0)
    lat, lon, h = pymap3d.ned2geodetic(
        n, e, d, origin.latitude_deg, origin.longitude_deg, origin.height_m
    )
    return np.asarray(lat), np.asarray(lon), np.asarray(h)


def sag_m(p_n: ArrayLike, origin: Origin | None) -> Array:
    """How far the level surface through the origin lies below its tangent plane, m.

    Parameters
    ----------
    p_n : array_like, shape (..., 3)
        Places in the local NED.
    origin : Origin or None
        Without one the frame has no Earth below it, and is level.

    Returns
    -------
    ndarray, shape (...)
    """
    places = np.asarray(p_n, dtype=float)
    if origin is None:
        return np.zeros(places.shape[:-1])
    _, _, height_m = geodetic_from_ned(places, origin)
    return np.asarray(places[..., 2] + height_m - origin.height_m)


def gravity_m_s2(latitude_deg: float, height_m: float = 0.0) -> float:
    """WGS-84 normal gravity (Somigliana) with the second-order height correction.

    Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*,
    equations (2.134) and (2.139).
    """
    s2 = np.sin(np.radians(latitude_deg)) ** 2
    surface = 9.7803253359 * (1 + 0.001931853 * s2) / np.sqrt(1 - 0.0818191908425**2 * s2)
    f, a, mu, b = 1 / 298.257223563, 6378137.0, 3.986004418e14, 6356752.31425
    ratio = EARTH_RATE_RAD_S**2 * a**2 * b / mu
    slope = 1 - 2 / a * (1 + f * (1 - 2 * s2) + ratio) * height_m + 3 / a**2 * height_m**2
    return float(surface * slope)


def earth_rate_n(latitude_deg: float) -> Array:
    """Earth rotation in local NED, shape (3,), rad/s."""
    lat = np.radians(latitude_deg)
    return EARTH_RATE_RAD_S * np.array([np.cos(lat), 0.0, -np.sin(lat)])
