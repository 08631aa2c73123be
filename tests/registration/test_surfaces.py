"""What aligned points tell: planes, their noise, and the covariance of the pose."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gtsam_nav.frames import Array, skew
from gtsam_nav.registration.open3d_global import global_start
from gtsam_nav.registration.result import RelativePose
from gtsam_nav.registration.settings import Open3dSettings
from gtsam_nav.registration.surfaces import (
    Alignment,
    Surfaces,
    _planes,
    design_effect,
    match_covariance,
)

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


@pytest.mark.parametrize("gate_m", [0.1, 1.0])
def test_what_is_known_of_places_nearby_is_what_a_new_look_finds(gate_m: float) -> None:
    rng = np.random.default_rng(8)
    planes, new = Surfaces(room(rng)), room(rng)[::5]
    turn = Rotation.from_rotvec([0.01, -0.02, 0.03]).as_matrix()
    R_ab, p_a, carried = planes.refine(new, turn, np.array([0.1, 0.05, -0.1]), gate_m)
    looked = planes.align(new, R_ab, p_a, gate_m)
    assert 0.3 < carried.fitness == looked.fitness
    for name in ("residual", "jacobian", "cov_normal_b", "place"):
        np.testing.assert_allclose(
            getattr(carried, name), getattr(looked, name), rtol=1e-6, atol=1e-10, err_msg=name
        )


def test_a_reference_of_a_few_points_is_one_plane_everywhere() -> None:
    few = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]])
    found = Surfaces(few).align(few, np.eye(3), np.array([0.0, 0.0, 0.1]), 0.2)
    np.testing.assert_allclose(np.abs(found.residual), 0.1)


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
    np.testing.assert_allclose(sigma[[2, 3, 4]], [1.0, 10.0, 10.0], rtol=0.02)
    assert sigma[[0, 1, 5]].max() < 0.05


def test_too_few_residuals_tell_nothing() -> None:
    rng = np.random.default_rng(2)
    planes = Surfaces(room(rng))
    assert match_covariance(planes.align(room(rng)[:10], np.eye(3), np.zeros(3), 0.5), 0.25) is None


def crossed(cov_normal: Array, seed: int = 6, m: int = 60) -> Alignment:
    """Points with residuals of one size and normals all round, each in a block of its own."""
    rng = np.random.default_rng(seed)
    arm, normal = rng.uniform(-5.0, 5.0, size=(m, 3)), rng.normal(size=(m, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return Alignment(
        residual=NOISE_M * np.where(np.arange(m) % 2, 1.0, -1.0),
        jacobian=np.hstack([np.cross(arm, normal), normal]),
        cov_normal_b=np.tile(cov_normal, (m, 1, 1)),
        arm_b=arm,
        place=1000.0 * np.arange(3 * m).reshape(m, 3),
        fitness=1.0,
    )


def test_the_covariance_is_that_of_least_squares() -> None:
    """Also where some residuals are of points without a partner: these count for nothing."""
    exact = crossed(np.zeros((3, 3)))
    stray = replace(exact, residual=np.where(np.arange(60) < 6, 3.0, exact.residual))
    vague = np.diag([1.0] * 3 + [0.1**2] * 3)
    for found, kept in ((exact, slice(None)), (stray, slice(6, None))):
        J = found.jacobian[kept]
        wanted = np.linalg.inv(J.T @ J / NOISE_M**2 + vague)
        cov = match_covariance(found, 0.25)
        assert cov is not None
        np.testing.assert_allclose(cov, wanted, rtol=1e-5, atol=1e-12)


def test_what_errs_together_counts_once() -> None:
    """Pairs of equal residuals in a cube of eight spacings: twice the covariance."""
    found = crossed(np.zeros((3, 3)))
    pairs = np.repeat(np.arange(30), 2)
    same = replace(found, residual=found.residual[pairs])
    cov = match_covariance(same, 0.25)
    for apart_m, factor in ((1.9, 2.0), (2.1, 1.0)):
        place = np.zeros((60, 3))
        place[:, 0] = 10.0 * pairs + np.where(np.arange(60) % 2, apart_m, 0.0)
        together = match_covariance(replace(same, place=place), 0.25)
        assert cov is not None
        assert together is not None
        np.testing.assert_allclose(np.diag(together), factor * np.diag(cov), rtol=1e-3)


def test_what_noisy_normals_feign_is_taken_off_twice() -> None:
    cov_normal = np.diag([3e-4, 1e-4, 2e-4])
    noisy = crossed(cov_normal)
    feigned = np.zeros((6, 6))
    for arm in noisy.arm_b:
        by_normal = np.vstack([skew(arm), np.eye(3)])
        feigned += by_normal @ cov_normal @ by_normal.T
    information = noisy.jacobian.T @ noisy.jacobian - 2.0 * feigned
    vague = np.diag([1.0] * 3 + [0.1**2] * 3)
    cov = match_covariance(noisy, 0.25)
    assert cov is not None
    np.testing.assert_allclose(cov, np.linalg.inv(information / NOISE_M**2 + vague), rtol=1e-5)


def test_as_few_residuals_as_are_needed_are_enough() -> None:
    assert match_covariance(crossed(np.zeros((3, 3)), m=20), 0.25) is not None
    assert match_covariance(crossed(np.zeros((3, 3)), m=19), 0.25) is None


def test_normals_are_as_uncertain_as_they_say() -> None:
    """Of planes of ten points, 2 m by 1 m in spread, with noise across them."""
    rng = np.random.default_rng(7)
    xy = np.column_stack([rng.normal(scale=2.0, size=10), rng.normal(scale=1.0, size=10)])
    around = np.concatenate(
        [np.tile(xy, (4000, 1, 1)), rng.normal(scale=NOISE_M, size=(4000, 10, 1))], axis=2
    )
    centre, normal, cov_normal, is_plane = _planes(around)
    assert np.all(is_plane)
    np.testing.assert_allclose(centre[:, :2], np.tile(xy.mean(axis=0), (4000, 1)), atol=1e-12)
    lean = normal[:, :2] / normal[:, 2:]
    np.testing.assert_allclose(cov_normal.mean(axis=0)[:2, :2], np.cov(lean.T), rtol=0.1, atol=2e-6)


@pytest.mark.parametrize(("thickness", "is_flat"), [(0.9, True), (1.1, False)])
def test_a_plane_is_three_times_thinner_than_narrow(thickness: float, is_flat: bool) -> None:
    box = np.array(list(product((-6.0, 6.0), (-3.0, 3.0), (-thickness, thickness))))
    assert _planes(box[None])[3].tolist() == [is_flat]


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
