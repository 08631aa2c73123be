"""A motion that goes on as it was: to where the next cloud is expected, and within a sweep."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Self

import numpy as np

from gtsam_nav.frames import Array

PACE_INTERVALS = 4
"""The latest ones, whose median is the pace: even, since of pairs each other one is short."""
SHORT = 0.5
"""An interval of a smaller share of the pace is jitter of the stamps."""
SWEEP_SHARE = 0.9
"""A sweep begins after the one before it, nearly: no motion takes less of its span."""


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

        rates = np.real(logm(T_ab)) / span_s
        # rounding that is no turn would grow with the time
        rates[:3, :3] = 0.5 * (rates[:3, :3] - rates[:3, :3].T)
        rates[3] = 0.0
        return cls(rates, span_s)

    def over(self, span_s: float) -> Array:
        """Pose after a time in that before, shape (4, 4)."""
        from scipy.linalg import expm

        return np.asarray(expm(self.rates * span_s))


AT_REST = SteadyMotion(np.zeros((4, 4)), np.inf)
"""For as long as one likes."""


class Wake:
    """Where a body was of late: what tells its motion though stamps jitter or come in bursts."""

    def __init__(self) -> None:
        self._intervals: deque[float] = deque(maxlen=PACE_INTERVALS)
        self._poses: deque[tuple[float, Array]] = deque(maxlen=PACE_INTERVALS + 1)

    @property
    def pace_s(self) -> float:
        """The usual time between poses; infinite as long as fewer than three are known."""
        n = len(self._intervals) // 2 * 2
        return float(np.median(list(self._intervals)[-n:])) if n else np.inf

    def add(self, t: float, T_ob: Array) -> None:
        """Go on to a pose, shape (4, 4)."""
        if self._poses:
            self._intervals.append(t - self._poses[-1][0])
        self._poses.append((t, T_ob))

    def break_off(self, t: float, T_ob: Array) -> None:
        """Begin anew in a pose, shape (4, 4): the next ones may go on at the pace of this gap."""
        if self._poses:
            self._intervals.extend([t - self._poses[-1][0]] * PACE_INTERVALS)
        self._poses.clear()
        self._poses.append((t, T_ob))

    def motion_to(self, t: float, T_ob: Array, sweep_s: float) -> SteadyMotion:
        """Motion to a pose, shape (4, 4), at a time.

        Over the last interval, or as many as make no short one: the motion over an interval that
        jitter cut short is much faster than the body.

        Parameters
        ----------
        t : float
        T_ob : ndarray, shape (4, 4)
        sweep_s : float
            How long the sweep took that ended in it.
        """
        sweep_s = SWEEP_SHARE * sweep_s
        least_s = max(SHORT * self.pace_s if np.isfinite(self.pace_s) else 0.0, sweep_s)
        long_ago = ((t_a, T_oa) for t_a, T_oa in reversed(self._poses) if t - t_a >= least_s)
        t_a, T_oa = next(long_ago, self._poses[0])
        return SteadyMotion.through(np.linalg.inv(T_oa) @ T_ob, max(t - t_a, sweep_s))
