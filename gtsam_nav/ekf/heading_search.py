"""A heading that no compass tells, found while the vehicle moves.

Two sources. Accelerations: the velocity that the inertial readings gain, turned by a wrong heading,
against the velocity that the receiver sees gained; the angle between the two is the heading's
error, whichever way the vehicle faces. And the course: what has moved for a while without such a
gain is taken to move forward.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtsam_nav.frames import Array

ACCELERATION_ERROR_M_S2 = 0.3
"""What tilt and bias make of the inertial readings before they are known."""
FOUND_SIGMA_RAD, LEAST_SIGMA_RAD = np.radians(10.0), np.radians(5.0)
LARGEST_REST = 0.2
"""Share of the gains that may differ."""
COURSE_SIGMA_RAD = np.radians(15.0)
"""How far a vehicle may point off its course."""
COURSE_SPEED_M_S, COURSE_SIGMAS, COURSE_AFTER_S = 1.0, 5.0, 5.0
LONGEST_STEP_S = 2.5
"""Velocities further apart say little: the vehicle turns in between."""


@dataclass(frozen=True)
class FoundHeading:
    """A correction of the yaw, clockwise, or a yaw itself; rad."""

    correction: float
    sigma: float


class HeadingSearch:
    """Compares what the inertial readings gain with what the receiver sees."""

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Begin anew."""
        self._last: tuple[float, complex, complex] | None = None
        self._agreement, self._energy = 0j, np.zeros(2)
        self._doubt, self._noise = 0.0, 0.0
        self._moving_since: float | None = None

    def by_acceleration(
        self, t: float, v_measured_n: Array, gained_n: Array, sigma: float
    ) -> FoundHeading | None:
        """Take a measured velocity in.

        Parameters
        ----------
        v_measured_n : ndarray, shape (3,)
        gained_n : ndarray, shape (3,)
            What the inertial readings have gained since some moment, in axes turned by the heading
            that is sought.
        sigma : float
            Of the measured velocity, m/s.
        """
        seen, felt = complex(*v_measured_n[:2]), complex(*gained_n[:2])
        last, self._last = self._last, (t, seen, felt)
        if last is None or t - last[0] > LONGEST_STEP_S:
            return None
        dt, gain_seen, gain_felt = t - last[0], seen - last[1], felt - last[2]
        self._agreement += np.conj(gain_felt) * gain_seen
        self._energy += np.array([abs(gain_felt) ** 2, abs(gain_seen) ** 2])
        self._doubt += ACCELERATION_ERROR_M_S2 * dt * abs(gain_seen)
        self._noise += 2 * sigma**2 * abs(gain_felt) ** 2
        strength = abs(self._agreement)
        # turned onto each other, what is felt must be what is seen
        if self._energy.sum() - 2 * strength > LARGEST_REST * self._energy.max():
            return None
        found = float(np.hypot(self._doubt, np.sqrt(self._noise))) / max(strength, 1e-12)
        if found > FOUND_SIGMA_RAD:
            return None
        return FoundHeading(float(np.angle(self._agreement)), max(found, LEAST_SIGMA_RAD))

    def by_course(self, t: float, v_n: Array, sigma: float, yaw: float) -> FoundHeading | None:
        """The course of an estimated velocity that has been fast for a while."""
        speed = float(np.hypot(v_n[0], v_n[1]))
        if speed < max(COURSE_SPEED_M_S, COURSE_SIGMAS * sigma):
            self._moving_since = None
            return None
        if self._moving_since is None:
            self._moving_since = t
        if t - self._moving_since < COURSE_AFTER_S:
            return None
        return FoundHeading(float(np.arctan2(v_n[1], v_n[0])) - yaw, COURSE_SIGMA_RAD)
