"""Least squares over planar poses: exact where data agree, deaf to a false sighting."""

from __future__ import annotations

import numpy as np
import pytest

from gtsam_nav.frames import Array
from gtsam_nav.preprocess.planar_motion import Increments
from gtsam_nav.preprocess.planar_smoothing import SightedPoints, smooth

KNOWN = np.array([[3.0, 2.0], [4.0, -1.0], [1.0, 4.0]])
SIGMA_M, SIGMA_STEP = 0.05, 0.1


def problem(n: int = 6) -> tuple[Array, Increments, SightedPoints, Array]:
    """Poses, increments between them and what is seen from them, all exact."""
    course = 0.3 + 0.2 * np.arange(n)
    x = np.column_stack([0.4 * np.arange(n), 0.1 * np.arange(n) ** 2, course])
    c, s = np.cos(course), np.sin(course)
    step = np.diff(x[:, :2], axis=0)
    along = np.column_stack(
        [c[:-1] * step[:, 0] + s[:-1] * step[:, 1], c[:-1] * step[:, 1] - s[:-1] * step[:, 0]]
    )
    variance = np.full((n - 1, 3), SIGMA_STEP**2)
    increments = Increments(along, np.diff(course), variance, along[:, 0])
    pose, point = np.repeat(np.arange(n), len(KNOWN)), np.tile(np.arange(len(KNOWN)), n)
    offset = KNOWN[point] - x[pose, :2]
    p_b = np.column_stack(
        [
            c[pose] * offset[:, 0] + s[pose] * offset[:, 1],
            c[pose] * offset[:, 1] - s[pose] * offset[:, 0],
        ]
    )
    cov_b = np.tile(SIGMA_M**2 * np.eye(2), (len(pose), 1, 1))
    return x, increments, SightedPoints(pose, p_b, cov_b), KNOWN[point]


def test_exact_data_are_met_from_afar() -> None:
    x, increments, seen, known = problem()
    rng = np.random.default_rng(0)
    begin = x + rng.normal(scale=[0.3, 0.3, 0.1], size=x.shape)
    found, cov = smooth(begin, increments, seen, lambda _: known, doubt=10.0)
    np.testing.assert_allclose(found, x, atol=1e-4)
    assert np.all(np.linalg.eigvalsh(cov) > 0)
    np.testing.assert_allclose(cov, cov.T, atol=1e-12)


def test_a_false_sighting_loses_its_say() -> None:
    x, increments, seen, known = problem()
    seen.p_b[4] += [1.5, -2.0]
    found, _ = smooth(x, increments, seen, lambda _: known, doubt=10.0)
    np.testing.assert_allclose(found, x, atol=0.02)


def test_a_standing_vehicle_is_a_solvable_problem() -> None:
    x, _, seen, known = problem(2)
    still = Increments(np.zeros((1, 2)), np.zeros(1), np.zeros((1, 3)), np.zeros(1))
    first = SightedPoints(np.zeros_like(seen.pose[:3]), seen.p_b[:3], seen.cov_b[:3])
    found, _ = smooth(x[[0, 0]], still, first, lambda _: known[:3], doubt=10.0)
    np.testing.assert_allclose(found, x[[0, 0]], atol=1e-6)


def test_the_covariance_is_that_of_many_draws() -> None:
    rng = np.random.default_rng(1)
    x, increments, seen, known = problem(3)
    ends = []
    for _ in range(400):
        drawn = Increments(
            increments.displacement_b + rng.normal(scale=SIGMA_STEP, size=(2, 2)),
            increments.turn + rng.normal(scale=SIGMA_STEP, size=2),
            increments.variance,
            increments.bent_m,
        )
        p_b = seen.p_b + rng.normal(scale=SIGMA_M, size=seen.p_b.shape)
        # weights of one: the noise is as stated
        found, cov = smooth(
            x, drawn, SightedPoints(seen.pose, p_b, seen.cov_b), lambda _: known, 1e9
        )
        ends.append(found.ravel())
    ratio = np.var(ends, axis=0) / np.diag(cov)
    assert np.mean(ratio) == pytest.approx(1.0, abs=0.15)
