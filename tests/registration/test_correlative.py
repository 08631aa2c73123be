"""Correlative registration: the best of all poses, and none where another is as good."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from gtsam_nav.frames import Array
from gtsam_nav.registration._correlative_kernel import _squared, score_volume
from gtsam_nav.registration.correlative import MARGIN_CELLS, _bound, search, thinned
from gtsam_nav.registration.settings import CorrelativeSettings
from gtsam_nav.sonar.scans import planar_rotations

SETTINGS = CorrelativeSettings()
VAGUE = np.diag([2.0, 2.0, np.radians(8.0)]) ** 2


def wall(a: tuple[float, float], b: tuple[float, float]) -> Array:
    n = int(np.hypot(b[0] - a[0], b[1] - a[1]) / 0.1)
    return np.linspace(a, b, n)


def room() -> Array:
    """Of no symmetry: an L with a niche."""
    corners = [(-6, -4), (7, -4), (7, 1), (2, 1), (2, 6), (-2, 6), (-2, 4), (-6, 4), (-6, -4)]
    return np.concatenate([wall(a, b) for a, b in pairwise(corners)])


def seen_from(xy: Array, q: Array) -> Array:
    return (xy - q[:2]) @ planar_rotations(q[2])


@pytest.mark.parametrize("q", [(0.0, 0.0, 0.0), (2.3, -1.7, 0.31), (-3.1, 2.6, -0.4)])
def test_the_pose_is_found_from_afar(q: tuple[float, float, float]) -> None:
    true = np.array(q)
    found = search(room(), seen_from(room(), true), np.zeros(3), VAGUE, SETTINGS)
    assert found.failure == ""
    assert np.hypot(*(found.q - true)[:2]) < 2 * SETTINGS.cell_m
    assert abs(found.q[2] - true[2]) < 0.05
    assert found.score > 0.7


def test_a_pose_beyond_what_the_prior_allows_is_not_found() -> None:
    sure = np.diag([0.2, 0.2, np.radians(1.0)]) ** 2
    found = search(
        room(), seen_from(room(), np.array([4.0, 0.0, 0.0])), np.zeros(3), sure, SETTINGS
    )
    assert found.failure.startswith("score")
    assert np.hypot(*found.q[:2]) < 1.5


def test_a_corridor_tells_nothing_of_the_way_along_it() -> None:
    corridor = np.concatenate([wall((-20, -1), (20, -1)), wall((-20, 1), (20, 1))])
    near = corridor[np.abs(corridor[:, 0]) < 8]
    found = search(corridor, near, np.array([0.5, 0.0, 0.0]), VAGUE, SETTINGS)
    assert found.failure.startswith("ambiguous")


def test_the_search_has_its_reach() -> None:
    near = CorrelativeSettings(reach_m=2.0)
    new = seen_from(room(), np.array([4.0, 0.0, 0.0]))
    assert search(room(), new, np.zeros(3), 25.0 * VAGUE, near).failure
    far = CorrelativeSettings(reach_m=8.0)
    assert search(room(), new, np.zeros(3), 25.0 * VAGUE, far).q[0] == pytest.approx(4.0, abs=0.3)


@pytest.mark.parametrize("sigma", [(1.0, 1.0, 2.0), (50.0, 1.0, 0.05), (1.0, 1.0, 0.05)])
def test_what_is_vague_takes_no_reach_from_the_rest(sigma: tuple[float, float, float]) -> None:
    true = np.array([1.5, -2.0, 0.1])
    found = search(room(), seen_from(room(), true), np.zeros(3), np.diag(sigma) ** 2, SETTINGS)
    assert found.failure == ""
    np.testing.assert_allclose(found.q, true, atol=0.25)


def test_half_a_turn_is_no_rival_of_itself() -> None:
    """From either side."""
    around = CorrelativeSettings(reach_deg=180.0)
    true = np.array([0.3, 0.0, np.pi])
    unknown = np.diag([1.0, 1.0, 3.0]) ** 2
    found = search(room(), seen_from(room(), true), np.zeros(3), unknown, around)
    assert found.failure == ""
    assert abs(found.q[2]) == pytest.approx(np.pi, abs=0.05)


@pytest.mark.slow
def test_nothing_in_common_is_no_match() -> None:
    found = search(room(), room() + np.array([500.0, 0.0]), np.zeros(3), VAGUE, SETTINGS)
    assert found.score == 0.0
    assert found.failure.startswith("score 0.00")


def test_blocks_bound_what_is_in_them() -> None:
    field = np.random.default_rng(0).random((20, 13))
    bound = _bound(field)
    for i, j in [(0, 0), (5, 7), (19, 12), (16, 3)]:
        assert bound[i, j] == field[i : i + 4, j : j + 4].max()


def test_thinned_points_are_the_means_of_their_cells() -> None:
    xy = np.array([[0.1, 0.1], [0.3, 0.1], [1.2, 0.4], [-0.1, 0.2]])
    thin = thinned(xy, 1.0)
    np.testing.assert_allclose(sorted(thin.tolist()), [[-0.1, 0.2], [0.2, 0.1], [1.2, 0.4]])


def test_the_gate_is_the_mahalanobis_distance_to_the_prior() -> None:
    rng = np.random.default_rng(1)
    root = rng.normal(size=(3, 3))
    A = root @ root.T
    for x, y, turn in rng.normal(size=(5, 3)):
        pose = np.array([0.2 * x, 0.2 * y, turn])
        assert _squared(x, y, turn, 0.2, A) == pytest.approx(pose @ A @ pose)


def test_what_is_told_of_the_volume_is_the_mean_of_the_field_and_holds_the_best() -> None:
    rng = np.random.default_rng(2)
    field = np.pad(rng.random((16, 22)), MARGIN_CELLS)
    q, corner, cell_m, blocks = np.array([1.0, 2.0, 0.3]), np.array([-2.0, -1.0]), 0.25, 2
    xy, turns = rng.uniform(-1.5, 1.5, size=(7, 2)), np.array([-0.2, 0.0, 0.2])
    told = score_volume(
        field, _bound(field), 4, corner, cell_m, xy, q, np.zeros((3, 3)), 1.0, turns, blocks, 0.9
    )
    plain = np.zeros_like(told)
    for k, turn in enumerate(turns):
        cells = np.rint((q[:2] + xy @ planar_rotations(q[2] + turn).T - corner) / cell_m)
        for i, j in np.ndindex(16, 16):
            for row, column in (cells + np.array([i - 8, j - 8])).astype(int):
                inside = 0 <= row < 24 and 0 <= column < 30
                plain[k, i, j] += (field[row, column] if inside else 0.0) / len(xy)
    known = np.isfinite(told)
    np.testing.assert_allclose(told[known], plain[known])
    assert np.all(known[plain >= 0.9 * plain.max()])


def test_a_block_counts_where_its_middle_lies_within_the_gate() -> None:
    blocks, block, cell_m = 3, 4, 0.5
    A, gate = np.diag([1.0, 0.5, 200.0]), 9.0
    turns = np.array([-0.1, 0.0, 0.2])
    field = np.ones((60, 60))
    told = score_volume(
        *(field, field, block, np.array([-15.0, -15.0]), cell_m, np.zeros((1, 2)), np.zeros(3)),
        *(A, gate, turns, blocks, 0.0),
    )
    for k, i, j in np.ndindex(3, 2 * blocks, 2 * blocks):
        middle_m = (np.array([i, j]) - blocks + 0.5) * block * cell_m - cell_m / 2
        pose = np.append(middle_m, turns[k])
        part = told[k, i * block : (i + 1) * block, j * block : (j + 1) * block]
        assert np.all(np.isfinite(part) == (pose @ A @ pose <= gate)), (k, i, j)
