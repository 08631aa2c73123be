"""Keyframes that a silent IMU leaves to their momentum: constant velocity and attitude.

Readings that stand for it would hold the bias at which they were made up: integrated at another
one, they would turn by the difference, and so measure the bias to be the first.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import gtsam
import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.graph.factors import X, nav_state

READING_S = 0.1
"""How long each reading lasts whose noise is integrated."""


@dataclass(frozen=True)
class CoastingStep:
    """A step without readings, whatever the biases are.

    Attributes
    ----------
    k : int
        The keyframe that it leads to.
    parameters : gtsam.PreintegrationParams
        Of this step alone: gravity, and the noise that readings would have to have, for as little
        to be known of the motion.
    force_b : ndarray, shape (3,)
        Specific force that holds the body against gravity, m/s^2.
    span_s : float
        From the one keyframe to the other.
    """

    k: int
    parameters: Any
    force_b: Array
    span_s: float

    @cached_property
    def factor(self) -> Any:
        """The two keyframes differ by the velocity's way."""
        pim = gtsam.PreintegratedImuMeasurements(self.parameters)
        n = int(np.ceil(self.span_s / READING_S))
        for _ in range(n):
            pim.integrateMeasurement(self.force_b, np.zeros(3), self.span_s / n)
        noise = gtsam.noiseModel.Gaussian.Covariance(pim.preintMeasCov())
        return gtsam.ConstantVelocityFactor(X(self.k - 1), X(self.k), self.span_s, noise)

    def at(self, _bias: Any) -> CoastingStep:
        """The same at any bias."""
        return self

    def predicted(self, before: Any, _bias: Any) -> Any:
        """The state that it leads to from another."""
        p_n = before.position() + self.span_s * before.velocity()
        return nav_state(before.attitude().matrix(), p_n, before.velocity())
