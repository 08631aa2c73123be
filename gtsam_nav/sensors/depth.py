"""Depth below the surface, and what it makes of d; the navigation frame's origin lies on the water.

The frame is a plane, and the water's surface falls away from it: by 8 m at 10 km (`frames.sag_m`).
"""

from __future__ import annotations

import numpy as np

from gtsam_nav.frames import Array, skew
from gtsam_nav.mission import Sensor
from gtsam_nav.sensors.prediction import BodyState, Prediction
from gtsam_nav.series import DepthSeries

DIVING_M_S = 1.0
"""Vertical speed that a vehicle may have while its gauge is silent."""


def predict(state: BodyState, depth_m: float, lever_b: Array, sigma: float) -> Prediction:
    """Depth of the sensor against a state: ``d + (R_nb lever_b)_d - depth``."""
    residual = state.p_n[2:] + state.R_nb[2:] @ lever_b - depth_m
    jacobian = np.hstack([-state.R_nb[2:] @ skew(lever_b), state.R_nb[2:], np.zeros((1, 3))])
    return Prediction(residual, jacobian, np.array([[sigma**2]]))


def depths_at(gauge: Sensor, t: Array) -> tuple[Array, Array]:
    """Depth of a gauge at given times (n,) and its sigma (n,), m.

    Straight between readings; the longer before or after them, or in a gap, the wider.
    """
    series = gauge.series
    assert isinstance(series, DepthSeries)
    after = np.searchsorted(series.t, t).clip(max=len(series) - 1)
    before = np.maximum(after - 1, 0)
    away_s = np.minimum(np.abs(series.t[after] - t), np.abs(t - series.t[before]))
    usual_s = float(np.median(np.diff(series.t))) if len(series) > 1 else 0.0
    bridged_s = np.where((t >= series.t[0]) & (t <= series.t[-1]), usual_s, 0.0)
    dived_m = DIVING_M_S * np.maximum(away_s - bridged_s, 0.0)
    sigma = np.hypot(np.interp(t, series.t, series.sigma), dived_m)
    return np.interp(t, series.t, series.depth_m), sigma


def origin_depths(gauge: Sensor, t: Array, R_nb: Array) -> tuple[Array, Array]:
    """The same of the body's origin, whose attitudes (n, 3, 3) need no yaw."""
    depth_m, sigma = depths_at(gauge, t)
    return depth_m - R_nb[:, 2] @ gauge.xyz_b, sigma
