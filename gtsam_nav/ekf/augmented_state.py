"""The augmented state of the pose filter: the poses of all scans, with their joint covariance.

Mallios et al. 2014, section 4.3; and ahead of them what the paper takes for zero: the share by
which the ways between matched scans are too short, the angle by which dead-reckoned ones must be
turned, that by which the compass must be at the end of the newest scan, and the errors of the
motion within that scan and the one before, which all their matches share. A measurement is of two
poses and of these, so that an update costs one pass over the covariance: three columns of
``P H'``, and a correction of rank six.
"""

from __future__ import annotations

import numpy as np

from gtsam_nav.ekf.compounding import tail_to_tail
from gtsam_nav.errors import EstimationError
from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.series import IntArray

SCALE, TURNED, WITHIN = 0, slice(1, 3), 3
"""Entries of the scale of matches, of both angles, and from where on errors within scans stand."""
LEAST_CONDITION = 1e-12
"""Of an innovation covariance, smallest over largest variance, that can still be inverted."""


class AugmentedState:
    """Poses (x, y, yaw) of scans in the order of time, with room for a given number of them.

    Parameters
    ----------
    capacity : int
        Scans that will be added.
    first : ndarray, shape (m + 5,)
        Errors of the motion (misalignment, compass, m within the scan) and pose of the first scan.
    cov : ndarray, shape (m + 5, m + 5)
    scale_sigma : float
        Spread of the share by which the ways between matched scans are too short.
    """

    def __init__(self, capacity: int, first: Array, cov: Array, scale_sigma: float = 0.0) -> None:
        self._m = len(first) - 5
        self._shared = WITHIN + 2 * self._m
        size = self._shared + 3 * capacity
        self._x, self._P = np.zeros(size), np.zeros((size, size))
        self._P[SCALE, SCALE] = scale_sigma**2
        self._n = 1
        self._x[self._moving] = first
        self._P[np.ix_(self._moving, self._moving)] = cov

    def __len__(self) -> int:
        return self._n

    @property
    def poses(self) -> Array:
        """Shape (n, 3), a copy."""
        return self._x[self._shared : self._size].reshape(-1, 3).copy()

    @property
    def newest(self) -> Array:
        """Errors of the motion, and the newest pose, shape (m + 5,), a copy."""
        return self._x[self._moving]

    @property
    def cov(self) -> Array:
        """Joint covariance of all poses, shape (3 n, 3 n), a copy."""
        known = slice(self._shared, self._size)
        return self._P[known, known].copy()

    @property
    def marginals(self) -> Array:
        """Covariance of each pose, shape (n, 3, 3)."""
        return np.array([self.marginal(k) for k in range(self._n)])

    def marginal(self, k: int) -> Array:
        """Covariance of pose k, shape (3, 3)."""
        return self._P[self._of(k), self._of(k)].copy()

    def displacement(self, a: int, b: int) -> tuple[Array, Array]:
        """Pose b in pose a (3,), and its covariance (3, 3)."""
        q, J_a, J_b = tail_to_tail(self._x[self._of(a)], self._x[self._of(b)])
        J, entries = np.hstack([J_a, J_b]), np.r_[self._of(a), self._of(b)]
        return q, J @ self._P[np.ix_(entries, entries)] @ J.T

    def augment(self, new: Array, J: Array, cov_added: Array) -> None:
        """Add the next scan.

        Parameters
        ----------
        new : ndarray, shape (m + 5,)
            Errors of the motion, and pose of the scan, as predicted from the newest.
        J : ndarray, shape (m + 5, m + 5)
            Jacobian of the prediction.
        cov_added : ndarray, shape (m + 5, m + 5)
            What the prediction's own noise adds.
        """
        self._x[self._within_last] = self._x[self._within]
        self._P[self._within_last, :] = self._P[self._within, :]
        self._P[:, self._within_last] = self._P[:, self._within]
        moving, known = self._moving, slice(0, self._size)
        shared = J @ self._P[moving, known]
        own = shared[:, moving] @ J.T + cov_added
        self._n += 1
        moving = self._moving
        self._x[moving] = new
        self._P[moving, known] = shared
        self._P[known, moving] = shared.T
        self._P[np.ix_(moving, moving)] = 0.5 * (own + own.T)

    def update(
        self, a: int, b: int, q: Array, cov: Array, gate: float, bends: Array | None = None
    ) -> Array:
        """Correct all poses by a measurement of pose b in pose a.

        Parameters
        ----------
        q : ndarray, shape (3,)
        cov : ndarray, shape (3, 3)
        gate : float
            Largest normalised innovation squared that is used.
        bends : ndarray, shape (3, 2 m), or None
            How the measurement answers to the errors within the scan before the newest and within
            the newest; cov does not count that.

        Returns
        -------
        ndarray, shape (3,)
            The innovation in uncorrelated standard deviations; infinite where its covariance is
            singular. The state is what it was where the sum of its squares exceeds the gate.
        """
        from gtsam_nav.ekf._rank_six import subtract_symmetric

        size = self._size
        expected, J_a, J_b = tail_to_tail(self._x[self._of(a)], self._x[self._of(b)])
        J_scale = np.array([-expected[0], -expected[1], 0.0])
        shared = np.column_stack([J_scale, np.zeros((3, 2 * self._m)) if bends is None else bends])
        entries = np.r_[SCALE, WITHIN : self._shared]
        innovation = q - expected - shared @ self._x[entries]
        innovation[2] = wrap_angle(innovation[2])
        PHt = self._P[:size, self._of(a)] @ J_a.T + self._P[:size, self._of(b)] @ J_b.T
        PHt += self._P[:size, entries] @ shared.T
        S = J_a @ PHt[self._of(a)] + J_b @ PHt[self._of(b)] + shared @ PHt[entries] + cov
        S = 0.5 * (S + S.T)
        if not _is_invertible(S):
            return np.full(3, np.inf)
        whitened: Array = np.linalg.solve(np.linalg.cholesky(S), innovation)
        if not whitened @ whitened <= gate:
            return whitened
        K: Array = np.ascontiguousarray(np.linalg.solve(S, PHt.T).T)
        self._x[:size] += K @ innovation
        yaws = slice(self._shared + 2, size, 3)
        self._x[yaws] = wrap_angle(self._x[yaws])
        # Joseph's (I - K H) P (I - K H)' + K R K' is P - K (P H')' - (P H') K' + K S K'
        subtract_symmetric(self._P, PHt - 0.5 * K @ S, K)
        return whitened

    @property
    def _size(self) -> int:
        """Of what is known."""
        return self._shared + 3 * self._n

    @property
    def _moving(self) -> IntArray:
        """Entries that the next scan is predicted from."""
        return np.asarray(np.r_[TURNED, self._within, self._of(self._n - 1)])

    @property
    def _within_last(self) -> slice:
        """Entries of the errors within the scan before the newest."""
        return slice(WITHIN, WITHIN + self._m)

    @property
    def _within(self) -> slice:
        """Entries of the errors within the newest scan."""
        return slice(WITHIN + self._m, self._shared)

    def _of(self, k: int) -> slice:
        """Entries of pose k."""
        return slice(self._shared + 3 * k, self._shared + 3 * k + 3)


def _is_invertible(S: Array) -> bool:
    """Whether an innovation covariance is positive definite, well away from singular."""
    if not np.all(np.isfinite(S)):
        raise EstimationError("the covariance of the poses is not finite")
    variances = np.linalg.eigvalsh(S)
    return bool(variances[0] > LEAST_CONDITION * variances[-1])
