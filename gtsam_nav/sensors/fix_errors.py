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

APART = 3.0
"""Sigmas with a gap of such a factor between them, and none within it, are of two solutions."""


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
        level = own[:, :2].max(axis=1)
        for which in solutions(level, stretch) if noise.correlated_share > 0 else [stretch]:
            usual = np.median(own[which], axis=0)
            yield AlikeFixes(which, np.sqrt(noise.correlated_share * usual**2 + size**2))


def _offset(series: GnssSeries) -> Array:
    return np.zeros(len(series)) if series.offset_sigma is None else series.offset_sigma


def solutions(sigma: Array, among: BoolArray) -> list[BoolArray]:
    """The chosen fixes by the solution that they are of, as gaps between their sigmas (n,) tell;
    the best first."""
    stated = np.unique(sigma[among])
    last = np.flatnonzero(stated[1:] > APART * stated[:-1])
    of = np.searchsorted(stated[last], sigma)
    return [among & (of == k) for k in range(len(last) + 1) if np.any(among & (of == k))]
