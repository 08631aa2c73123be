"""A vehicle that nothing sees turning: said, and uncertain alike in every method."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import gtsam_nav as gn
from gtsam_nav.preprocess.turning import (
    bounded_by_way,
    unknown_where_not_told,
    warnings_on_turns,
    warnings_on_yaw,
)


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


@pytest.fixture(scope="module")
def blind() -> gn.Mission:
    mission = gn.simulate("marina", seed=3, duration_s=150.0)
    return mission.without("heading", "attitude", "imu", "odometry", "gnss", "landmarks")


def test_a_place_is_no_less_sure_than_the_way_that_led_there_is_long(blind: gn.Mission) -> None:
    trajectory = gn.estimate(blind, "dr").trajectory
    assert trajectory.sigma_p_n is not None
    assert trajectory.v_n is not None
    assert trajectory.sigma_v_n is not None
    way_m = np.sum(np.linalg.norm(np.diff(trajectory.p_n[:, :2], axis=0), axis=1))
    assert trajectory.sigma_p_n[-1, :2] == pytest.approx([way_m, way_m], rel=0.05)
    speed_m_s = np.linalg.norm(trajectory.v_n[-1])
    assert trajectory.sigma_v_n[-1, :2] == pytest.approx([speed_m_s, speed_m_s], rel=0.05)


def test_nor_is_the_causal_estimate(blind: gn.Mission) -> None:
    online = gn.estimate(blind, "scan-match").online
    assert online is not None
    assert online.sigma_p_n is not None
    way_m = np.sum(np.linalg.norm(np.diff(online.p_n[:, :2], axis=0), axis=1))
    assert online.sigma_p_n[-1, :2] == pytest.approx([way_m, way_m], rel=0.05)


def test_a_yaw_that_is_known_leaves_the_covariance_as_it_is() -> None:
    mission = gn.simulate("marina", seed=3, duration_s=20.0)
    trajectory = gn.estimate(mission.without("sonar", "landmarks"), "dr").trajectory
    assert bounded_by_way(trajectory) is trajectory


def test_an_imu_alone_tells_the_turns_to_some_methods_only() -> None:
    mission = gn.simulate("marina", seed=3, duration_s=10.0).without("heading", "odometry")
    assert warnings_on_turns("graph", mission) == ()
    (said,) = warnings_on_turns("pose-ekf", mission)
    assert "pose-ekf finds neither a heading nor odometry" in said


def test_a_time_over_which_nothing_tells_the_turns_is_said() -> None:
    mission = gn.simulate("marina", seed=3, duration_s=60.0).without("odometry")
    heading = mission.sensors["heading"]
    ended = mission.with_sensor(replace(heading, series=heading.series.crop(0.0, 20.0)))
    assert warnings_on_turns("graph", ended) == ()
    (said,) = warnings_on_turns("dr", ended)
    assert said.startswith("nothing measures how the vehicle turns from 19.9 s to 60.0 s")
    (said,) = warnings_on_turns("graph", ended.without("imu"))
    assert "from 19.9 s" in said


def test_a_yaw_that_fixes_hardly_show_is_said() -> None:
    laps = gn.simulate("laps", seed=3, duration_s=60.0)
    aided, blind = laps.without("heading"), laps.without("gnss")
    trajectory = gn.estimate(aided, "ins-ekf").trajectory
    assert trajectory.cov_pose_n is not None
    sure, unsure = trajectory.cov_pose_n.copy(), trajectory.cov_pose_n.copy()
    sure[:, 5, 5], unsure[:, 5, 5] = np.radians(1.0) ** 2, np.radians(9.0) ** 2
    assert warnings_on_yaw(aided, replace(trajectory, cov_pose_n=sure)) == ()
    (said,) = warnings_on_yaw(aided, replace(trajectory, cov_pose_n=unsure))
    assert "9 deg (median sigma)" in said
    for told in (laps, blind):
        assert warnings_on_yaw(told, replace(trajectory, cov_pose_n=unsure)) == ()


def test_a_yaw_that_fixes_do_not_tell_is_stated_as_unknown() -> None:
    laps = gn.simulate("laps", seed=3, duration_s=30.0)
    aided = laps.without("heading")
    trajectory = gn.estimate(laps, "ins-ekf").trajectory
    assert trajectory.cov_pose_n is not None
    vague, clear = trajectory.cov_pose_n.copy(), trajectory.cov_pose_n.copy()
    vague[:, 5, 5], clear[:, 5, 5] = np.radians(25.0) ** 2, np.radians(15.0) ** 2
    vague, clear = (replace(trajectory, cov_pose_n=cov) for cov in (vague, clear))
    unknown, online, nothing = unknown_where_not_told(aided, vague, clear, None)
    assert nothing is None
    for stated in (unknown, online):
        assert np.degrees(stated.sigma_rpy[:, 2]) == pytest.approx(103.9, abs=0.1)
        assert np.all(np.linalg.eigvalsh(stated.cov_pose_n) > 0.0)
    (said,) = warnings_on_yaw(aided, unknown)
    assert "stated as unknown" in said
    assert unknown_where_not_told(aided, clear)[0] is clear
    assert unknown_where_not_told(laps, vague)[0] is vague


def test_a_yaw_that_was_stated_is_as_sure_as_it_has_become() -> None:
    laps = gn.simulate("laps", seed=3, duration_s=30.0).without("heading")
    stated = replace(laps, initial=replace(laps.initial, heading=0.3))
    trajectory = gn.estimate(laps, "ins-ekf").trajectory
    assert unknown_where_not_told(stated, trajectory)[0] is trajectory
