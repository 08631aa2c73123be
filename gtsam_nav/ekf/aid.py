"""Measurements of one kind, as the inertial filter takes them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from gtsam_nav.ekf.error_state import SharedErrors
from gtsam_nav.ekf.strapdown import InertialState
from gtsam_nav.frames import Array
from gtsam_nav.sensors.prediction import Prediction
from gtsam_nav.series import IntArray

Observed = Literal["position", "velocity", "body velocity", "heading", "tilt", "depth", "gyro bias"]
"""Positions and velocities are along the navigation axes, body velocities along the body's."""

NO_ERRORS = SharedErrors(np.empty(0), np.empty(0))


@dataclass(frozen=True)
class Aid:
    """Measurements of one kind by one sensor.

    Attributes
    ----------
    name : str
        Under which its innovations and rejections are recorded.
    observes : str
        What the filter doubts where a run of its rejections proves the filter lost.
    size : int
        Components of a measurement.
    t : ndarray, shape (n,)
    row : ndarray of int, shape (n,)
        Sample numbers in the source.
    predict : callable
        Prediction of measurement k by a state and this sensor's shared errors; its Jacobian may be
        wider than a body's, up to all 15 errors.
    gate_probability : float or None
        None takes every measurement.
    shared : SharedErrors
    shared_jacobian : ndarray, shape (size, len(shared)), or callable
        Of the residual in the shared errors; a callable tells it of measurement k at a state and
        shared errors.
    common : int
        How many of the shared errors, the last, are those of all aids that have any in common: the
        current, which all DVLs drift with.
    v_n : ndarray, shape (n, 3), optional
        Velocities over the ground where that is what is measured; ``sigma_v`` is theirs.
    receiver : str
        The GNSS receiver whose clock it goes by, if any.
    """

    name: str
    observes: Observed
    size: int
    t: Array
    row: IntArray
    predict: Callable[[int, InertialState, Array], Prediction]
    gate_probability: float | None
    shared: SharedErrors = NO_ERRORS
    shared_jacobian: Array | Callable[[int, InertialState, Array], Array] = field(
        default_factory=lambda: np.empty((0, 0))
    )
    common: int = 0
    v_n: Array | None = None
    sigma_v: float = 0.0
    receiver: str = ""

    def by_shared(self, k: int, state: InertialState, shared: Array) -> Array:
        """Jacobian of the residual of measurement k in the shared errors, at a state and these."""
        found = self.shared_jacobian
        return found(k, state, shared) if callable(found) else found

    @property
    def shows_yaw(self) -> bool:
        """Whether it measures along the navigation axes, so that motion shows the yaw.

        A compass does not: its bias is as unknown as the yaw.
        """
        return self.observes in ("position", "velocity")


def laid_out(aids: Sequence[Aid]) -> tuple[SharedErrors, list[IntArray]]:
    """The shared errors of all aids, one after another, and where among them each aid's stand.

    What aids have in common stands there once.
    """
    sigma, time_s, places = [np.empty(0)], [np.empty(0)], []
    common, size = np.empty(0, dtype=np.int64), 0
    for aid in aids:
        known = common if aid.common else common[:0]
        new = len(aid.shared) - len(known)
        place = np.concatenate([np.arange(size, size + new), known])
        if aid.common:
            common = place[-aid.common :]
        sigma.append(aid.shared.sigma[:new])
        time_s.append(aid.shared.time_s[:new])
        places.append(place)
        size += new
    return SharedErrors(np.concatenate(sigma), np.concatenate(time_s)), places
