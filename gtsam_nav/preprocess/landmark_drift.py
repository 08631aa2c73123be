"""How dead reckoning goes wrong for longer than a moment: errors that a landmark filter finds.

They are linear in each step's displacement and turn, and of their own course from step to step:
a constant scale and curvature of odometry, or what is left of an inertial unit's levelling, which
grows into a velocity.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtsam_nav.frames import STANDARD_GRAVITY_M_S2, Array
from gtsam_nav.preprocess.planar_motion import Increments
from gtsam_nav.sensors.noise import ImuNoise

STEADY_S = 60.0
"""What a constant error of the gyro adds up to is taken to have done so over this time."""


@dataclass(frozen=True)
class Drift:
    """The e errors over k steps.

    Attributes
    ----------
    sigma : ndarray, shape (e,)
        Spread at the start, about zero.
    displacement : ndarray, shape (k, 2, e)
        Forward and to starboard that a step lacks, in proportion to the errors.
    turn : ndarray, shape (k, e)
        The same of its turn.
    transition, noise : ndarray, shape (k, e, e)
        How the errors go on, and the covariance that this adds.
    """

    sigma: Array
    displacement: Array
    turn: Array
    transition: Array
    noise: Array

    @property
    def is_constant(self) -> bool:
        """Whether the errors stay what they are."""
        return not np.any(self.noise)


def of_odometry(increments: Increments, scale_sigma: float, curvature_sigma: float) -> Drift:
    """Of speeds that are too low by a share, and of a turn that goes unnoticed, rad/m."""
    moved_b = increments.displacement_b
    k = len(moved_b)
    nothing = np.zeros(k)
    return Drift(
        sigma=np.array([scale_sigma, curvature_sigma]),
        displacement=np.stack([moved_b, np.zeros((k, 2))], axis=2),
        turn=np.column_stack([nothing, increments.bent_m]),
        transition=np.tile(np.eye(2), (k, 1, 1)),
        noise=np.zeros((k, 2, 2)),
    )


def of_inertia(t: Array, course: Array, noise: ImuNoise, sigma_v: float, sigma_a: float) -> Drift:
    """Of a strapdown path: errors of its velocity and acceleration along its own north and east.

    A levelled unit's acceleration is wrong by what its accelerometers' biases turn by, and its
    tilt by what the gyros' errors grow into.

    Parameters
    ----------
    t, course : ndarray, shape (k + 1,)
        Times and headings of the path, s and rad.
    sigma_v, sigma_a : float
        Of the two at the start, m/s and m/s^2.
    """
    dt, turned = np.diff(t), np.diff(course)
    k, both = len(dt), np.eye(2)
    c, s = np.cos(course[:-1]), np.sin(course[:-1])
    to_body = np.stack([np.stack([c, s], axis=1), np.stack([-s, c], axis=1)], axis=1)
    transition = np.tile(np.eye(4), (k, 1, 1))
    transition[:, :2, 2:] = dt[:, None, None] * both
    tilting = noise.gyro_noise_density_rad_s_sqrt_hz**2 + STEADY_S * noise.gyro_bias_sigma_rad_s**2
    walk = noise.accel_bias_walk_m_s3_sqrt_hz**2 + STANDARD_GRAVITY_M_S2**2 * tilting
    wander = np.zeros((k, 4, 4))
    wander[:, :2, :2] = (noise.accel_noise_density_m_s2_sqrt_hz**2 * dt)[:, None, None] * both
    wander[:, 2:, 2:] = (walk * dt + (noise.accel_bias_sigma_m_s2 * turned) ** 2)[
        :, None, None
    ] * both
    along = np.concatenate([dt[:, None, None] * both, 0.5 * dt[:, None, None] ** 2 * both], axis=2)
    return Drift(
        sigma=np.array([sigma_v, sigma_v, sigma_a, sigma_a]),
        displacement=to_body @ along,
        turn=np.zeros((k, 4)),
        transition=transition,
        noise=wander,
    )
