"""A bank of planar landmark filters that differ in what they took their sightings for.

Each is an extended Kalman filter over the pose, the lasting errors of the dead reckoning and its
own landmarks; all take the same steps at once, stacked. Smith, Self and Cheeseman, *Estimating
uncertain spatial relationships in robotics*, 1990.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.preprocess.landmark_drift import Drift
from gtsam_nav.preprocess.planar_motion import Increments
from gtsam_nav.series import BoolArray, IntArray

POSITION, COURSE, POSE = slice(0, 2), 2, slice(0, 3)
LEAST_VARIANCE = 1e-10
"""Of an increment and of the start, m^2 or rad^2."""


@dataclass(eq=False)
class FilterBank:
    """The h filters of a bank, with room for c landmarks each.

    Attributes
    ----------
    x : ndarray, shape (h, 3 + e + 2 c)
        Pose n, e, course, the e errors of a `Drift`, landmarks n, e.
    P : ndarray, shape (h, 3 + e + 2 c, 3 + e + 2 c)
    count : ndarray of int, shape (h,)
        How many landmarks each knows.
    first : int
        Where the landmarks' coordinates begin, 3 + e.
    """

    x: Array
    P: Array
    count: IntArray
    first: int

    @classmethod
    def at_origin(cls, drift_sigma: Array) -> FilterBank:
        """One filter, whose frame is that of its first pose, without landmarks."""
        variance = LEAST_VARIANCE + np.concatenate([np.zeros(3), drift_sigma**2])
        first = len(variance)
        return cls(
            np.zeros((1, first)), np.diag(variance)[None], np.zeros(1, dtype=np.int64), first
        )

    def __len__(self) -> int:
        return len(self.x)

    @property
    def room(self) -> int:
        """Landmarks that each filter has room for."""
        return int(self.x.shape[1] - self.first) // 2

    def chosen(self, which: IntArray) -> FilterBank:
        """Some of the filters, or copies of them, without room that none needs."""
        size = self.first + 2 * int(np.max(self.count[which], initial=0))
        if size == self.x.shape[1] and np.array_equal(which, np.arange(len(self))):
            return self
        return FilterBank(
            self.x[which, :size],
            self.P[which][:, :size, :size],
            self.count[which].copy(),
            self.first,
        )

    def move(self, increments: Increments, drift: Drift, k: int) -> None:
        """Predict over step k: forward and to starboard, m, clockwise, rad."""
        x, P, first = self.x, self.P, self.first
        errors = slice(3, first)
        R = rotations(x[:, COURSE])
        lacking = drift.displacement[k]
        moved = R @ increments.displacement_b[k] + (R @ lacking @ x[:, errors, None])[..., 0]
        F: Array = np.tile(np.eye(first), (len(x), 1, 1))
        F[:, 0, COURSE], F[:, 1, COURSE] = -moved[:, 1], moved[:, 0]
        F[:, POSITION, errors] = R @ lacking
        F[:, COURSE, errors] = drift.turn[k]
        F[:, errors, errors] = drift.transition[k]
        x[:, POSITION] += moved
        x[:, COURSE] += increments.turn[k] + x[:, errors] @ drift.turn[k]
        x[:, errors] = x[:, errors] @ drift.transition[k].T
        P[:, :first] = F @ P[:, :first]
        P[:, :, :first] = P[:, :, :first] @ np.swapaxes(F, 1, 2)
        noise = np.maximum(increments.variance[k], LEAST_VARIANCE)
        P[:, POSITION, POSITION] += R @ (noise[:2, None] * np.swapaxes(R, 1, 2))
        P[:, COURSE, COURSE] += noise[2]
        P[:, errors, errors] += drift.noise[k]

    def compare(self, p_b: Array, cov_b: Array) -> tuple[Array, Array]:
        """A sighting against every landmark.

        Returns
        -------
        nis : ndarray, shape (h, c)
            Squared normalised innovations; infinite where a filter has fewer landmarks.
        surprise : ndarray, shape (h, c)
            Log of how much wider than the sighting's own the innovation's covariance is.
        """
        h, c = len(self), self.room
        seems_b, to_body = self._seems(np.arange(c))
        J = np.zeros((h, c, 2, 3))
        J[..., :2] = -to_body
        J[..., 0, 2], J[..., 1, 2] = seems_b[..., 1], -seems_b[..., 0]
        shared = np.swapaxes(self.P[:, POSE, self.first :].reshape(h, 3, c, 2), 1, 2)
        each = np.arange(c)
        own = np.moveaxis(
            self.P[:, self.first :, self.first :].reshape(h, c, 2, c, 2)[:, each, :, each], 0, 1
        )
        to_map = np.swapaxes(to_body, 2, 3)
        half = J @ shared @ to_map + 0.5 * (
            J @ self.P[:, None, POSE, POSE] @ np.swapaxes(J, 2, 3) + to_body @ own @ to_map + cov_b
        )
        S = half + np.swapaxes(half, 2, 3)
        off = p_b - seems_b
        nis = np.sum(off * np.linalg.solve(S, off[..., None])[..., 0], axis=2)
        nis[each >= self.count[:, None]] = np.inf
        return nis, np.linalg.slogdet(S)[1] - np.linalg.slogdet(cov_b)[1]

    def _seems(self, landmarks: IntArray) -> tuple[Array, Array]:
        """Where landmarks (c,) or (h, c) are seen in the body's axes, (h, c, 2), and the rotation
        to them (h, 1, 2, 2)."""
        h = np.arange(len(self))[:, None]
        first = self.first + 2 * landmarks
        p = np.stack([self.x[h, first], self.x[h, first + 1]], axis=2)
        to_body = np.swapaxes(rotations(self.x[:, COURSE]), 1, 2)[:, None]
        off = p - self.x[:, None, POSITION]
        return (to_body @ off[..., None])[..., 0], to_body

    def take(self, landmark: IntArray, p_b: Array, cov_b: Array) -> None:
        """Take a sighting for one of the landmarks in each filter; for a new one where that is
        the filter's ``count``."""
        new: BoolArray = landmark == self.count
        if np.any(landmark[new] == self.room):
            self.x = np.pad(self.x, ((0, 0), (0, 2)))
            self.P = np.pad(self.P, ((0, 0), (0, 2), (0, 2)))
        for f in np.flatnonzero(new).tolist():
            self._add(f, p_b, cov_b)
        self._update(np.flatnonzero(~new), landmark, p_b, cov_b)

    def _add(self, f: int, p_b: Array, cov_b: Array) -> None:
        x, P = self.x[f], self.P[f]
        first = self.first + 2 * int(self.count[f])
        own = slice(first, first + 2)
        R = rotations(x[COURSE])
        arm = R @ p_b
        G = np.eye(2, 3)
        G[:, 2] = -arm[1], arm[0]
        x[own] = x[POSITION] + arm
        P[own] = G @ P[POSE]
        P[:, own] = P[own].T
        P[own, own] = G @ P[POSE, POSE] @ G.T + R @ cov_b @ R.T
        self.count[f] += 1

    def _update(self, which: IntArray, landmark: IntArray, p_b: Array, cov_b: Array) -> None:
        if not len(which):
            return
        seems_b, to_body = self._seems(np.minimum(landmark, self.room - 1)[:, None])
        seems_b, to_body = seems_b[which, 0], to_body[which, 0]
        J = np.zeros((len(which), 2, 5))
        J[:, :, :2], J[:, :, 3:] = -to_body, to_body
        J[:, 0, 2], J[:, 1, 2] = seems_b[:, 1], -seems_b[:, 0]
        own = self.first + 2 * landmark[which, None] + np.arange(2)
        columns = np.column_stack([np.tile([0, 1, 2], (len(which), 1)), own])
        JP = J @ self.P[which[:, None], columns]
        S = np.take_along_axis(JP, columns[:, None], 2) @ np.swapaxes(J, 1, 2) + cov_b
        K = np.swapaxes(np.linalg.solve(S, JP), 1, 2)
        self.x[which] += (K @ (p_b - seems_b)[..., None])[..., 0]
        P = self.P[which] - K @ JP
        # asymmetry would grow
        self.P[which] = 0.5 * (P + np.swapaxes(P, 1, 2))


def rotations(angle: Array) -> Array:
    """From the axes of a course to the map's, shape (..., 2, 2)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.moveaxis(np.array([[c, -s], [s, c]]), (0, 1), (-2, -1))
