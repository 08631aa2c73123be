"""The state of landmark SLAM: one vehicle and its landmarks, with their joint covariance.

Smith, Self and Cheeseman, *Estimating uncertain spatial relationships in robotics* (1990). Whatever
the vehicle is, its errors come first in the covariance, then that of the scale of the ranges where
the sensor states its spread, then each landmark's: n and e, and d where the sensor tells
elevations. Surveyed landmarks are in it from the start, all but certain.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.mission import Sensor
from gtsam_nav.sensors.association import Comparison
from gtsam_nav.sensors.landmarks import Observation, Sighting, observe, place
from gtsam_nav.sensors.noise import LandmarkNoise
from gtsam_nav.sensors.prediction import BodyState
from gtsam_nav.series import IntArray

MOST_ITERATIONS, NONLINEAR_SIGMAS = 5, 0.5
"""Of an update, and how far from the straight line a prediction may end, in its noise's sigmas."""
LOST_FACTOR = 2.0
"""By which the sigmas of a vehicle grow that no longer finds its landmarks."""


class Vehicle(Protocol):
    """What moves among the landmarks.

    Attributes
    ----------
    size : int
        Number of its errors.
    pose : slice
        Those of them that say where it is and how it moves.
    P_start : ndarray, shape (size, size)
        Their covariance at the start.
    """

    size: int
    pose: slice
    P_start: Array

    def advance(self, P: Array) -> tuple[Array, Array]:
        """Go to the next time from errors of covariance P: their transition and added noise, all of
        shape (size, size)."""
        ...

    def correct(self, error: Array) -> None:
        """Put an error of shape (size,) right."""
        ...

    @property
    def body(self) -> BodyState:
        """What the sensor models take."""
        ...

    @property
    def body_jacobian(self) -> Array:
        """Errors of `BodyState` in the vehicle's, shape (9, size)."""
        ...

    def pose_cov(self, P: Array) -> Array:
        """Covariance (6, 6) of position and rotation along the navigation axes, where that of its
        errors is P."""
        ...

    def after(self, P: Array, error: Array, first: int, axes: int) -> Array:
        """The covariance of the whole state, its errors first, once this error is put right; the
        landmarks' are those from ``first`` on, so many ``axes`` each."""
        ...

    def before(self, H: Array, error: Array, first: int, axes: int) -> Array:
        """A Jacobian (k, n) in the whole state's errors of now, in those before this one was put
        right."""
        ...


@dataclass(frozen=True)
class Landmark:
    """What is known of a landmark beside its place.

    Attributes
    ----------
    id : int
        The sensor's, or -1.
    surveyed : bool
    first : int
        Number of the sighting that placed it; -1 for a surveyed one.
    """

    id: int
    surveyed: bool = False
    first: int = -1


