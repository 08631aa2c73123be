"""Nested dissection and the sparse factor, against dense linear algebra."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.sparse import csc_array, csr_array

from gtsam_nav.frames import Array
from gtsam_nav.graph.dissection import LARGEST_UNDIVIDED, nested_dissection
from gtsam_nav.graph.elimination import Elimination
from gtsam_nav.graph.multifrontal import Factor


def neighbours(place: Array, radius: float) -> Any:
    near = np.linalg.norm(place[:, None] - place[None], axis=2) < radius
    return csr_array(near.astype(np.int32))


def pattern(matrix: Any) -> Any:
    return csr_array(matrix.toarray() != 0.0, dtype=np.int32)


def positive(pattern: Any, rng: np.random.Generator) -> Any:
    """A positive definite matrix with entries where a pattern has them."""
    dense = np.triu(rng.normal(size=pattern.shape) * pattern.toarray(), 1)
    dense = dense + dense.T
    return csc_array(dense + np.diag(1.0 + np.abs(dense).sum(axis=1)))


@pytest.fixture(params=[0, 1])
def place(request: pytest.FixtureRequest) -> Array:
    rng = np.random.default_rng(request.param)
    return np.concatenate([rng.uniform(0, 60, (90, 2)), rng.uniform(200, 260, (90, 2))])


def test_fronts_hold_each_node_once_and_what_touches_lies_on_one_branch(place: Array) -> None:
    adjacent = neighbours(place, 9.0)
    fronts = nested_dissection(adjacent, place, np.ones(len(place), dtype=int))
    assert len(fronts.nodes) > len(place) / LARGEST_UNDIVIDED
    np.testing.assert_array_equal(np.sort(np.concatenate(fronts.nodes)), np.arange(len(place)))
    front_of = np.empty(len(place), dtype=int)
    for k, nodes in enumerate(fronts.nodes):
        front_of[nodes] = k

    def branch(k: int) -> set[int]:
        return {k} if fronts.parent[k] < 0 else {k} | branch(fronts.parent[k])

    assert all(p > k for k, p in enumerate(fronts.parent) if p >= 0)
    for a, b in np.argwhere(adjacent.toarray()).tolist():
        early, late = sorted((int(front_of[a]), int(front_of[b])))
        assert late in branch(early)


def test_separators_are_small_where_the_graph_is_local() -> None:
    x, y = np.meshgrid(np.arange(40.0), np.arange(8.0))
    place = np.column_stack([x.ravel(), y.ravel()])
    fronts = nested_dissection(neighbours(place, 1.5), place, np.ones(len(place), dtype=int))
    last = [nodes for nodes, parent in zip(fronts.nodes, fronts.parent, strict=True) if parent < 0]
    assert [len(nodes) for nodes in last] == [8]


def test_nodes_without_a_place_come_last(place: Array) -> None:
    place[[3, 70]] = np.nan
    near = neighbours(np.nan_to_num(place), 9.0).toarray()
    near[[3, 70]] = near[:, [3, 70]] = 1
    fronts = nested_dissection(csr_array(near), place, np.ones(len(place), dtype=int))
    assert fronts.nodes[-1].tolist() == [3, 70]
    assert fronts.parent.count(-1) == 1


def test_wide_nodes_are_kept_out_of_separators() -> None:
    """Two halves meet in one pair of nodes; the narrower one divides them."""
    place = np.column_stack([np.arange(2.0 * LARGEST_UNDIVIDED), np.zeros(2 * LARGEST_UNDIVIDED)])
    for wide in (LARGEST_UNDIVIDED - 1, LARGEST_UNDIVIDED):
        width = np.ones(len(place), dtype=int)
        width[wide] = 10
        fronts = nested_dissection(neighbours(place, 1.5), place, width)
        assert fronts.nodes[-1].tolist() == [2 * LARGEST_UNDIVIDED - 1 - wide]


def test_solution_and_covariances_equal_the_dense_ones(place: Array) -> None:
    rng = np.random.default_rng(5)
    H = positive(neighbours(place, 9.0), rng)
    fronts = nested_dissection(pattern(H), place, np.ones(len(place), dtype=int))
    factor = Factor(H, Elimination(H, fronts.nodes, fronts.parent))
    b = rng.normal(size=(len(place), 3))
    np.testing.assert_allclose(factor.solve(b), np.linalg.solve(H.toarray(), b), atol=1e-12)
    inverse = np.linalg.inv(H.toarray())
    touching = [np.array(pair) for pair in np.argwhere(H.toarray() != 0.0)]
    for pair, cov in zip(touching, factor.covariances(touching), strict=True):
        np.testing.assert_allclose(cov, inverse[np.ix_(pair, pair)], atol=1e-12)


def test_eliminating_some_columns_leaves_their_schur_complement(place: Array) -> None:
    """Groups that touch only what is left over, and the two stages together."""
    rng = np.random.default_rng(6)
    H = positive(neighbours(place, 9.0), rng)
    seeds = [0, 100, 150]
    groups = [np.array([k]) for k in seeds]
    partial = Factor(H, Elimination(H, groups, [-1] * len(groups)))
    left = partial.elimination.left_over
    dense = H.toarray()
    gain = dense[np.ix_(left, seeds)] @ np.linalg.inv(dense[np.ix_(seeds, seeds)])
    schur = dense[np.ix_(left, left)] - gain @ dense[np.ix_(seeds, left)]
    remainder = partial.remainder(H)
    np.testing.assert_allclose(remainder.toarray(), schur, atol=1e-12)

    fronts = nested_dissection(pattern(remainder), place[left], np.ones(len(left), dtype=int))
    rest = Factor(remainder, Elimination(remainder, fronts.nodes, fronts.parent))
    b = rng.normal(size=(len(place), 2))
    y = partial.forward(b)
    y[-len(left) :] = rest.solve(y[-len(left) :])
    np.testing.assert_allclose(partial.backward(y), np.linalg.solve(dense, b), atol=1e-12)
    inverse = np.linalg.inv(dense)
    of_borders = rest.covariances(partial.elimination.touched_left_over)
    for k, cov in zip(seeds, partial.covariances(groups, of_borders), strict=True):
        np.testing.assert_allclose(cov, inverse[k, k], atol=1e-12)


def test_wide_fronts_and_what_meets_without_an_entry() -> None:
    """Borders of several panels, of which a parent takes some into its own columns."""
    rng = np.random.default_rng(8)
    n, widths = 500, [20, 30, 150, 300]
    dense = rng.normal(size=(n, n))
    dense = dense @ dense.T + n * np.eye(n)
    dense[:20, 20:50] = dense[20:50, :20] = 0.0
    dense[:20, 400:] = dense[400:, :20] = 0.0
    columns = np.split(np.arange(n), np.cumsum(widths)[:-1])
    pattern = csc_array(dense != 0.0).astype(float)
    meeting = csc_array(([1.0, 1.0], ([3, 450], [450, 3])), shape=(n, n))
    factor = Factor(csc_array(dense), Elimination(pattern + meeting, columns, [2, 2, 3, -1]))
    b = rng.normal(size=(n, 2))
    np.testing.assert_allclose(factor.solve(b), np.linalg.solve(dense, b), atol=1e-12)
    inverse = np.linalg.inv(dense)
    wanted = [np.array(block) for block in ([450, 3], [60, 5, 310], [30, 499, 170])]
    for block, cov in zip(wanted, factor.covariances(wanted), strict=True):
        np.testing.assert_allclose(cov, inverse[np.ix_(block, block)], atol=1e-12)


def test_an_entry_that_the_pattern_has_not_is_refused(place: Array) -> None:
    H = positive(neighbours(place, 9.0), np.random.default_rng(9))
    fronts = nested_dissection(pattern(H), place, np.ones(len(place), dtype=int))
    elimination = Elimination(csc_array(np.eye(len(place))), fronts.nodes, fronts.parent)
    with pytest.raises(ValueError, match="pattern"):
        Factor(H, elimination)


def test_an_indefinite_matrix_is_refused(place: Array) -> None:
    H = positive(neighbours(place, 9.0), np.random.default_rng(7)).tolil()
    H[20, 20] = -1.0
    fronts = nested_dissection(pattern(H), place, np.ones(len(place), dtype=int))
    with pytest.raises(np.linalg.LinAlgError):
        Factor(csc_array(H), Elimination(csc_array(H), fronts.nodes, fronts.parent))


def test_a_course_that_is_repeated_is_cut_in_time() -> None:
    """Forty laps of one circle, each place touching the next: across the area a cut meets all."""
    n, laps = 2000, 40
    angle = np.linspace(0.0, 2 * np.pi * laps, n)
    track = np.column_stack([np.cos(angle), np.sin(angle), np.arange(n)])
    chain = csr_array(np.eye(n) + np.eye(n, k=1) + np.eye(n, k=-1))
    ones = np.ones(n, dtype=int)

    def widest_separator(place: Array) -> int:
        fronts = nested_dissection(chain, place, ones)
        inner = set(fronts.parent) - {-1}
        return max(len(fronts.nodes[k]) for k in inner)

    assert widest_separator(track) == 1
    assert widest_separator(track[:, :2]) > laps / 2
