"""The map of clouds: one point a voxel, in the trajectory's frame, without strays."""

from __future__ import annotations

import numpy as np
import pytest

from gtsam_nav.frames import quaternion_from_rpy
from gtsam_nav.odometry.cloud_map import cloud_map, map_or_reason
from gtsam_nav.odometry.cloud_track import CloudTrack, KeyCloud
from gtsam_nav.registration.result import RelativePose
from gtsam_nav.trajectory import Trajectory

pytestmark = pytest.mark.usefixtures("open3d_here")


def test_a_wall_seen_twice_is_mapped_once_and_strays_are_not() -> None:
    rng = np.random.default_rng(0)
    y, z = rng.uniform(-5.0, 5.0, size=(2, 4000))
    nowhere = RelativePose(np.eye(3), np.zeros(3), np.eye(6))
    key = []
    for k in range(2):
        wall = np.column_stack([np.full(4000, 6.0 - k), y, 0.3 * z])
        stray = np.array([[3.0, 0.0, -8.0]])
        key.append(KeyCloud(float(k), nowhere, np.concatenate([wall, stray]), k))
    fixed = np.tile(np.eye(3), (2, 1, 1))
    track = CloudTrack("lidar", np.arange(2.0), fixed, np.zeros((2, 3)), key, ())
    trajectory = Trajectory(
        t=np.arange(2.0),
        p_n=np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
        q_nb_wxyz=quaternion_from_rpy([[0.0, 0.0, np.pi / 2]] * 2),
    )
    found = cloud_map(track, trajectory, 0.25)
    assert found is not None
    # heading east: what lies ahead lies east, and both times it is the same wall
    np.testing.assert_allclose(found.points_n[:, 1], 6.0, atol=1e-6)
    assert found.points_n[:, 2].min() > -2.0
    cells = np.unique(np.floor(found.points_n / 0.25), axis=0)
    assert 0.5 * 40 * 12 < len(cells) <= len(found.t) < 1.5 * 41 * 13
    assert np.all((found.t >= 0.0) & (found.t <= 1.0))


def test_clouds_at_other_times_than_the_trajectory_are_no_map() -> None:
    nowhere = RelativePose(np.eye(3), np.zeros(3), np.eye(6))
    key = [KeyCloud(float(k), nowhere, np.zeros((60, 3)), k) for k in range(2)]
    track = CloudTrack(
        "lidar", np.arange(2.0), np.tile(np.eye(3), (2, 1, 1)), np.zeros((2, 3)), key, ()
    )
    later = Trajectory(
        t=np.array([5.0, 6.0]),
        p_n=np.zeros((2, 3)),
        q_nb_wxyz=quaternion_from_rpy(np.zeros((2, 3))),
    )
    assert map_or_reason(track, later, 0.25) == (
        None,
        ("no map of the clouds: the trajectory covers none of them",),
    )
