"""pIC on points in space: the match of their plane, turned to the axes that a pose is told in."""

from __future__ import annotations

import numpy as np

from gtsam_nav.frames import rotation_from_rpy, rpy_from_rotation
from gtsam_nav.registration.pic import register, register_points
from gtsam_nav.registration.result import RelativePose
from gtsam_nav.registration.settings import PicSettings
from gtsam_nav.sensors.noise import SonarNoise
from gtsam_nav.sonar.scans import Scan, planar_rotations

SHORE = np.random.default_rng(4).uniform(-9.0, 9.0, size=(40, 3))


def scan(xy: np.ndarray) -> Scan:
    sigma_m = SonarNoise().sigma_range_m
    return Scan(0.0, xy, np.tile(sigma_m**2 * np.eye(2), (len(xy), 1, 1)))


def test_the_plane_is_matched_and_all_else_stays_the_priors() -> None:
    root = np.diag([0.02, 0.03, 0.05, 0.6, 0.2, 0.4]) @ np.random.default_rng(0).normal(size=(6, 6))
    expected = RelativePose(
        rotation_from_rpy([0.0, 0.0, 0.6]), np.array([0.4, -0.3, 0.7]), root @ root.T
    )
    true = np.array([0.55, -0.2, 0.63])
    new = SHORE.copy()
    new[:, :2] = (SHORE[:, :2] - true[:2]) @ planar_rotations(true[2])
    match = register_points(SHORE, new, expected, PicSettings())
    assert match.ok, match.failure

    # x and y along the reference's axes, yaw
    planar = [3, 4, 2]
    turn = np.eye(3)
    turn[:2, :2] = planar_rotations(0.6)
    flat = register(
        scan(SHORE[:, :2]),
        scan(new[:, :2]),
        np.array([0.4, -0.3, 0.6]),
        turn @ expected.cov[np.ix_(planar, planar)] @ turn.T,
        PicSettings(),
    )
    np.testing.assert_allclose(match.pose.p_a, [*flat.q[:2], 0.7])
    np.testing.assert_allclose(rpy_from_rotation(match.pose.R_ab), [0.0, 0.0, flat.q[2]])
    assert match.fitness == flat.overlap
    turn[:2, :2] = planar_rotations(flat.q[2])
    wanted = np.zeros((6, 6))
    wanted[np.ix_(planar, planar)] = turn.T @ flat.cov @ turn
    others = [0, 1, 5]
    wanted[np.ix_(others, others)] = expected.cov[np.ix_(others, others)]
    np.testing.assert_allclose(match.pose.cov, wanted, atol=1e-15)
