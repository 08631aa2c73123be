"""The error-state filter: what does not show the yaw teaches it nothing."""

from __future__ import annotations

import numpy as np
import pytest

from gtsam_nav.ekf.error_state import ErrorStateFilter, SharedErrors
from gtsam_nav.ekf.strapdown import NU, RHO, SIZE, THETA, InertialState, Strapdown
from gtsam_nav.frames import Array, quaternion_from_rpy
from gtsam_nav.mission import Sensor
from gtsam_nav.sensors import dvl, orientation
from gtsam_nav.series import ImuSeries


def tossed() -> ErrorStateFilter:
    """A filter on an IMU that turns and sways, with a compass's bias beside the 15 errors."""
    t = np.arange(0.0, 20.0, 0.02)
    swing = np.sin(np.outer(t, [0.9, 1.3, 0.4]))
    gyro, force = 0.3 * swing, swing - np.array([0.0, 0.0, 9.80665])
    imu = Sensor("imu", "imu", ImuSeries(t=t, gyro_i=gyro, accel_i=force))
    sigma = np.repeat([0.1, 1.0, 1.0, 0.02, 0.2], 3)
    q = quaternion_from_rpy([0.1, -0.2, 0.7])
    place, speed = np.array([30.0, -40.0, 2.0]), np.array([1.0, 0.5, 0.0])
    state = InertialState(0.0, q, place, speed, np.zeros(3), np.zeros(3))
    compass = SharedErrors(np.radians([5.0]), np.array([np.inf]))
    return ErrorStateFilter(Strapdown(imu, None), state, np.diag(sigma**2), compass)


def information_on_a_turn_of_all(f: ErrorStateFilter) -> float:
    """Of the whole track about the vertical through the origin, the compass's bias with it."""
    body, up = f.state.body, np.array([0.0, 0.0, 1.0])
    turn = np.zeros(f.size)
    turn[THETA] = body.R_nb.T @ up
    turn[RHO] = body.R_nb.T @ np.cross(up, body.p_n)
    turn[NU] = body.R_nb.T @ np.cross(up, body.v_n)
    turn[SIZE] = 1.0
    return float(turn @ np.linalg.solve(f.P, turn))


def take_all(f: ErrorStateFilter, rng: np.random.Generator) -> None:
    """A body velocity that jumps, tilt, and a compass, at one time."""
    v_b: Array = rng.normal(scale=1.0, size=3)
    roll, pitch, yaw = rng.normal(scale=0.1, size=3)
    for kind in ("velocity", "tilt", "heading"):
        body = f.state.body
        if kind == "velocity":
            found = dvl.predict(body, v_b, 0.05)
        elif kind == "tilt":
            found = orientation.predict_tilt(body, roll, pitch, 0.01)
        else:
            found = orientation.predict_heading(body, 0.7 + yaw, float(f.shared[0]), 0.02)
        H = np.zeros((len(found.residual), f.size))
        H[:, :9] = found.jacobian
        H[:, SIZE] = -1.0 if kind == "heading" else 0.0
        f.correct(f.compare(found.residual, H, found.cov), shows_yaw=False)


@pytest.mark.parametrize("seed", range(3))
def test_what_does_not_show_the_yaw_leaves_its_information_as_it_was(seed: int) -> None:
    f, rng = tossed(), np.random.default_rng(seed)
    for t in np.arange(0.5, 20.0, 0.5):
        f.predict(float(t))
        before = information_on_a_turn_of_all(f)
        take_all(f, rng)
        assert information_on_a_turn_of_all(f) == pytest.approx(before, rel=1e-5)
