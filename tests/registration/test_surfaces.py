"""What aligned points tell: planes, their noise, and the covariance of the pose."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gtsam_nav.frames import Array
from gtsam_nav.registration.open3d_global import global_start
from gtsam_nav.registration.result import RelativePose
from gtsam_nav.registration.settings import Open3dSettings
from gtsam_nav.registration.surfaces import Surfaces, design_effect, match_covariance

NOISE_M = 0.02


def room(rng: np.random.Generator, n: int = 500) -> Array:
    """Three walls, two at an oblique angle, and a floor, with noise."""
    a, b = rng.uniform(0.0, 1.0, size=(2, n))
    walls = [
        np.column_stack([8 * a, 0 * a, 3 * b]),
        np.column_stack([0 * a, 6 * a, 3 * b]),
        np.column_stack([8 - 2 * a, 6 * a, 3 * b]),
        np.column_stack([8 * a, 6 * b, 0 * a]),
    ]
    points = np.concatenate(walls) - [4.0, 3.0, 1.5]
    return np.asarray(points + rng.normal(scale=NOISE_M, size=points.shape))


def test_the_jacobian_is_that_of_the_residual() -> None:
    rng = np.random.default_rng(0)
    planes, new = Surfaces(room(rng)), room(rng)[::20]
    R_ab, p_a = Rotation.from_rotvec([0.01, -0.02, 0.03]).as_matrix(), np.array([0.02, 0.01, -0.01])
    here = planes.align(new, R_ab, p_a, 1.0)
    for axis in range(6):
        step = np.zeros(6)
        step[axis] = 1e-7
        turn = Rotation.from_rotvec(step[:3]).as_matrix()
        there = planes.align(new, R_ab @ turn, p_a + R_ab @ step[3:], 1.0)
        numerical = (there.residual - here.residual) / 1e-7
        np.testing.assert_allclose(here.jacobian[:, axis], numerical, atol=1e-5)


@pytest.mark.slow
def test_refined_poses_err_as_their_covariance_says() -> None:
    nees = []
    for seed in range(25):
        rng = np.random.default_rng(seed)
        reference, new = room(rng), room(rng)
        start = RelativePose(np.eye(3), np.zeros(3), np.eye(6))
        turn, shift = 0.01 * rng.normal(size=3), 0.03 * rng.normal(size=3)
        R_ab, p_a, found = Surfaces(reference).refine(
            new, Rotation.from_rotvec(turn).as_matrix(), shift, 0.5
        )
        cov = match_covariance(found, 0.25)
        assert cov is not None
        e = start.error_of(R_ab, p_a)
        nees.append(float(e @ np.linalg.solve(cov, e)) / 6)
    assert 0.5 < np.mean(nees) < 1.5


def test_nothing_moves_along_what_no_plane_tells() -> None:
    rng = np.random.default_rng(1)
    xy = rng.uniform(-5.0, 5.0, size=(3000, 2))
    floor = np.column_stack([xy, rng.normal(scale=NOISE_M, size=3000)])
    start = np.array([0.2, -0.1, 0.1])
    R_ab, p_a, found = Surfaces(floor).refine(floor[::7], np.eye(3), start, 1.0)
    assert abs(p_a[2]) < 0.01
    np.testing.assert_allclose(p_a[:2], [0.2, -0.1], atol=0.02)
    assert np.degrees(Rotation.from_matrix(R_ab).magnitude()) < 0.5
    cov = match_covariance(found, 0.25)
    assert cov is not None
    sigma = np.sqrt(np.diag(cov))
    assert sigma[[2, 3, 4]].min() > 20 * sigma[[0, 1, 5]].max()


def test_too_few_residuals_tell_nothing() -> None:
    rng = np.random.default_rng(2)
    planes = Surfaces(room(rng))
    assert match_covariance(planes.align(room(rng)[:10], np.eye(3), np.zeros(3), 0.5), 0.25) is None


@pytest.mark.parametrize(("shared", "expected"), [(0.0, 1.0), (1.0, 5.5)])
def test_errors_that_are_shared_count_less(shared: float, expected: float) -> None:
    """Ten points a block: with half of the variance in common a sum has 1 + 9 / 2 times as much."""
    rng = np.random.default_rng(3)
    block = np.repeat(np.arange(2000), 10)
    residual = rng.normal(size=20000) + shared * rng.normal(size=2000)[block]
    place = np.column_stack([block + 0.5, 0 * block, 0 * block])
    assert design_effect(residual, place, 1.0) == pytest.approx(expected, rel=0.07)


@pytest.mark.usefixtures("open3d_here")
def test_features_find_a_pose_from_nowhere() -> None:
    rng = np.random.default_rng(4)
    turn = Rotation.from_rotvec([0.0, 0.0, 2.0]).as_matrix()
    shift = np.array([1.5, -0.8, 0.2])
    reference, new = room(rng, 4000), (room(rng, 4000) - shift) @ turn
    settings = Open3dSettings(voxel_m=0.1)
    found = global_start(reference, new, settings)
    assert found is not None
    assert np.linalg.norm(found[:3, 3] - shift) < 0.3
    off = Rotation.from_matrix(turn.T @ found[:3, :3]).magnitude()
    assert np.degrees(off) < 8.0
    again = global_start(reference, new, settings)
    assert again is not None
    np.testing.assert_array_equal(again, found)


@pytest.mark.usefixtures("open3d_here")
def test_clouds_without_a_shape_in_common_give_no_start() -> None:
    rng = np.random.default_rng(5)
    settings = Open3dSettings(voxel_m=0.1)
    for new in (np.zeros((1, 3)), 300.0 * rng.normal(size=(5, 3))):
        assert global_start(room(rng), new, settings) is None
