"""GNSS positions with an antenna lever arm."""

from __future__ import annotations

import numpy as np

from gtsam_nav.frames import Array, skew
from gtsam_nav.sensors.prediction import BodyState, Prediction


def predict(state: BodyState, p_antenna_n: Array, lever_b: Array, sigma: Array) -> Prediction:
    """Antenna position against a state: ``p_n + R_nb lever_b - p_antenna_n``."""
    jacobian = np.hstack([-state.R_nb @ skew(lever_b), state.R_nb, np.zeros((3, 3))])
    residual = state.p_n + state.R_nb @ lever_b - p_antenna_n
    return Prediction(residual, jacobian, np.diag(np.asarray(sigma) ** 2))
