"""What is known of the motion without a sensor: rest, and wheels that do not slip.

A constraint is a measurement of a body velocity that is zero.
"""

from __future__ import annotations

import numpy as np

from gtsam_nav.sensors import dvl
from gtsam_nav.sensors.prediction import BodyState, Prediction


def zero_velocity(state: BodyState, sigma: float) -> Prediction:
    """A body at rest against a state: ``R_nb' v_n``."""
    return dvl.predict(state, np.zeros(3), sigma)


def zero_horizontal_velocity(state: BodyState, sigma: float) -> Prediction:
    """A body that goes nowhere but up or down against a state: north and east of ``v_n``."""
    jacobian = np.hstack([np.zeros((2, 6)), state.R_nb[:2]])
    return Prediction(state.v_n[:2], jacobian, sigma**2 * np.eye(2))


def nonholonomic(state: BodyState, sigma: float) -> Prediction:
    """A body that moves neither sideways nor up: the last two components of ``R_nb' v_n``.

    Dissanayake et al., IEEE Trans. Robotics and Automation 17(5), 2001.
    """
    whole = zero_velocity(state, sigma)
    return Prediction(whole.residual[1:], whole.jacobian[1:], whole.cov[1:, 1:])
