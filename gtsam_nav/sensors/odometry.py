"""Odometry of what drives or floats: its speed forward and to starboard; it does not rise."""

from __future__ import annotations

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.sensors import dvl
from gtsam_nav.sensors.prediction import BodyState, Prediction


def predict(state: BodyState, v_b: Array, sigma: float) -> Prediction:
    """Body velocity against a state: ``R_nb' v_n - (v_b, 0)``, with v_b of shape (2,)."""
    return dvl.predict(state, np.array([*v_b, 0.0]), sigma)
