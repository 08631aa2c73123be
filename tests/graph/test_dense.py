"""The trajectory between keyframes."""

from __future__ import annotations

import numpy as np
import pytest

from gtsam_nav.frames import quaternion_from_rpy, rotation_from_rpy, wrap_angle
from gtsam_nav.graph.dense import dense_trajectory
from gtsam_nav.graph.problem import Problem
from gtsam_nav.preprocess.alignment import Alignment
from gtsam_nav.preprocess.motion import VehicleMotion
from gtsam_nav.trajectory import Trajectory


@pytest.mark.parametrize("first_deg", [20.0, 170.0, -178.0])
def test_a_correction_of_the_yaw_grows_evenly_through_half_a_turn(first_deg: float) -> None:
    """Wheels that drift: what the keyframes know better passes 180 deg."""
    t, t_key = np.arange(0.0, 40.1), np.arange(0.0, 40.1, 10.0)
    straight = VehicleMotion(
        t=t,
        p_n=t[:, None] * [1.0, 0.0, 0.0],
        rpy=np.zeros((len(t), 3)),
        v_b=np.tile([1.0, 0.0, 0.0], (len(t), 1)),
        sigma_v=np.full(len(t), 0.1),
        position_variance=0.01 * t,
        position_variance_m2_s=0.01,
        yaw_variance_rad2_s=1e-4,
        gyro_bias_b=np.zeros(3),
        rejections=(),
    )
    start = Alignment(0.0, np.zeros(3), np.ones(3), np.zeros(3), np.ones(3), georeferenced=False)
    problem = Problem(t_key, start, straight, uses_imu=False, has_compass=False)
    yaw = np.radians(first_deg + 0.5 * t)
    rpy = np.column_stack([0 * t, 0 * t, yaw])
    v_n = rotation_from_rpy(rpy)[:, :, 0]
    keyframes = Trajectory(
        t=t_key,
        p_n=np.cumsum(v_n, axis=0)[::10],
        q_nb_wxyz=quaternion_from_rpy(rpy[::10]),
        v_n=v_n[::10],
        cov_pose_n=np.tile(np.eye(6), (len(t_key), 1, 1)),
        sigma_v_n=np.full((len(t_key), 3), 0.1),
    )
    between = dense_trajectory(problem, None, keyframes, {})
    np.testing.assert_allclose(wrap_angle(between.rpy[:, 2] - yaw), 0.0, atol=1e-9)
    assert between.v_n is not None
    np.testing.assert_allclose(between.v_n, v_n, atol=1e-3)
