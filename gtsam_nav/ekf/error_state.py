"""The error-state filter: an inertial state, shared sensor errors, and the covariance of both.

The first 15 errors are those of `strapdown`. Where a sensor's noise model says that successive
readings share an error (a compass's bias, the drift of GNSS), that error follows as a first-order
Gauss-Markov state of its own; white noise would be a lie there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gtsam_nav.ekf.strapdown import NU, RHO, SIZE, THETA, InertialState, Strapdown
from gtsam_nav.frames import Array, skew
from gtsam_nav.solution import Innovations

LARGE_TURN_RAD = 1e-3
"""Below this a correction leaves the axes of the other errors where they are."""
ROUNDING = 1e-10
"""Share of the variances that go into an innovation's which is no more than rounding."""
UNKNOWN_YAW_RAD = float(np.radians(20.0))
"""A heading as uncertain as this is not known: the errors are no longer linear in it."""


@dataclass(frozen=True)
class SharedErrors:
    """First-order Gauss-Markov errors of one sensor: stationary spreads (m,) and times (m,), s.

    An infinite time is a constant.
    """

    sigma: Array
    time_s: Array

    def __len__(self) -> int:
        return len(self.sigma)


@dataclass(frozen=True)
class Update:
    """A measurement against the filter's state.

    Attributes
    ----------
    residual : ndarray, shape (m,)
        Predicted less measured.
    H : ndarray, shape (m, n)
        Jacobian of the residual in all errors of the filter.
    R : ndarray, shape (m, m)
        Covariance of the measurement.
    S_inverse : ndarray, shape (m, m), or None
        Inverse of the residual's covariance; None where that is singular.
    nis : float
        Normalised innovation squared; NaN where it is singular.
    """

    residual: Array
    H: Array
    R: Array
    S_inverse: Array | None
    nis: float

    @property
    def whitened(self) -> Array:
        """The residual in units of its standard deviations, uncorrelated, shape (m,)."""
        assert self.S_inverse is not None
        return np.asarray(np.linalg.cholesky(self.S_inverse).T @ self.residual)


def innovations(used: Sequence[tuple[float, Array]]) -> Innovations | None:
    """Times and whitened residuals of what was used; one reading makes no statistics."""
    if len(used) < 2:
        return None
    whitened = np.array([residual for _, residual in used])
    t = np.array([time_s for time_s, _ in used])
    return Innovations(t, np.sum(whitened**2, axis=1), whitened.shape[1], whitened)


@dataclass(frozen=True)
class Node:
    """The filter at one time, for the smoother.

    Attributes
    ----------
    state : InertialState
        With all measurements up to and at its time.
    shared : ndarray
        The shared errors.
    P : ndarray, shape (n, n)
    P_predicted : ndarray, shape (n, n)
        Before the measurements of its time.
    Phi : ndarray, shape (n, n)
        From the node before.
    correction : ndarray, shape (n,)
        What the measurements of its time changed.
    """

    state: InertialState
    shared: Array
    P: Array
    P_predicted: Array
    Phi: Array
    correction: Array

    @property
    def yaw_unknown(self) -> bool:
        """Whether the heading is too uncertain for what is linear in it."""
        return yaw_variance(self.state, self.P) > UNKNOWN_YAW_RAD**2


def yaw_variance(state: InertialState, P: Array) -> float:
    """Variance of the heading, rad^2, by the covariance of a state's errors."""
    down_b = state.body.R_nb[2]
    return float(down_b @ P[THETA, THETA] @ down_b)


