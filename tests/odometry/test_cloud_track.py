"""The odometry of clouds: what it says of a pair, and what makes a submap."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gtsam_nav.odometry.cloud_track import UNMATCHED_RATE, CloudTrack, KeyCloud, adjoint
from gtsam_nav.registration.result import RelativePose

COV = np.diag([1e-6] * 3 + [1e-4] * 3)


def track_of(maps: list[int]) -> CloudTrack:
    """One metre ahead every two seconds; each cloud is one point at the body's origin."""
    poses = [RelativePose(np.eye(3), np.array([k, 0.0, 0.0]), COV) for k in range(len(maps))]
    key = [
        KeyCloud(2.0 * k, pose, np.zeros((1, 3)), k, local_map)
        for k, (pose, local_map) in enumerate(zip(poses, maps, strict=True))
    ]
    t = np.array([cloud.t for cloud in key])
    fixed = np.tile(np.eye(3), (len(key), 1, 1))
    return CloudTrack("lidar", t, fixed, np.array([pose.p_a for pose in poses]), key, ())


def test_from_one_map_to_the_next_an_increment_is_a_guess() -> None:
    track = track_of([0, 0, 1, 1])
    within, across = track.increment(2, 3).cov, track.increment(1, 2).cov
    np.testing.assert_allclose(within, track.increment(0, 1).cov)
    np.testing.assert_allclose(across - within, np.diag((2.0 * UNMATCHED_RATE) ** 2))


def test_a_submap_is_of_one_map() -> None:
    x = np.sort(track_of([0, 0, 1, 1, 1, 1]).submap(2)[:, 0])
    assert x == pytest.approx([0.0, 1.0, 2.0])


def test_the_adjoint_carries_small_motions_over() -> None:
    rng = np.random.default_rng(0)
    R_ab, p_a = Rotation.from_rotvec(rng.normal(size=3)).as_matrix(), rng.normal(size=3)
    small = 1e-6 * rng.normal(size=6)
    # T_ab exp(small) = exp(adjoint small) T_ab
    R = R_ab @ Rotation.from_rotvec(small[:3]).as_matrix()
    p = p_a + R_ab @ small[3:]
    moved = adjoint(R_ab, p_a) @ small
    turn = Rotation.from_rotvec(moved[:3]).as_matrix()
    np.testing.assert_allclose(turn @ R_ab, R, atol=1e-10)
    np.testing.assert_allclose(turn @ p_a + moved[3:], p, atol=1e-10)
