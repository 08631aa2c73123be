"""Depth below the surface; the navigation frame's origin lies on the water."""

from __future__ import annotations

import numpy as np

from gtsam_nav.frames import Array, skew
from gtsam_nav.sensors.prediction import BodyState, Prediction


def predict(state: BodyState, depth_m: float, lever_b: Array, sigma: float) -> Prediction:
    """Depth of the sensor against a state: ``d + (R_nb lever_b)_d - depth``."""
    residual = state.p_n[2:] + state.R_nb[2:] @ lever_b - depth_m
    jacobian = np.hstack([-state.R_nb[2:] @ skew(lever_b), state.R_nb[2:], np.zeros((1, 3))])
    return Prediction(residual, jacobian, np.array([[sigma**2]]))
