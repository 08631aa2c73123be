"""How the slow error of a compass carries over from one time to another.

It is a first-order Gauss-Markov process (Gelb, *Applied Optimal Estimation*, 1974, section 3.8).
Over a while its mean turns the way that is dead-reckoned, its value at the end the heading; both
share much of what it was at the beginning.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission
from gtsam_nav.sensors.noise import HeadingNoise

SHORTEST = 1e-4
"""Of the correlation time: so that the differences below keep their digits."""


@dataclass(frozen=True)
class CompassDrift:
    """Spread of the error, rad, and the time over which it forgets itself, s."""

    sigma: float
    time_s: float

    @classmethod
    def of(cls, mission: Mission) -> CompassDrift | None:
        """As the card of the compass states it; None without a compass."""
        compass = mission.first("heading")
        if compass is None:
            return None
        noise = HeadingNoise.model_validate(compass.noise)
        return cls(float(np.radians(noise.disturbance_sigma_deg)), noise.disturbance_time_s)

    def kept(self, elapsed_s: Array) -> Array:
        """Shares of an error that its mean over times (...) and its ends keep, shape (..., 2)."""
        a = self._elapsed(elapsed_s)
        return np.stack([_mean_share(a), np.exp(-a)], axis=-1)

    def gained(self, elapsed_s: Array) -> Array:
        """Covariance of mean and end where the error at the beginning is known, (..., 2, 2)."""
        a = self._elapsed(elapsed_s)
        g, end = _mean_share(a), np.exp(-a)
        mean2, both, end2 = 2 * (1 - g) / a - g**2, g * (1 - end), 1 - end**2
        rows = [np.stack([mean2, both], axis=-1), np.stack([both, end2], axis=-1)]
        return np.asarray(self.sigma**2 * np.stack(rows, axis=-2))

    def whole(self, elapsed_s: Array) -> Array:
        """Covariance of mean and end where nothing is known, (..., 2, 2)."""
        return self.gained(elapsed_s) + self.sigma**2 * _squared(self.kept(elapsed_s))

    def change(self, elapsed_s: Array) -> Array:
        """Covariance of mean and end less the error at the beginning, (..., 2, 2)."""
        return self.gained(elapsed_s) + self.sigma**2 * _squared(self.kept(elapsed_s) - 1.0)

    def mean_variance(self, span_s: float) -> float:
        """Variance of the error's mean over a span, rad^2."""
        a = self._elapsed(np.array(span_s))
        return float(self.sigma**2 * 2 * (1 - _mean_share(a)) / a)

    def middle_variance(self, span_s: float) -> float:
        """Variance of the error in the middle of a span less its mean over the span, rad^2."""
        if span_s == 0.0:
            return 0.0
        a = self._elapsed(np.array(span_s))
        shared = 2 * _mean_share(a / 2)
        return self.mean_variance(span_s) + float(self.sigma**2 * (1 - shared))

    def _elapsed(self, elapsed_s: Array) -> Array:
        return np.maximum(elapsed_s / self.time_s, SHORTEST)


def _mean_share(a: Array) -> Array:
    return np.asarray(-np.expm1(-a) / a)


def _squared(rows: Array) -> Array:
    return np.asarray(rows[..., :, None] * rows[..., None, :])
