"""The state between two keyframes that are known: the mean and the spread of a bridge.

Errors x of attitude, velocity and position along the navigation axes obey ``x' = F x + w`` with
white noise w. Of such a process the state at a time t inside an interval T is, given both ends,

``x(t) = (Phi(t) - Psi Phi(T)) x(0) + Psi x(T) + r`` with ``Psi = Q(t) Phi(T - t)' Q(T)^-1``,

where Phi is the transition, Q(t) what the noise has added by then, and r an error that neither end
knows of, of covariance ``Q(t) - Psi Phi(T - t) Q(t)`` (Barfoot, *State Estimation for Robotics*,
2017, section 3.4). It is none at both ends.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtsam_nav.frames import Array, skew

TURN, SPEED, PLACE = slice(0, 3), slice(3, 6), slice(6, 9)


@dataclass(frozen=True)
class Bridge:
    """How the state at n times follows from the two ends of an interval.

    Attributes
    ----------
    by_start, by_end : ndarray, shape (n, 9, 9)
        Weights of the ends' errors in attitude (rad), velocity (m/s) and position (m).
    noise : ndarray, shape (n, 9, 9)
        Covariance of what is left when both ends are known.
    link : ndarray, shape (9, 9)
        Information between the ends, ``Phi(T)' Q(T)^-1``.
    """

    by_start: Array
    by_end: Array
    noise: Array
    link: Array

    def covariance(self, joint: Array) -> Array:
        """Covariance (n, 9, 9) inside, given the joint one (18, 18) of both ends."""
        weights = np.concatenate([self.by_start, self.by_end], axis=2)
        return np.asarray(weights @ joint @ np.swapaxes(weights, 1, 2) + self.noise)


def inertial_bridge(t: Array, span_s: float, force_n: Array, gyro2: float, accel2: float) -> Bridge:
    """Of readings of an IMU with white noise: the turn's error tilts the specific force.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Times after the first end, s.
    span_s : float
    force_n : ndarray, shape (3,)
        Mean specific force, m/s^2.
    gyro2, accel2 : float
        Squared densities, rad^2/s and m^2/s^3.
    """
    K = -skew(force_n)
    whole = _added(np.array([span_s]), K, gyro2, accel2)[0]
    added, rest = _added(t, K, gyro2, accel2), _transition(span_s - t, K)
    # side by side: a stack of matrices would have `whole` taken apart for each of them
    abreast = np.swapaxes(rest @ added, 0, 1).reshape(9, -1)
    by_end = np.linalg.solve(whole, abreast).reshape(9, len(t), 9).transpose(1, 2, 0)
    across = _transition(np.array([span_s]), K)[0]
    by_start = _transition(t, K) - by_end @ across
    link = np.linalg.solve(whole, across).T
    return Bridge(by_start, by_end, added - by_end @ rest @ added, link)


def joint_of_neighbours(before: Array, after: Array, link: Array) -> Array:
    """Joint covariance (..., 18, 18) of two states by their own, and what ties them to each other.

    Where nothing else does, the link is the block between them of the inverse: with C their cross
    covariance, ``P0^-1 C = link (P1 - C' P0^-1 C)``. In units of their roots that is
    ``X = M (I - X' X)``, and X has the singular vectors of M.

    Parameters
    ----------
    before, after : ndarray, shape (..., 9, 9)
    link : ndarray, shape (..., 9, 9)
        Information, ``Phi' Q^-1`` of a transition with its noise.
    """
    root_before, root_after = _root(before), _root(after)
    U, s, V = np.linalg.svd(root_before @ link @ root_after)
    shared = 2 * s / (1 + np.sqrt(1 + 4 * s**2))
    cross = root_before @ (U * shared[..., None, :]) @ V @ root_after
    return np.block([[before, cross], [np.swapaxes(cross, -1, -2), after]])


def _root(P: Array) -> Array:
    """Symmetric square root."""
    variances, axes = np.linalg.eigh(P)
    roots = np.sqrt(np.maximum(variances, 0.0))
    return np.asarray((axes * roots[..., None, :]) @ np.swapaxes(axes, -1, -2))


def _transition(t: Array, K: Array) -> Array:
    """Phi at times (n,), shape (n, 9, 9): a tilt accelerates, a speed moves."""
    Phi = np.tile(np.eye(9), (len(t), 1, 1))
    t = t[:, None, None]
    Phi[:, SPEED, TURN] = K * t
    Phi[:, PLACE, TURN] = K * t**2 / 2
    Phi[:, PLACE, SPEED] = np.eye(3) * t
    return Phi


def _added(t: Array, K: Array, gyro2: float, accel2: float) -> Array:
    """Q at times (n,), shape (n, 9, 9)."""
    one, KK = np.eye(3), K @ K.T
    Q = np.empty((len(t), 9, 9))
    t = t[:, None, None]
    Q[:, TURN, TURN] = gyro2 * t * one
    Q[:, SPEED, TURN] = gyro2 * t**2 / 2 * K
    Q[:, PLACE, TURN] = gyro2 * t**3 / 6 * K
    Q[:, TURN, SPEED], Q[:, TURN, PLACE] = -Q[:, SPEED, TURN], -Q[:, PLACE, TURN]
    Q[:, SPEED, SPEED] = gyro2 * t**3 / 3 * KK + accel2 * t * one
    Q[:, SPEED, PLACE] = Q[:, PLACE, SPEED] = gyro2 * t**4 / 8 * KK + accel2 * t**2 / 2 * one
    Q[:, PLACE, PLACE] = gyro2 * t**5 / 20 * KK + accel2 * t**3 / 3 * one
    return Q


def steady_bridge(f: Array, noise: Array, link: Array) -> Bridge:
    """Of a walk without memory: its ends count by the fraction f (n,), ``noise`` (n, 9) is left,
    and information ``link`` (9,) ties them."""
    one = np.eye(9)
    by_end = f[:, None, None] * one
    return Bridge(one - by_end, by_end, noise[:, :, None] * one, np.diag(link))
