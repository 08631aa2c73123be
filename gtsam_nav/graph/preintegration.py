"""Inertial readings preintegrated into one factor, at the biases that are believed.

A preintegrated factor is linear in what the biases differ from those it was integrated at. A gyro's
0.02 rad/s turn 5 s of readings by 0.1 rad: of the second order of that, gravity makes 0.1 m/s and
0.1 m along the vertical, many times the readings' noise, which the rest of the solution would
bend to explain. So the readings are integrated once a bias is believed, and anew where that has
since moved so far that the second order counts beside their noise.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import gtsam
import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.graph.factors import B, X

GRAVITY_M_S2 = 9.8
SECOND_ORDER_SIGMAS = 0.03
"""What a gyro bias beside the one that readings were integrated at may make of their velocity by
its second order, in standard deviations of their own noise."""


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
    accel, gyro, dt : ndarray, shapes (n, 3), (n, 3) and (n,)
        Specific force, rate, and how long each lasts.
    walking : gtsam.PreintegrationCombinedParams or None
        Of biases that walk meanwhile. The noise is then the combined form's: GTSAM's combined
        factor knows no NavState, and ties the walk of the biases to what it does to the motion;
        here the one is a factor of its own and the other widens the noise.
    """

    k: int
    bias: Any
    parameters: Any
    accel: Array
    gyro: Array
    dt: Array
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
        add = pim.integrateMeasurement
        for f, omega, dt in zip(list(self.accel), list(self.gyro), self.dt.tolist(), strict=True):
            add(f, omega, dt)
        return pim

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
        span_s = float(np.sum(self.dt))
        left_out_m_s = GRAVITY_M_S2 * moved**2 * span_s**3 / 6
        variance = float(self.parameters.getAccelerometerCovariance()[0, 0]) * span_s
        return left_out_m_s / float(np.sqrt(variance))
