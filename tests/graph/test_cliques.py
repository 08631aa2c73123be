"""The largest clique against all subsets, and on graphs too big for that."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gtsam_nav.graph import cliques
from gtsam_nav.graph.cliques import largest_clique
from gtsam_nav.series import BoolArray


def random_graph(n: int, density: float, seed: int) -> BoolArray:
    upper = np.triu(np.random.default_rng(seed).uniform(size=(n, n)) < density, 1)
    return np.asarray(upper | upper.T)


def is_clique(adjacent: BoolArray, vertices: list[int]) -> bool:
    return all(adjacent[i, j] for i, j in combinations(vertices, 2))


@given(st.integers(0, 9), st.floats(0.0, 1.0), st.integers(0, 2**31))
def test_none_is_larger(n: int, density: float, seed: int) -> None:
    adjacent = random_graph(n, density, seed)
    found = largest_clique(adjacent)
    assert found == sorted(set(found))
    assert is_clique(adjacent, found)
    larger = combinations(range(n), len(found) + 1)
    assert not any(is_clique(adjacent, list(vertices)) for vertices in larger)


def test_hundreds_that_nearly_all_agree_among_as_many_that_do_not() -> None:
    """As loop closures are: 200 true ones with a few quarrels, 200 false in groups of ten."""
    adjacent = random_graph(400, 0.02, seed=1)
    adjacent[:200, :200] = random_graph(200, 0.998, seed=2)
    for first in range(200, 400, 10):
        adjacent[first : first + 10, first : first + 10] = True
    found = largest_clique(adjacent)
    assert is_clique(adjacent, found)
    assert found[-1] < 200
    assert len(found) > 170
    assert found == largest_clique(adjacent)


def test_beyond_its_branches_the_greedy_clique_stands(monkeypatch) -> None:  # type: ignore[no-untyped-def]
    adjacent = random_graph(60, 0.7, seed=3)
    exact = largest_clique(adjacent)
    monkeypatch.setattr(cliques, "MOST_BRANCHES", 0)
    greedy = largest_clique(adjacent)
    assert is_clique(adjacent, greedy)
    assert len(exact) - 2 <= len(greedy) <= len(exact)
