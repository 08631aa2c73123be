"""The inertial vehicle of landmark SLAM: the strapdown filter's errors, and what aids them.

The mechanisation, its 15 errors, the errors that a sensor's readings share and the sensors' models
are those of `ins`; the covariance is the landmark filter's.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gtsam_nav.ekf.aid import Aid, laid_out
from gtsam_nav.ekf.error_state import Update, in_turned_axes, innovations
from gtsam_nav.ekf.gate import Gate
from gtsam_nav.ekf.inertial_start import InertialStart
from gtsam_nav.ekf.landmark_filter import LandmarkFilter
from gtsam_nav.ekf.strapdown import RHO, SIZE, THETA, Strapdown
from gtsam_nav.frames import Array
from gtsam_nav.mission import Rejection
from gtsam_nav.sensors.prediction import BodyState
from gtsam_nav.solution import Innovations


class InertialVehicle:
    """Goes from the start through given times.

    Parameters
    ----------
    strapdown : Strapdown
    start : InertialStart
        At the first of the times.
    aids : list of Aid
        Whose shared errors it carries beside its own.
    t : ndarray, shape (n,)
        Mission times, s, rising.
    """

    pose = slice(0, 9)

    def __init__(
        self, strapdown: Strapdown, start: InertialStart, aids: list[Aid], t: Array
    ) -> None:
        self._strapdown, self._t, self._k = strapdown, t, 0
        self._errors, self.places = laid_out(aids)
        self.state, self.shared = start.state, np.zeros(len(self._errors))
        self.size = SIZE + len(self._errors)
        self.P_start = np.diag(np.append(np.zeros(SIZE), self._errors.sigma**2))
        self.P_start[:SIZE, :SIZE] = start.P
        if not start.georeferenced:
            self._own_the_frame()

    def _own_the_frame(self) -> None:
        """The zero of a local frame is where the vehicle begins: its place there is no error."""
        R_nb = self.state.body.R_nb
        down = np.diag([0.0, 0.0, 1.0])
        P_n = R_nb @ self.P_start[RHO, RHO] @ R_nb.T
        self.P_start[RHO, RHO] = R_nb.T @ down @ P_n @ down @ R_nb

    def advance(self, P: Array) -> tuple[Array, Array]:
        """Go to the next time: transition and added noise of the errors, whatever these are."""
        del P
        self._k += 1
        span = self._strapdown.propagate(self.state, float(self._t[self._k]))
        kept = np.exp((self.state.t - span.state.t) / self._errors.time_s)
        Phi = np.diag(np.append(np.zeros(SIZE), kept))
        Q = np.diag(np.append(np.zeros(SIZE), self._errors.sigma**2 * (1 - kept**2)))
        Phi[:SIZE, :SIZE], Q[:SIZE, :SIZE] = span.Phi, span.Q
        self.state, self.shared = span.state, kept * self.shared
        return Phi, Q

    def correct(self, error: Array) -> None:
        """Put an error of the state, and of what its sensors share, right."""
        self.state = self.state.corrected(error[:SIZE])
        self.shared = self.shared + error[SIZE:]

    @property
    def body(self) -> BodyState:
        """What the sensor models take."""
        return self.state.body

    @property
    def body_jacobian(self) -> Array:
        """Errors of `BodyState` in its own, shape (9, size)."""
        return np.eye(9, self.size)

    def pose_cov(self, P: Array) -> Array:
        """Covariance (6, 6) of position and rotation along the navigation axes."""
        J = np.zeros((6, 6))
        J[:3, RHO] = J[3:, THETA] = self.state.body.R_nb
        return np.asarray(J @ P[:6, :6] @ J.T)

    def after(self, P: Array, error: Array, first: int, axes: int) -> Array:
        """The covariance in the axes that a correction has turned."""
        del first, axes
        return in_turned_axes(P, error[THETA])

    def before(self, H: Array, error: Array, first: int, axes: int) -> Array:
        """The same Jacobian: within an update the axes count as not turned."""
        del error, first, axes
        return H


class AidUpdates:
    """Lets the aids of the inertial filter correct vehicle and landmarks.

    Parameters
    ----------
    slam : LandmarkFilter
    vehicle : InertialVehicle
        Of that filter.
    aids : sequence of Aid

    Attributes
    ----------
    used : list of list of (float, float)
        Time and normalised innovation squared of what each aid had accepted.
    rejections : list of Rejection
    """

    def __init__(self, slam: LandmarkFilter, vehicle: InertialVehicle, aids: Sequence[Aid]) -> None:
        self.slam, self.vehicle, self.aids = slam, vehicle, aids
        self.used: list[list[tuple[float, Array]]] = [[] for _ in aids]
        self.rejections: list[Rejection] = []
        self._gates = [Gate(aid.gate_probability) for aid in aids]

    def take_all(self, t: float) -> None:
        """Take all measurements of now."""
        for which, aid in enumerate(self.aids):
            first, last = (np.searchsorted(aid.t, t, side=s) for s in ("left", "right"))
            for k in range(first, last):
                self._take(which, k)

    @property
    def fixes_used(self) -> int:
        """Number of positions that were accepted."""
        pairs = zip(self.aids, self.used, strict=True)
        return sum(len(used) for aid, used in pairs if aid.observes == "position")

    def innovations(self) -> dict[str, Innovations]:
        """Normalised innovations squared of what was used; one reading makes no statistics."""
        by_aid = ((a.name, innovations(used)) for a, used in zip(self.aids, self.used, strict=True))
        return {name: found for name, found in by_aid if found is not None}

    def _take(self, which: int, k: int) -> None:
        """Judge a measurement and let it correct the filter."""
        t, update = self.vehicle.state.t, self._compare(which, k)
        if update.S_inverse is None:
            self._reject(which, k, "singular innovation covariance", None)
            return
        verdict = self._gates[which].judge(t, update)
        if verdict == "reject":
            self._reject(which, k, "innovation gate", float(np.sqrt(update.nis)))
            return
        if verdict == "reopen":
            self._gates[which].offset()
            self.slam.widen()
        self.slam.correct(update.residual, update.H, update.R)
        self.used[which].append((t, update.whitened))

    def _compare(self, which: int, k: int) -> Update:
        aid, place, vehicle = self.aids[which], self.vehicle.places[which], self.vehicle
        shared = vehicle.shared[place]
        prediction = aid.predict(k, vehicle.state, shared)
        H = np.zeros((len(prediction.residual), len(self.slam.P)))
        H[:, : prediction.jacobian.shape[1]] = prediction.jacobian
        if len(shared):
            H[:, SIZE + place] = aid.by_shared(k, vehicle.state, shared)
        S = H @ self.slam.P @ H.T + prediction.cov
        try:
            np.linalg.cholesky(S)
        except np.linalg.LinAlgError:
            return Update(prediction.residual, H, prediction.cov, None, np.nan)
        S_inverse = np.asarray(np.linalg.inv(S))
        nis = float(prediction.residual @ S_inverse @ prediction.residual)
        return Update(prediction.residual, H, prediction.cov, S_inverse, nis)

    def _reject(self, which: int, k: int, reason: str, normalised: float | None) -> None:
        aid = self.aids[which]
        self.rejections.append(
            Rejection(self.vehicle.state.t, aid.name, int(aid.row[k]), reason, normalised)
        )
