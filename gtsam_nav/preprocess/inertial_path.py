"""Planar dead reckoning by an IMU alone: the level part of a strapdown path, and how it drifts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtsam_nav.frames import STANDARD_GRAVITY_M_S2, Array
from gtsam_nav.mission import Mission
from gtsam_nav.preprocess.alignment import align, at_rest
from gtsam_nav.preprocess.inertial_motion import inertial_motion
from gtsam_nav.preprocess.landmark_drift import Drift, of_inertia
from gtsam_nav.preprocess.planar_motion import PlanarMotion
from gtsam_nav.preprocess.settings import MotionSettings
from gtsam_nav.sensors.noise import ImuNoise

LEVELLING_S = 2.0
"""Over which a resting unit's specific force is averaged."""
MOVING_M_S, MOVING_TILT_RAD = 1.0, np.radians(2.0)
"""Spread of the velocity, and of roll and pitch, of a vehicle that does not start at rest."""


@dataclass(frozen=True)
class InertialPath:
    """A strapdown path from the mission's start.

    Attributes
    ----------
    motion : PlanarMotion
        Whose ``variance`` is that of the white noise alone.
    noise : ImuNoise
    sigma_v, sigma_a : float
        What its velocity and acceleration may be wrong by at the start, m/s and m/s^2.
    """

    motion: PlanarMotion
    noise: ImuNoise
    sigma_v: float
    sigma_a: float

    def drift(self, t: Array) -> Drift:
        """Its errors between successive times, shape (k + 1,)."""
        _, course, _ = self.motion.at(t)
        return of_inertia(t, course, self.noise, self.sigma_v, self.sigma_a)


def inertial_path(mission: Mission, settings: MotionSettings) -> InertialPath:
    """Integrate a mission's inertial readings.

    Raises
    ------
    DataError
        Where there is no IMU.
    """
    start = align(mission)
    path = inertial_motion(mission, start, settings)
    imu = mission.first("imu")
    assert imu is not None
    noise = ImuNoise.model_validate(imu.noise)
    if at_rest(mission, start.t):
        # the accelerometers' biases are levelled away, all but the noise of that
        sigma_v = settings.zero_velocity_sigma_m_s
        sigma_a = noise.accel_noise_density_m_s2_sqrt_hz / np.sqrt(LEVELLING_S)
    else:
        sigma_v = MOVING_M_S
        sigma_a = float(
            np.hypot(noise.accel_bias_sigma_m_s2, STANDARD_GRAVITY_M_S2 * MOVING_TILT_RAD)
        )
    passed_s = path.t - path.t[0]
    white = np.zeros_like(passed_s)
    turned = path.yaw_variance_rad2_s * passed_s
    motion = PlanarMotion(
        path.t,
        path.p_n[:, :2],
        path.rpy[:, 2],
        np.column_stack([white, white, turned]),
        course_is_heading=False,
        scale_sigma=0.0,
        curvature_sigma=0.0,
        bent_m=white,
    )
    return InertialPath(motion, noise, sigma_v, sigma_a)