class ErrorStateFilter:
    """Closed-loop error-state Kalman filter.

    Parameters
    ----------
    strapdown : Strapdown
    state : InertialState
    P : ndarray, shape (15, 15)
        Of the inertial errors at the start.
    shared : SharedErrors
        Of all sensors, one after another.
    """

    def __init__(
        self, strapdown: Strapdown, state: InertialState, P: Array, shared: SharedErrors
    ) -> None:
        self.strapdown, self.state = strapdown, state
        self.size = SIZE + len(shared)
        self.shared, self._errors = np.zeros(len(shared)), shared
        self.P = np.zeros((self.size, self.size))
        self.P[:SIZE, :SIZE] = P
        self.P[SIZE:, SIZE:] = np.diag(shared.sigma**2)
        self._begin_node(self.P, np.eye(self.size))

    def _begin_node(self, P_predicted: Array, Phi: Array) -> None:
        self._P_predicted, self._Phi = P_predicted, Phi
        self._correction: Array = np.zeros(self.size)

    @property
    def node(self) -> Node:
        """Where the filter stands."""
        return Node(self.state, self.shared, self.P, self._P_predicted, self._Phi, self._correction)

    @property
    def yaw_unknown(self) -> bool:
        """Whether the heading is too uncertain for what is linear in it."""
        if self.P[THETA, THETA].trace() < UNKNOWN_YAW_RAD**2:  # spares most calls the rest
            return False
        return yaw_variance(self.state, self.P) > UNKNOWN_YAW_RAD**2

    def predict(self, to_s: float) -> None:
        """Go on to a later time."""
        span = self.strapdown.propagate(self.state, to_s)
        kept = np.exp((self.state.t - to_s) / self._errors.time_s)
        Phi, Q = np.zeros((2, self.size, self.size))
        Phi[:SIZE, :SIZE], Q[:SIZE, :SIZE] = span.Phi, span.Q
        own = slice(SIZE * (self.size + 1), None, self.size + 1)  # the rest of the diagonal
        Phi.flat[own], Q.flat[own] = kept, self._errors.sigma**2 * (1 - kept**2)
        P = Phi @ self.P @ Phi.T + Q
        self.P = 0.5 * (P + P.T)
        self.state, self.shared = span.state, kept * self.shared
        self._begin_node(self.P, Phi)

    def compare(self, residual: Array, H: Array, R: Array) -> Update:
        """A measurement's residual with its covariance.

        ``H`` may be narrower than the filter; what is missing is zero.
        """
        P_HT = self.P[:, : H.shape[1]] @ H.T
        S = H @ P_HT[: H.shape[1]] + R
        if H.shape[1] < self.size:
            H = np.hstack([H, np.zeros((len(H), self.size - H.shape[1]))])
        # what is known but for rounding, by a reading without noise, no other corrects
        known = R[0, 0] == 0.0 and S[0, 0] <= ROUNDING * (H[0] ** 2 @ np.diagonal(self.P))
        S_inverse = None if known else _inverse(S)
        nis = np.nan if S_inverse is None else float(residual @ S_inverse @ residual)
        return Update(residual, H, R, S_inverse, nis)

    def correct(self, update: Update, *, shows_yaw: bool, leave_yaw: bool = False) -> Array:
        """Take a measurement in, in Joseph form.

        One that does not show the yaw leaves it as uncertain as it was, exactly: see `carried`.
        With ``leave_yaw`` the heading is considered, not estimated: its uncertainty counts, but the
        measurement does not change it (Schmidt's filter).

        Returns
        -------
        ndarray, shape (n, m)
            The gain.

        Raises
        ------
        ValueError
            Where the residual's covariance is singular.
        """
        if update.S_inverse is None:
            raise ValueError("the covariance of the innovation is singular")
        H = update.H
        K = self.P @ H.T @ update.S_inverse
        if leave_yaw:
            down_b = self.state.body.R_nb[2]
            K[THETA] -= np.outer(down_b, down_b @ K[THETA])
        error = -K @ update.residual
        left = -K @ H
        left.flat[:: self.size + 1] += 1.0
        P = left @ self.P @ left.T + K @ update.R @ K.T
        P = 0.5 * (P + P.T)
        self.P = in_turned_axes(P, error[THETA]) if shows_yaw else carried(P, error)
        self.state = self.state.corrected(error[:SIZE])
        self.shared = self.shared + error[SIZE:]
        self._correction = compose(self._correction, error)
        return np.asarray(K)

    def widen(self, variance: Array) -> None:
        """Add variances (n,) to the errors, as noise between two nodes of the same time."""
        self.P = self.P + np.diag(variance)
        self._begin_node(self.P, np.eye(self.size))


def compose(first: Array, then: Array) -> Array:
    """The error that is two errors one after the other; the second is in axes that the first turns.

    Parameters
    ----------
    first, then : ndarray, shape (n,)
        Inertial errors and any that add.
    """
    from scipy.spatial.transform import Rotation

    total = first + then
    if _length(first[THETA]) > LARGE_TURN_RAD:
        turn = Rotation.from_rotvec(first[THETA])
        total[THETA] = (turn * Rotation.from_rotvec(then[THETA])).as_rotvec()
        for entries in (RHO, NU):
            total[entries] = first[entries] + turn.apply(then[entries])
    return total


def _length(vector: Array) -> float:
    return float(np.sqrt(vector @ vector))


def _inverse(S: Array) -> Array | None:
    """Inverse of a covariance; None where it is not positive definite."""
    if len(S) == 1:
        return 1.0 / S if S[0, 0] > 0 else None
    try:
        root = np.linalg.cholesky(S)
    except np.linalg.LinAlgError:
        return None
    inverse_root = np.linalg.inv(root)
    return np.asarray(inverse_root.T @ inverse_root)


def in_turned_axes(P: Array, theta_b: Array) -> Array:
    """Covariance in the axes that a correction has turned."""
    angle = _length(theta_b)
    if angle <= LARGE_TURN_RAD:
        return P
    s, c, V = np.sin(angle), np.cos(angle), skew(theta_b / angle)
    T = np.eye(len(P))
    # the right Jacobian of SO(3), and the turn back
    T[THETA, THETA] = np.eye(3) - (1 - c) / angle * V + (1 - s / angle) * V @ V
    T[RHO, RHO] = T[NU, NU] = np.eye(3) - s * V + (1 - c) * V @ V
    return np.asarray(T @ P @ T.T)


def carried(P: Array, error: Array) -> Array:
    """Covariance after a correction by what does not show the yaw.

    Such measurements cannot tell a track from the same track turned about the vertical. But how
    the errors of velocity and position go with that of the yaw depends on where the filter
    believes to be: each correction changes that, and would pass for knowledge of the yaw. So the
    covariance is carried along with the state, by the adjoint of the correction. The filter is
    then the right-invariant one: Barrau and Bonnabel, *The invariant extended Kalman filter as a
    stable observer*, IEEE Transactions on Automatic Control 62(4), 2017.
    """
    from scipy.spatial.transform import Rotation

    back = Rotation.from_rotvec(-error[THETA]).as_matrix()
    adjoint = np.eye(len(P))
    for entries in (THETA, RHO, NU):
        adjoint[entries, entries] = back
    for entries in (RHO, NU):
        adjoint[entries, THETA] = -back @ skew(error[entries])
    return np.asarray(adjoint @ P @ adjoint.T)
