"""GNSS positions and velocities with an antenna lever arm."""

from __future__ import annotations

import numpy as np

from gtsam_nav.frames import Array, skew
from gtsam_nav.sensors.prediction import BodyState, Prediction


def predict(state: BodyState, p_antenna_n: Array, lever_b: Array, sigma: Array) -> Prediction:
    """Antenna position against a state: ``p_n + R_nb lever_b - p_antenna_n``."""
    jacobian = np.hstack([-state.R_nb @ skew(lever_b), state.R_nb, np.zeros((3, 3))])
    residual = state.p_n + state.R_nb @ lever_b - p_antenna_n
    return Prediction(residual, jacobian, np.diag(np.asarray(sigma) ** 2))


def predict_velocity(
    state: BodyState, v_antenna_n: Array, rate_b: Array, lever_b: Array, sigma: float
) -> Prediction:
    """Antenna velocity against a state: ``v_n + R_nb (rate_b x lever_b) - v_antenna_n``.

    Parameters
    ----------
    rate_b : ndarray, shape (3,)
        Angular rate of the body against the Earth, rad/s.
    """
    swing_b = np.cross(rate_b, lever_b)
    residual = state.v_n + state.R_nb @ swing_b - v_antenna_n
    jacobian = np.hstack([-state.R_nb @ skew(swing_b), np.zeros((3, 3)), state.R_nb])
    return Prediction(residual, jacobian, sigma**2 * np.eye(3))
