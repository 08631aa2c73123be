"""Which scans are compared, and which matches are believed."""

from __future__ import annotations

import numpy as np
import pytest

from gtsam_nav.graph.online import _searches
from gtsam_nav.graph.scan_matching import (
    PlanarPose,
    loop_candidates,
    match_scans,
    relative_pose,
)
from gtsam_nav.graph.settings import LoopSettings
from gtsam_nav.registration.settings import PicSettings
from gtsam_nav.sonar.scans import Scan, planar_rotations

LOOPS = LoopSettings(radius_m=10.0, min_separation_s=60.0, max_candidates=2)


def at(n: float, e: float, sigma_m: float = 0.1, yaw: float = 0.0) -> PlanarPose:
    return PlanarPose(np.array([n, e]), yaw, np.diag([sigma_m**2, sigma_m**2, 1e-4]))


def test_candidates_are_near_and_old_enough() -> None:
    t = np.array([0.0, 100.0, 200.0, 270.0, 300.0])
    poses = [at(3, 0), at(0, 40), at(0, 2), at(0.1, 0), at(0, 0)]
    assert loop_candidates(4, poses, t, LOOPS) == [2, 0]
    assert loop_candidates(0, poses, t, LOOPS) == []
    one = LOOPS.model_copy(update={"max_candidates": 1})
    assert loop_candidates(4, poses, t, one) == [2]


def test_uncertainty_widens_the_radius_up_to_twice() -> None:
    t = np.array([0.0, 300.0])
    assert loop_candidates(1, [at(14, 0), at(0, 0)], t, LOOPS) == []
    assert loop_candidates(1, [at(14, 0, sigma_m=4.0), at(0, 0)], t, LOOPS) == [0]
    assert loop_candidates(1, [at(25, 0, sigma_m=400.0), at(0, 0)], t, LOOPS) == []


def test_candidates_are_of_different_passages() -> None:
    t = np.array([0.0, 10.0, 20.0, 100.0, 300.0])
    poses = [at(1, 0), at(1.1, 0), at(1.2, 0), at(5, 0), at(0, 0)]
    assert loop_candidates(4, poses, t, LOOPS) == [0, 3]


def test_separation_is_a_closed_bound() -> None:
    t = np.array([0.0, 60.0])
    assert loop_candidates(1, [at(0, 0), at(0, 0)], t, LOOPS) == [0]
    assert loop_candidates(1, [at(0, 0), at(0, 0)], t - [0.0, 0.01], LOOPS) == []


def test_relative_pose_and_its_covariance_by_sampling() -> None:
    rng = np.random.default_rng(1)
    root = 0.02 * rng.normal(size=(6, 6))
    joint = root @ root.T
    a, b = at(3, -4, yaw=0.7), at(-2, 5, yaw=-2.8)
    q = relative_pose(a, b, joint)
    draws = rng.multivariate_normal(np.r_[a.ne, a.yaw, b.ne, b.yaw], joint, size=20000)
    ne = np.einsum("kji,kj->ki", planar_rotations(draws[:, 2]), draws[:, 3:5] - draws[:, :2])
    samples = np.column_stack([ne, draws[:, 5] - draws[:, 2]])
    np.testing.assert_allclose(q.ne, samples[:, :2].mean(axis=0), atol=0.01)
    np.testing.assert_allclose(np.cos(q.yaw - (b.yaw - a.yaw)), 1.0)
    np.testing.assert_allclose(q.cov, np.cov(samples.T), atol=0.05 * np.abs(q.cov).max())


def l_shaped_scan() -> Scan:
    x = np.linspace(-8, 8, 50)
    xy = np.concatenate([np.column_stack([x, 0 * x + 6]), np.column_stack([0 * x + 8, x - 2])])
    return Scan(0.0, xy, np.tile(0.01 * np.eye(2), (100, 1, 1)))


@pytest.mark.parametrize(("off_m", "accepted"), [(0.2, True), (0.9, False)])
def test_match_that_contradicts_the_estimate_is_rejected(off_m: float, accepted: bool) -> None:
    scans = [l_shaped_scan(), l_shaped_scan()]
    prior = PlanarPose(np.array([0.0, off_m]), 0.0, np.diag([0.1**2, 0.1**2, 0.02**2]))
    wide = PicSettings(min_overlap=0.0)
    found = match_scans(0, 1, scans, prior, wide, 0.999, is_loop=True)
    assert found.accepted == accepted
    assert found.is_loop
    if not accepted:
        assert "contradicts the estimate" in found.reason


@pytest.mark.parametrize("n_scans", [1, 7, 10, 11, 25, 1000])
def test_a_bounded_number_of_scans_search_at_even_intervals(n_scans: int) -> None:
    searching = np.flatnonzero([_searches(new, n_scans, 10) for new in range(n_scans)])
    assert len(searching) == min(n_scans, 10)
    intervals = np.diff(searching)
    assert len(intervals) == 0 or intervals.max() - intervals.min() <= 1
