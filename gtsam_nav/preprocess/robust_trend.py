"""A level with a local trend, smoothed from readings of which some are gross errors."""

from __future__ import annotations

import numpy as np

from gtsam_nav.frames import Array

CAUCHY_K2 = 2.385**2
"""95 % as efficient as least squares where nothing is wrong."""
NARROWING = 4.0
"""The kernel's squared scale shrinks by this factor a round, from what lets every reading in."""
LAST_ROUNDS = 4


def robust_trend(
    t: Array,
    z: Array,
    sigma: Array,
    level_density: float,
    trend_density: float,
    trend_variance: float,
) -> tuple[Array, Array]:
    """Smooth readings under a Cauchy kernel that narrows from round to round.

    A reading is judged by its residual against what the others predict, for a flexible trend
    follows any single reading; its components stand or fall together.

    Parameters
    ----------
    t : ndarray, shape (n,)
    z, sigma : ndarray, shape (n, m)
        Readings and their standard deviations.
    level_density, trend_density, trend_variance : float
        As `smooth_trend` takes them.

    Returns
    -------
    level, trend : ndarray, shape (n, m)
    """
    from gtsam_nav.preprocess._trend import smooth_trend

    variance = sigma**2
    weight, scale2, last = np.ones(len(t)), np.inf, 0
    level, trend, spread = np.empty_like(z), np.empty_like(z), np.empty_like(z)
    while last < LAST_ROUNDS:
        for axis in range(z.shape[1]):
            level[:, axis], trend[:, axis], spread[:, axis], _ = smooth_trend(
                t,
                np.ascontiguousarray(z[:, axis]),
                variance[:, axis] / weight,
                level_density,
                trend_density,
                trend_variance,
                np.inf,
            )
        own = np.maximum(1.0 - weight[:, None] * spread / variance, 1e-9)
        squared = (z - level) ** 2 / (variance * own * (own + spread / variance))
        surprise = np.mean(squared, axis=1)
        scale2 = max(1.0, min(scale2 / NARROWING, float(np.max(surprise))))
        weight = 1.0 / (1.0 + surprise / (CAUCHY_K2 * scale2))
        last += scale2 == 1.0
    return level, trend
