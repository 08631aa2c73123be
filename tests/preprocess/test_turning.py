"""A vehicle that nothing sees turning: said, and uncertain alike in every method."""

from __future__ import annotations

import numpy as np

import gtsam_nav as gn
from gtsam_nav.preprocess.turning import warnings_on_turns


def test_a_heading_that_nothing_tells_is_said_and_claimed_by_none() -> None:
    mission = gn.simulate("marina", seed=3, duration_s=40.0)
    assert warnings_on_turns("dr", mission) == ()
    blind = mission.without("heading", "attitude", "imu", "odometry", "gnss", "sonar")
    for method in ("dr", "graph"):
        solution = gn.estimate(blind, method)
        assert any("nothing measures how the vehicle turns" in w for w in solution.warnings)
        sigma = solution.trajectory.sigma_rpy
        assert sigma is not None
        # a uniform direction's is 104
        assert 75.0 < np.degrees(sigma[-1, 2]) < 104.0


def test_an_imu_alone_tells_the_turns_to_some_methods_only() -> None:
    mission = gn.simulate("marina", seed=3, duration_s=10.0).without("heading", "odometry")
    assert warnings_on_turns("graph", mission) == ()
    (said,) = warnings_on_turns("pose-ekf", mission)
    assert "pose-ekf finds neither a heading nor odometry" in said
