"""Which scans are compared."""

from __future__ import annotations

import numpy as np

from gtsam_nav.graph.scan_pairs import nearby_scans


def test_scans_taken_near_each_other_are_compared() -> None:
    ne = np.column_stack([10.0 * np.arange(6), np.zeros(6)])
    found = nearby_scans(ne, np.ones(6, dtype=int), 15.0, 100)
    np.testing.assert_array_equal(found, [[0, 1], [1, 2], [2, 3], [3, 4], [4, 5]])


def test_scans_without_echoes_are_not() -> None:
    ne = np.column_stack([10.0 * np.arange(4), np.zeros(4)])
    found = nearby_scans(ne, np.array([3, 0, 2, 1]), 25.0, 100)
    np.testing.assert_array_equal(found, [[0, 2], [2, 3]])


def test_each_passage_brings_its_nearest_first() -> None:
    """Ten passages over the same five places; the nearest scans are not all of one passage."""
    ne = np.column_stack([np.tile(4.0 * np.arange(5), 10), np.repeat(0.1 * np.arange(10), 5)])
    ne[:, 0] += 1e3 * (np.arange(50) % 5 == 4)  # the passages do not follow each other
    found = nearby_scans(ne, np.ones(50, dtype=int), 30.0, 9)
    of_first = {b for a, b in found.tolist() if a == 0}
    assert set(range(5, 50, 5)) <= of_first


def test_pairs_grow_with_the_number_of_scans() -> None:
    """Not with its square, where the same place is seen again and again."""
    rng = np.random.default_rng(0)
    ne = rng.uniform(0, 20, (400, 2))
    sizes = np.ones(400, dtype=int)
    assert len(nearby_scans(ne, sizes, 30.0, 1000)) == 400 * 399 // 2
    bounded = nearby_scans(ne, sizes, 30.0, 20)
    assert 400 * 20 // 2 <= len(bounded) <= 400 * 20
    assert np.all(bounded[:, 0] < bounded[:, 1])
    assert len(np.unique(bounded, axis=0)) == len(bounded)


def test_pairs_at_one_place_follow_each_other() -> None:
    """Their echoes are then still in the cache, however many laps came between them."""
    ne = np.column_stack([np.tile(np.arange(0.0, 1000.0, 10.0), 20), np.zeros(2000)])
    found = nearby_scans(ne, np.ones(2000, dtype=int), 15.0, 10)
    moved_m = np.abs(np.diff(ne[found[:, 0], 0]))
    in_order_of_time = np.abs(np.diff(ne[np.unique(found, axis=0)[:, 0], 0]))
    assert np.sum(moved_m) < 0.2 * np.sum(in_order_of_time)
