"""How much of a compass's slow error its means over several spans of time share.

The error is a stationary process: a first-order Gauss-Markov one (Gelb, *Applied Optimal
Estimation*, 1974, section 3.8), or, where what disturbs the compass changes smoothly on the way, as
it does past walls, one whose correlation falls off as a Gaussian. The mean over the beams of a scan
turns the scan, the one over a way the way, and the value at a time the heading: means all of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission
from gtsam_nav.sensors.noise import HeadingNoise
from gtsam_nav.sensors.orientation import headings_true

SHORTEST = 1e-3
"""Span, in correlation times, that stands for a single time: the differences keep their digits."""


@dataclass(frozen=True)
class CompassDrift:
    """Spread of the error, rad, the time over which it forgets itself, s, and whether smoothly."""

    sigma: float
    time_s: float
    smooth: bool = False

    @classmethod
    def of(cls, mission: Mission) -> CompassDrift | None:
        """As the card of the compass states it; None without a compass."""
        compass = mission.first("heading")
        if compass is None:
            return None
        noise = HeadingNoise.model_validate(compass.noise)
        sigma = float(np.radians(noise.disturbance_sigma_deg))
        return cls(sigma, noise.disturbance_time_s, noise.disturbance_smooth)

    def covariance(self, spans_s: Array) -> Array:
        """Covariance (..., m, m), rad^2, of the error's means over spans (..., m, 2) of time.

        Each span is from its begin to its end, s; without length it is a single time.
        """
        middle = spans_s.mean(axis=-1)
        half = 0.5 * np.maximum(np.diff(spans_s)[..., 0], SHORTEST * self.time_s)
        cov = np.empty((*middle.shape, middle.shape[-1]))
        for i in range(middle.shape[-1]):
            for j in range(i + 1):
                apart, a, b = middle[..., i] - middle[..., j], half[..., i], half[..., j]
                corners = self._mixed(apart, a + b) - self._mixed(apart, a - b)
                cov[..., i, j] = cov[..., j, i] = self.sigma**2 * corners / (4 * a * b)
        return cov

    def changes(self, begin_s: Array, end_s: Array) -> Array:
        """Covariance (m, m), rad^2, of how the error changes from begin to end of m spans, s."""

        def shared(a: Array, b: Array) -> Array:
            apart = np.abs(a[:, None] - b) / self.time_s
            return np.asarray(np.exp(-(apart**2) if self.smooth else -apart))

        ahead = shared(end_s, end_s) - shared(end_s, begin_s)
        return self.sigma**2 * (ahead - shared(begin_s, end_s) + shared(begin_s, begin_s))

    def _mixed(self, apart_s: Array, reach_s: Array) -> Array:
        return self._twice_integrated(apart_s + reach_s) + self._twice_integrated(apart_s - reach_s)

    def _twice_integrated(self, lag_s: Array) -> Array:
        """Second integral of the correlation over the lag, from zero on, s^2."""
        a = np.abs(lag_s) / self.time_s
        if not self.smooth:
            return np.asarray(self.time_s**2 * (a + np.expm1(-a)))
        from scipy.special import erf

        halved = 0.5 * np.sqrt(np.pi) * a * erf(a) + 0.5 * np.expm1(-(a**2))
        return np.asarray(self.time_s**2 * halved)


def mean_white_variance(mission: Mission, variance: Array, beams_s: Array) -> Array:
    """Variance (n,) of the mean of a compass's white noise over the beams of each scan, rad^2.

    At the most the variance (n,) that the filter states at the scans' reference times.
    """
    headings = headings_true(mission)
    if headings is None:
        return np.zeros(len(beams_s))
    begin = np.searchsorted(headings.t, beams_s[:, 0])
    end = np.searchsorted(headings.t, beams_s[:, 1], side="right")
    summed = np.append(0.0, np.cumsum(headings.sigma**2))
    inside = np.maximum(end - begin, 1)
    of_mean = (summed[end] - summed[begin]) / inside**2
    return np.asarray(np.where(inside < 2, variance, np.minimum(variance, of_mean)))
