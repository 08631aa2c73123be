"""Inertial readings preintegrated into one factor, at the biases that are believed.

A preintegrated factor is linear in what the biases differ from those it was integrated at. A gyro's
0.02 rad/s turn 5 s of readings by 0.1 rad: of the second order of that, gravity makes 0.1 m/s and
0.1 m along the vertical, many times the readings' noise, which the rest of the solution would
bend to explain. So the readings are integrated once a bias is believed, and anew where that has
since moved so far that the second order counts beside their noise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import gtsam
import numpy as np

from gtsam_nav.frames import Array, Origin, earth_rate_n
from gtsam_nav.graph.factors import B, X
from gtsam_nav.mission import Sensor
from gtsam_nav.sensors.noise import ImuNoise

GRAVITY_M_S2 = 9.8
SECOND_ORDER_SIGMAS = 0.03
"""What a gyro bias beside the one that readings were integrated at may make of their velocity by
its second order, in standard deviations of their own noise."""


def imu_parameters(
    imu: Sensor, origin: Origin | None, *, combined: bool = False
) -> Callable[[Array], Any]:
    """Makes preintegration parameters of a gravity, m/s^2: mounting and noise are the IMU's.

    The Earth turns where the place on it is known; ``combined`` lets the biases walk.
    """
    noise = ImuNoise.model_validate(imu.noise)
    gyro = noise.gyro_noise_density_rad_s_sqrt_hz**2 * np.eye(3)
    accel = noise.accel_noise_density_m_s2_sqrt_hz**2 * np.eye(3)
    gyro_walk = noise.gyro_bias_walk_rad_s2_sqrt_hz**2 * np.eye(3)
    accel_walk = noise.accel_bias_walk_m_s3_sqrt_hz**2 * np.eye(3)
    mount, numerical = gtsam.Pose3(gtsam.Rot3(imu.R_bs), imu.xyz_b), 1e-10 * np.eye(3)
    omega_n = None if origin is None else earth_rate_n(origin.latitude_deg)
    kind = gtsam.PreintegrationCombinedParams if combined else gtsam.PreintegrationParams

    def of(gravity_n: Array) -> Any:
        parameters: Any = kind(gravity_n)
        if combined:
            parameters.setBiasAccCovariance(accel_walk)
            parameters.setBiasOmegaCovariance(gyro_walk)
        parameters.setGyroscopeCovariance(gyro)
        parameters.setAccelerometerCovariance(accel)
        parameters.setIntegrationCovariance(numerical)
        parameters.setBodyPSensor(mount)
        if omega_n is not None:
            parameters.setOmegaCoriolis(omega_n)
        return parameters

    return of


class Readings(NamedTuple):
    """Specific force (n, 3), rate (n, 3), and how long each reading lasts (n,)."""

    accel: Array
    gyro: Array
    dt: Array


@dataclass(frozen=True)
class InertialStep:
    """Readings from one keyframe to the next, preintegrated when that is first asked for.

    Attributes
    ----------
    k : int
        The keyframe that they lead to.
    bias : gtsam.imuBias.ConstantBias
        At which they are integrated.
    parameters : gtsam.PreintegrationParams
        Of this step alone: they hold its gravity.
    readings : callable
        Gives them, made anew each time: all of a mission's would take as much room as the IMU's
        samples.
    span_s : float
        From the one keyframe to the other.
    walking : gtsam.PreintegrationCombinedParams or None
        Of biases that walk meanwhile. The noise is then the combined form's: GTSAM's combined
        factor knows no NavState, and ties the walk of the biases to what it does to the motion;
        here the one is a factor of its own and the other widens the noise.
    """

    k: int
    bias: Any
    parameters: Any
    readings: Callable[[], Readings]
    span_s: float
    walking: Any = None

    @cached_property
    def pim(self) -> Any:
        """The preintegrated readings."""
        return self._integrated(gtsam.PreintegratedImuMeasurements(self.parameters, self.bias))

    @cached_property
    def factor(self) -> Any:
        """They as a factor between the two keyframes."""
        factor: Any = gtsam.ImuFactor2(X(self.k - 1), X(self.k), B(self.k - 1), self.pim)
        if self.walking is None:
            return factor
        combined = gtsam.PreintegratedCombinedMeasurements(self.walking, self.bias)
        cov = self._integrated(combined).preintMeasCov()[:9, :9]
        return factor.cloneWithNewNoiseModel(gtsam.noiseModel.Gaussian.Covariance(cov))

    def _integrated(self, pim: Any) -> Any:
        add, (accel, gyro, durations) = pim.integrateMeasurement, self.readings()
        for f, omega, dt in zip(list(accel), list(gyro), durations.tolist(), strict=True):
            add(f, omega, dt)
        return pim

    def predicted(self, before: Any, bias: Any) -> Any:
        """The state that the readings lead to from another."""
        return self.pim.predict(before, bias)

    def at(self, bias: Any) -> InertialStep:
        """The step at another bias; the same where it was integrated near enough to that."""
        if "pim" in vars(self) and self._second_order_sigmas(bias) < SECOND_ORDER_SIGMAS:
            return self
        return replace(self, bias=bias)

    def _second_order_sigmas(self, bias: Any) -> float:
        """What the linear factor leaves out of the velocity at a bias, in units of its noise.

        Readings that a bias turns by w t feel gravity off by g (w t)^2 / 2 along the vertical.
        """
        moved = float(np.linalg.norm(bias.gyroscope() - self.bias.gyroscope()))
        left_out_m_s = GRAVITY_M_S2 * moved**2 * self.span_s**3 / 6
        variance = float(self.parameters.getAccelerometerCovariance()[0, 0]) * self.span_s
        return left_out_m_s / float(np.sqrt(variance))
