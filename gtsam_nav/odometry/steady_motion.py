"""A motion that goes on as it was: to where the next cloud is expected, and within a sweep."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from gtsam_nav.frames import Array


@dataclass(frozen=True)
class SteadyMotion:
    """Constant rates of turn and shift along the axes of a body.

    Attributes
    ----------
    rates : ndarray, shape (4, 4)
        Matrix whose exponential is the body's pose after 1 s in that before.
    span_s : float
        The time that they were found over.
    """

    rates: Array
    span_s: float

    @classmethod
    def through(cls, T_ab: Array, span_s: float) -> Self:
        """What carries a body from pose a to pose b, shape (4, 4), in a time."""
        from scipy.linalg import logm

        return cls(np.real(logm(T_ab)) / span_s, span_s)

    def over(self, span_s: float) -> Array:
        """Pose after a time in that before, shape (4, 4)."""
        from scipy.linalg import expm

        return np.asarray(expm(self.rates * span_s))


AT_REST = SteadyMotion(np.zeros((4, 4)), np.inf)
"""For as long as one likes."""