class LandmarkFilter:
    """Extended Kalman filter over a vehicle and landmarks.

    Parameters
    ----------
    vehicle : Vehicle
    sensor : Sensor
        That sees the landmarks.
    elevation : bool
        Whether it tells elevations.

    Attributes
    ----------
    range_scale : float
        Share by which the ranges are too long.
    """

    def __init__(self, vehicle: Vehicle, sensor: Sensor, *, elevation: bool) -> None:
        self.vehicle, self.range_scale = vehicle, 0.0
        scale_sigma = LandmarkNoise.model_validate(sensor.noise).range_scale_sigma
        self._first = vehicle.size + (1 if scale_sigma > 0 else 0)
        self.P = np.zeros((self._first, self._first))
        self.P[: vehicle.size, : vehicle.size] = vehicle.P_start
        self.P[vehicle.size :, vehicle.size :] = scale_sigma**2
        self.sensor, self.elevation = sensor, elevation
        self.axes = 3 if elevation else 2
        self.landmarks: list[Landmark] = []
        self.p_n = np.empty((0, 3))

    @property
    def vehicle_cov(self) -> Array:
        """Of the vehicle's errors, shape (size, size)."""
        return self.P[: self.vehicle.size, : self.vehicle.size]

    def landmark_cov(self, k: int) -> Array:
        """Of a landmark's position, shape (3, 3); zero in d where the filter is planar."""
        cov = np.zeros((3, 3))
        cov[: self.axes, : self.axes] = self.P[self._of(k), self._of(k)]
        return cov

    def _of(self, k: int) -> slice:
        first = self._first + self.axes * k
        return slice(first, first + self.axes)

    def advance(self) -> None:
        """Let the vehicle go to its next time."""
        n = self.vehicle.size
        Phi, Q = self.vehicle.advance(self.vehicle_cov)
        self.P[:n] = Phi @ self.P[:n]
        self.P[n:, :n] = self.P[:n, n:].T
        self.P[:n, :n] = self.P[:n, :n] @ Phi.T + Q

    def survey(self, id_: int, p_n: Array, sigma: float) -> None:
        """Add a surveyed landmark."""
        self._add(Landmark(id_, surveyed=True), p_n)
        own = self._of(len(self.landmarks) - 1)
        self.P[own, own] = sigma**2 * np.eye(self.axes)

    def augment(self, landmark: Landmark, seen: Sighting) -> None:
        """Add a landmark where a sighting puts it, with its covariance with all the rest."""
        assert seen.range_m is not None
        true_m, stretch = seen.range_m / (1.0 + self.range_scale), 1.0 + self.range_scale
        seen = replace(seen, range_m=true_m, sigma_range=seen.sigma_range / stretch)
        placed = place(self.vehicle.body, seen, self.sensor)
        J = placed.jacobian_sighting[: self.axes]
        n, size = self._first, len(self.P)
        G = np.empty((self.axes, n))
        G[:, : self.vehicle.size] = placed.jacobian_body[: self.axes] @ self.vehicle.body_jacobian
        G[:, self.vehicle.size :] = -J[:, :1] * true_m / stretch
        self._add(landmark, placed.p_n)
        own = self._of(len(self.landmarks) - 1)
        self.P[own, :size] = G @ self.P[:n, :size]
        self.P[:size, own] = self.P[own, :size].T
        self.P[own, own] = G @ self.P[:n, :n] @ G.T + J @ seen.cov @ J.T

    def _add(self, landmark: Landmark, p_n: Array) -> None:
        self.landmarks.append(landmark)
        self.p_n = np.vstack([self.p_n, p_n])
        self.P = np.pad(self.P, (0, self.axes))

    def remove(self, k: int) -> None:
        """Forget a landmark."""
        del self.landmarks[k]
        self.p_n = np.delete(self.p_n, k, axis=0)
        rows = np.arange(*self._of(k).indices(len(self.P)))
        self.P = np.delete(np.delete(self.P, rows, axis=0), rows, axis=1)

    def compare(self, measured: Array, noise: Array, landmarks: IntArray) -> Comparison:
        """Sightings of now against some landmarks.

        Parameters
        ----------
        measured : ndarray, shape (s, m)
            Range, bearing[, elevation].
        noise : ndarray, shape (s, m, m)
            Their covariances.
        landmarks : ndarray of int, shape (k,)
            Numbers in the filter.
        """
        observed = self._observe(landmarks)
        H = self._jacobian(observed, landmarks)
        k, m, size = H.shape
        flat = H.reshape(k * m, size)
        return Comparison(
            observed.residual(measured[:, None]),
            (flat @ self.P @ flat.T).reshape(k, m, k, m),
            noise,
        )

    def update(self, measured: Array, noise: Array, landmarks: IntArray) -> Array:
        """Correct all by sightings of now, (s, m) with covariances (s, m, m), of known landmarks.

        An iterated update: where the correction is so large that the sightings are not linear over
        it (a landmark that is near, a course long unobserved), they are linearised again at its
        end. Bell and Cathey, IEEE Trans. Automatic Control 38(2), 1993.

        Returns
        -------
        ndarray, shape (s, m)
            The innovations of all together in uncorrelated standard deviations.

        Raises
        ------
        numpy.linalg.LinAlgError
            Where the innovation covariance is singular; the state is what it was.
        """
        n, m = measured.shape
        block = np.zeros((n, m, n, m))
        block[np.arange(n), :, np.arange(n)] = noise
        R = block.reshape(n * m, n * m)
        sigma = np.sqrt(np.diag(R))
        residual, H = self._predicted(measured, landmarks)
        whitened = np.linalg.solve(self._innovation_root(H, R), -residual)
        error: Array = np.zeros(len(self.P))
        for _ in range(MOST_ITERATIONS):
            K = self._gain(H, R)
            step = -K @ (residual - H @ error) - error
            self._move(step)
            error = error + step
            expected, used = residual + H @ step, H
            residual, H = self._predicted(measured, landmarks)
            H = self.vehicle.before(H, error, self._first, self.axes)
            if np.all(np.abs(residual - expected) < NONLINEAR_SIGMAS * sigma):
                break
        self._contract(K, used, R, error)
        return np.asarray(whitened.reshape(n, m))

    def _predicted(self, measured: Array, landmarks: IntArray) -> tuple[Array, Array]:
        """Stacked residual and Jacobian of sightings at the state as it stands."""
        observed = self._observe(landmarks)
        H = self._jacobian(observed, landmarks)
        return observed.residual(measured).ravel(), H.reshape(-1, len(self.P))

    def correct(self, residual: Array, H: Array, R: Array) -> None:
        """Kalman update by a residual (predicted less measured) with Jacobian H and covariance R.

        Raises
        ------
        numpy.linalg.LinAlgError
            Where the innovation covariance is singular; the state is what it was.
        """
        K = self._gain(H, R)
        error = -K @ residual
        self._move(error)
        self._contract(K, H, R, error)

    def _gain(self, H: Array, R: Array) -> Array:
        L, PHt = self._innovation_root(H, R), self.P @ H.T
        return np.asarray(np.linalg.solve(L.T, np.linalg.solve(L, PHt.T)).T)

    def _innovation_root(self, H: Array, R: Array) -> Array:
        """Lower triangular root of the innovation covariance."""
        S = H @ (self.P @ H.T) + R
        return np.asarray(np.linalg.cholesky(0.5 * (S + S.T)))

    def _move(self, error: Array) -> None:
        n = self.vehicle.size
        self.vehicle.correct(error[:n])
        self.range_scale += float(error[n : self._first].sum())
        self.p_n[:, : self.axes] += error[self._first :].reshape(-1, self.axes)

    def _contract(self, K: Array, H: Array, R: Array, error: Array) -> None:
        """Joseph's (I - K H) P (I - K H)' + K R K', in the axes that the correction leaves."""
        left = np.eye(len(self.P)) - K @ H
        P = left @ self.P @ left.T + K @ R @ K.T
        self.P = self.vehicle.after(0.5 * (P + P.T), error, self._first, self.axes)

    def widen(self) -> None:
        """Trust the vehicle's pose less: it has lost its landmarks."""
        own = self.vehicle.pose
        self.P[own, own] *= LOST_FACTOR**2

    def _observe(self, landmarks: IntArray) -> Observation:
        # what a planar filter has learnt itself lies level with the sensor
        learnt = np.array([not self.landmarks[k].surveyed for k in landmarks], dtype=bool)
        return observe(
            self.vehicle.body,
            self.p_n[landmarks],
            self.sensor,
            elevation=self.elevation,
            level=None if self.elevation else learnt,
        ).with_ranges_scaled(1.0 + self.range_scale)

    def _jacobian(self, observed: Observation, landmarks: IntArray) -> Array:
        """In the errors of the whole state, shape (k, m, size)."""
        k, m = observed.values.shape
        H = np.zeros((k, m, len(self.P)))
        H[..., : self.vehicle.size] = observed.jacobian_body @ self.vehicle.body_jacobian
        by_scale = observed.values[:, :1] / (1.0 + self.range_scale)
        H[:, 0, self.vehicle.size : self._first] = by_scale
        for row, landmark in enumerate(landmarks):
            H[row][:, self._of(landmark)] = observed.jacobian_landmark[row][:, : self.axes]
        return H
