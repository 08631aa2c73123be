"""A motion that goes on: along a circle, not its chord."""

from __future__ import annotations

import numpy as np

from gtsam_nav.odometry.steady_motion import AT_REST, SteadyMotion
from gtsam_nav.registration.open3d_icp import homogeneous


def on_circle(t: float, radius_m: float = 5.0, rate_rad_s: float = 0.3) -> np.ndarray:
    """Pose of what drives ahead and turns to starboard for a time, in where it began."""
    turn = rate_rad_s * t
    R = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    return homogeneous(R, radius_m * np.array([np.sin(turn), 1 - np.cos(turn), 0.0]))


def test_it_stays_on_its_circle() -> None:
    motion = SteadyMotion.through(on_circle(0.2), 0.2)
    for t in (0.0, 0.05, 0.2, 3.0):
        np.testing.assert_allclose(motion.over(t), on_circle(t), atol=1e-9)


def test_a_body_at_rest_stays() -> None:
    np.testing.assert_array_equal(AT_REST.over(10.0), np.eye(4))
