"""The augmented state of the pose filter: the poses of all scans, with their joint covariance.

Mallios et al. 2014, section 4.3; and ahead of them what the paper takes for zero: the share by
which the ways between matched scans are too short, the angle by which dead-reckoned ones must be
turned, that by which the compass must be at the end of the newest scan, and how far the dead
reckoning has strayed by then from its mean over that scan. A measurement is of two poses and the
first, so that an update costs one pass over the covariance: three columns of ``P H'``, and a
correction of rank six.
"""

from __future__ import annotations

import numpy as np

from gtsam_nav.ekf.compounding import tail_to_tail
from gtsam_nav.errors import EstimationError
from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.series import IntArray

SCALE, MOTION, SHARED = 0, slice(1, 5), 5
"""Entries of the scale of matches and of the errors of the motion, and how many there are."""
LEAST_CONDITION = 1e-12
"""Of an innovation covariance, smallest over largest variance, that can still be inverted."""


class AugmentedState:
    """Poses (x, y, yaw) of scans in the order of time, with room for a given number of them.

    Parameters
    ----------
    capacity : int
        Scans that will be added.
    first : ndarray, shape (7,)
        Errors of the motion (misalignment, compass, north and east), and pose of the first scan.
    cov : ndarray, shape (7, 7)
    scale_sigma : float
        Spread of the share by which the ways between matched scans are too short.
    """

    def __init__(self, capacity: int, first: Array, cov: Array, scale_sigma: float = 0.0) -> None:
        size = SHARED + 3 * capacity
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
        return self._x[SHARED : self._size].reshape(-1, 3).copy()

    @property
    def newest(self) -> Array:
        """Errors of the motion, and the newest pose, shape (7,), a copy."""
        return self._x[self._moving]

    @property
    def cov(self) -> Array:
        """Joint covariance of all poses, shape (3 n, 3 n), a copy."""
        return self._P[SHARED : self._size, SHARED : self._size].copy()

    @property
    def marginals(self) -> Array:
        """Covariance of each pose, shape (n, 3, 3)."""
        return np.array([self.marginal(k) for k in range(self._n)])

    def marginal(self, k: int) -> Array:
        """Covariance of pose k, shape (3, 3)."""
        return self._P[_of(k), _of(k)].copy()

    def displacement(self, a: int, b: int) -> tuple[Array, Array]:
        """Pose b in pose a (3,), and its covariance (3, 3)."""
        q, J_a, J_b = tail_to_tail(self._x[_of(a)], self._x[_of(b)])
        J, entries = np.hstack([J_a, J_b]), np.r_[_of(a), _of(b)]
        return q, J @ self._P[np.ix_(entries, entries)] @ J.T

    def augment(self, new: Array, J: Array, cov_added: Array) -> None:
        """Add the next scan.

        Parameters
        ----------
        new : ndarray, shape (7,)
            Errors of the motion, and pose of the scan, as predicted from the newest.
        J : ndarray, shape (7, 7)
            Jacobian of the prediction.
        cov_added : ndarray, shape (7, 7)
            What the prediction's own noise adds.
        """
        moving, known = self._moving, slice(0, self._size)
        shared = J @ self._P[moving, known]
        own = shared[:, moving] @ J.T + cov_added
        self._n += 1
        moving = self._moving
        self._x[moving] = new
        self._P[moving, known] = shared
        self._P[known, moving] = shared.T
        self._P[np.ix_(moving, moving)] = 0.5 * (own + own.T)

    def update(self, a: int, b: int, q: Array, cov: Array, gate: float) -> Array:
        """Correct all poses by a measurement of pose b in pose a.

        Parameters
        ----------
        q : ndarray, shape (3,)
        cov : ndarray, shape (3, 3)
        gate : float
            Largest normalised innovation squared that is used.

        Returns
        -------
        ndarray, shape (3,)
            The innovation in uncorrelated standard deviations; infinite where its covariance is
            singular. The state is what it was where the sum of its squares exceeds the gate.
        """
        from gtsam_nav.ekf._rank_six import subtract_symmetric

        size = self._size
        expected, J_a, J_b = tail_to_tail(self._x[_of(a)], self._x[_of(b)])
        J_scale = np.array([-expected[0], -expected[1], 0.0])
        innovation = q - expected - J_scale * self._x[SCALE]
        innovation[2] = wrap_angle(innovation[2])
        PHt = self._P[:size, _of(a)] @ J_a.T + self._P[:size, _of(b)] @ J_b.T
        PHt += np.outer(self._P[:size, SCALE], J_scale)
        S = J_a @ PHt[_of(a)] + J_b @ PHt[_of(b)] + np.outer(J_scale, PHt[SCALE]) + cov
        S = 0.5 * (S + S.T)
        if not _is_invertible(S):
            return np.full(3, np.inf)
        whitened: Array = np.linalg.solve(np.linalg.cholesky(S), innovation)
        if not whitened @ whitened <= gate:
            return whitened
        K: Array = np.ascontiguousarray(np.linalg.solve(S, PHt.T).T)
        self._x[:size] += K @ innovation
        yaws = slice(SHARED + 2, size, 3)
        self._x[yaws] = wrap_angle(self._x[yaws])
        # Joseph's (I - K H) P (I - K H)' + K R K' is P - K (P H')' - (P H') K' + K S K'
        subtract_symmetric(self._P, PHt - 0.5 * K @ S, K)
        return whitened

    @property
    def _size(self) -> int:
        """Of what is known."""
        return SHARED + 3 * self._n

    @property
    def _moving(self) -> IntArray:
        """Entries that the next scan is predicted from."""
        return np.asarray(np.r_[MOTION, _of(self._n - 1)])


def _of(k: int) -> slice:
    """Entries of pose k."""
    return slice(SHARED + 3 * k, SHARED + 3 * k + 3)


def _is_invertible(S: Array) -> bool:
    """Whether an innovation covariance is positive definite, well away from singular."""
    if not np.all(np.isfinite(S)):
        raise EstimationError("the covariance of the poses is not finite")
    variances = np.linalg.eigvalsh(S)
    return bool(variances[0] > LEAST_CONDITION * variances[-1])
