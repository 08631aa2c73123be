"""The error that GNSS fixes share: one Gauss-Markov process for all that are alike.

A receiver's float solution is off by another error than its fixed one, and a stand-alone fix by
another than a differential one: the stated sigmas tell them apart.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.sensors.noise import GnssNoise
from gtsam_nav.series import BoolArray, GnssSeries

ALIKE = 2.0
"""Fixes whose sigmas are within this factor are off by the same process."""


@dataclass(frozen=True)
class AlikeFixes:
    """Fixes of one receiver that share an error.

    Attributes
    ----------
    which : ndarray of bool, shape (n,)
        Among the receiver's.
    shared_sigma : ndarray, shape (3,)
        Stationary spread of what they share, each axis, m; zero where they share nothing.
    """

    which: BoolArray
    shared_sigma: Array

    @property
    def share(self) -> bool:
        """Whether they share an error at all."""
        return bool(np.any(self.shared_sigma > 0))


def white_sigma(series: GnssSeries, noise: GnssNoise) -> Array:
    """Standard deviation of what each fix has for itself, shape (n, 3), m."""
    own = series.sigma**2 - _offset(series)[:, None] ** 2
    return np.asarray(np.sqrt(own * (1 - noise.correlated_share)))


def alike_fixes(series: GnssSeries, noise: GnssNoise) -> Iterator[AlikeFixes]:
    """A receiver's fixes by the error that they share; all together where they share none."""
    offset = _offset(series)
    own = np.sqrt(series.sigma**2 - offset[:, None] ** 2)
    for size in np.unique(offset):
        stretch = offset == size
        for which in _octaves(own[:, :2].max(axis=1), stretch, noise.correlated_share):
            usual = np.median(own[which], axis=0)
            yield AlikeFixes(which, np.sqrt(noise.correlated_share * usual**2 + size**2))


def _offset(series: GnssSeries) -> Array:
    return np.zeros(len(series)) if series.offset_sigma is None else series.offset_sigma


def _octaves(sigma: Array, among: BoolArray, share: float) -> Iterator[BoolArray]:
    """The chosen fixes, apart where their sigmas are more than `ALIKE` times the least."""
    while np.any(among):
        least = float(np.min(sigma[among]))
        which = among & (sigma <= ALIKE * least) if share > 0 else among
        yield which
        among = among & ~which
