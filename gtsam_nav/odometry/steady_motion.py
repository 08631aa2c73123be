"""A motion that goes on as it was: to where the next cloud is expected, and within a sweep."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Self

import numpy as np

from gtsam_nav.frames import Array, skew
from gtsam_nav.registration.open3d_icp import homogeneous

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
    turn_rate : ndarray, shape (3,)
        Along the axes of the body, rad/s.
    velocity : ndarray, shape (3,)
        Along the same axes, which turn with it, m/s.
    span_s : float
        The time that they were found over.
    """

    turn_rate: Array
    velocity: Array
    span_s: float

    @classmethod
    def through(cls, T_ab: Array, span_s: float) -> Self:
        """What carries a body from pose a to pose b, shape (4, 4), in a time."""
        from scipy.spatial.transform import Rotation

        # in closed form: scipy's logarithm of a matrix draws random numbers
        turn = Rotation.from_matrix(T_ab[:3, :3]).as_rotvec()
        shift = np.asarray(np.linalg.solve(_mean_rotation(turn), T_ab[:3, 3]), float)
        return cls(turn / span_s, shift / span_s, span_s)

    def over(self, span_s: float) -> Array:
        """Pose after a time in that before, shape (4, 4)."""
        from scipy.spatial.transform import Rotation

        turn = self.turn_rate * span_s
        shift = _mean_rotation(turn) @ self.velocity * span_s
        return homogeneous(Rotation.from_rotvec(turn).as_matrix(), shift)


def _mean_rotation(turn: Array) -> Array:
    """Mean of the rotations (3, 3) that a body has while it turns by a vector (3,), in rad.

    Barfoot, *State Estimation for Robotics* (2017), eq. 7.77: the left Jacobian of the rotation.
    """
    angle = float(np.linalg.norm(turn))
    across = skew(turn / angle if angle else turn)
    half = angle / 2
    return np.asarray(
        np.eye(3)
        + np.sin(half) * np.sinc(half / np.pi) * across
        + (1.0 - np.sinc(angle / np.pi)) * across @ across
    )


AT_REST = SteadyMotion(np.zeros(3), np.zeros(3), np.inf)
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
