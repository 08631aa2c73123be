"""An attitude and heading reference that needs gyro, accelerometer and compass alone.

The gyro turns a quaternion; the accelerometer says, by gradient descent on the direction of
gravity, which quaternion it would rather see; a Kalman filter whose state is the quaternion weighs
the two.
After Madgwick (2010) for the descent and Choukroun, Bar-Itzhack and Oshman, *Novel quaternion
Kalman filter*, IEEE Trans. Aerospace and Electronic Systems 42(1), 2006, for the filter.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from gtsam_nav.frames import (
    STANDARD_GRAVITY_M_S2,
    Array,
    quaternion_from_rpy,
    rpy_from_quaternion,
)

DESCENT_STEP, DESCENT_ROUNDS = 0.25, 3
"""A quarter is Newton's step near the minimum, where gravity's slope in the quaternion is 2."""
LEVEL_AXES, VERTICAL_AXIS = [0, 1], [2]
"""About which of north, east and down a sensor tells the rotation."""


class Ahrs:
    """Attitude from gyro, accelerometer and compass.

    Angles are in radians; axes are forward, right, down and north, east, down.

    Parameters
    ----------
    rpy : array_like, shape (3,)
        Roll, pitch and yaw at the start.
    sigma_rpy : float
        Their standard deviation.
    gyro_noise_density_rad_s_sqrt_hz : float
        Of the white noise of each gyro, and of whatever else lets it drift.
    sigma_tilt_rad : float
        Of the direction of gravity by one reading, in quiet motion.
    sigma_heading_rad : float
        Of one compass reading.

    Examples
    --------
    A vehicle at rest, rolled by 10 degrees and heading east, of which nothing is known at first:

    >>> import numpy as np
    >>> from gtsam_nav.ekf.ahrs import Ahrs
    >>> roll = np.radians(10.0)
    >>> accel_b = 9.81 * np.array([0.0, -np.sin(roll), -np.cos(roll)])
    >>> ahrs = Ahrs([0.0, 0.0, 0.0], sigma_rpy=1.0)
    >>> for _ in range(100):
    ...     ahrs.turn([0.0, 0.0, 0.0], dt=0.01)
    ...     ahrs.see_gravity(accel_b)
    ...     ahrs.see_heading(np.radians(90.0))
    >>> [round(float(angle)) for angle in np.degrees(ahrs.rpy)]
    [10, 0, 90]
    """

    def __init__(
        self,
        rpy: ArrayLike,
        sigma_rpy: float = 0.1,
        *,
        gyro_noise_density_rad_s_sqrt_hz: float = 1e-3,
        sigma_tilt_rad: float = 0.05,
        sigma_heading_rad: float = 0.05,
    ) -> None:
        self.q_nb_wxyz = quaternion_from_rpy(rpy)
        G = _turns_in_navigation_axes(self.q_nb_wxyz)
        self.P = sigma_rpy**2 * G @ G.T
        self._gyro_variance_s = gyro_noise_density_rad_s_sqrt_hz**2
        self._sigma_tilt, self._sigma_heading = sigma_tilt_rad, sigma_heading_rad

    @property
    def rpy(self) -> Array:
        """Roll, pitch and yaw, shape (3,)."""
        return rpy_from_quaternion(self.q_nb_wxyz)

    @property
    def sigma_n(self) -> Array:
        """Standard deviations of small rotations about north, east and down, shape (3,), rad."""
        G = 4 * _turns_in_navigation_axes(self.q_nb_wxyz)  # their inverse, transposed
        return np.sqrt(np.diag(G.T @ self.P @ G))

    def turn(self, gyro_b: ArrayLike, dt: float) -> None:
        """Turn by an angular rate (3,), rad/s, that lasts for dt seconds."""
        rotation = np.asarray(gyro_b, dtype=float) * dt
        angle = float(np.linalg.norm(rotation))
        # sin(angle / 2) / angle, also where the angle is zero
        step = np.array([np.cos(angle / 2), *(rotation / 2 * np.sinc(angle / (2 * np.pi)))])
        F = _right_product(step)
        G = _turns_in_body_axes(self.q_nb_wxyz)
        self.P = F @ (self.P + self._gyro_variance_s * dt * G @ G.T) @ F.T
        self._set(F @ self.q_nb_wxyz)

    def see_gravity(self, accel_b: ArrayLike) -> None:
        """Correct roll and pitch by a specific force (3,), m/s^2.

        A vehicle that accelerates feels more or less than gravity: it is trusted the less.
        """
        force_b = np.asarray(accel_b, dtype=float)
        size = float(np.linalg.norm(force_b))
        if size == 0.0:
            return  # free fall has no down
        sigma = np.hypot(self._sigma_tilt, abs(size / STANDARD_GRAVITY_M_S2 - 1.0))
        wanted = descend_to_gravity(self.q_nb_wxyz, force_b / size)
        self._fuse(wanted, LEVEL_AXES, float(sigma))

    def see_heading(self, heading: float) -> None:
        """Correct the yaw by a heading, clockwise from true north."""
        w, x, y, z = self.q_nb_wxyz
        yaw = np.arctan2(2 * (x * y + w * z), 1 - 2 * (y * y + z * z))
        c, s = np.cos((heading - yaw) / 2), np.sin((heading - yaw) / 2)
        wanted = np.array([c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w])
        self._fuse(wanted, VERTICAL_AXIS, self._sigma_heading)

    def _fuse(self, wanted: Array, axes: list[int], sigma: float) -> None:
        """Kalman update by the rotation about some navigation axes that leads to a quaternion."""
        measured = wanted if wanted @ self.q_nb_wxyz >= 0 else -wanted  # both mean the same
        H = 4 * _turns_in_navigation_axes(self.q_nb_wxyz)[:, axes].T
        R = sigma**2 * np.eye(len(axes))
        K = np.linalg.solve(H @ self.P @ H.T + R, H @ self.P).T
        left = np.eye(4) - K @ H
        self.P = left @ self.P @ left.T + K @ R @ K.T
        self._set(self.q_nb_wxyz + K @ H @ (measured - self.q_nb_wxyz))

    def _set(self, q: Array) -> None:
        self.q_nb_wxyz = q / np.linalg.norm(q)


def descend_to_gravity(q_nb_wxyz: Array, direction_b: Array) -> Array:
    """The nearest attitude in which a force at rest has the measured direction.

    Steps down the gradient of ``|force(q) - direction|^2 / 2``, renormalised; the heading stays,
    for gravity has no slope in it.

    Parameters
    ----------
    q_nb_wxyz : ndarray, shape (4,)
    direction_b : ndarray, shape (3,)
        Of the specific force, of unit length: up, in a vehicle at rest.
    """
    q = q_nb_wxyz
    for _ in range(DESCENT_ROUNDS):
        w, x, y, z = q
        up_b = -np.array([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)])
        slope = -2 * np.array([[-y, z, -w, x], [x, w, z, y], [0.0, -2 * x, -2 * y, 0.0]])
        q = q - DESCENT_STEP * slope.T @ (up_b - direction_b)
        q = q / np.sqrt(q @ q)
    return np.asarray(q)


def _right_product(q: Array) -> Array:
    """The matrix that multiplies a quaternion by q from the right."""
    w, x, y, z = q
    return np.array([[w, -x, -y, -z], [x, w, z, -y], [y, -z, w, x], [z, y, -x, w]])


def _turns_in_body_axes(q: Array) -> Array:
    """Change of a quaternion for small turns about body axes, shape (4, 3)."""
    w, x, y, z = q
    return 0.5 * np.array([[-x, -y, -z], [w, -z, y], [z, w, -x], [-y, x, w]])


def _turns_in_navigation_axes(q: Array) -> Array:
    """Change of a quaternion for small turns about navigation axes, shape (4, 3)."""
    w, x, y, z = q
    return 0.5 * np.array([[-x, -y, -z], [w, z, -y], [-z, w, x], [y, -x, w]])
