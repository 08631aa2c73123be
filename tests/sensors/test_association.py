"""Which landmark a sighting is of: alone, and together with the others of its moment."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from gtsam_nav.frames import Array
from gtsam_nav.sensors import association
from gtsam_nav.sensors.association import NONE, Comparison, joint, nearest
from gtsam_nav.sensors.prediction import chi2_limit

PROBABILITY, WIDE = 0.99, 1.0 - 1e-9
LANDMARKS = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [3.0, 0.0]])
SIGMA = 0.05


def compared(
    seen: Array, landmarks: Array, shared_sigma: float, sigma: float = SIGMA
) -> Comparison:
    """Points seen from a vehicle whose own place is uncertain: an error that all of them share."""
    k = len(landmarks)
    return Comparison(
        landmarks[None] - seen[:, None],
        shared_sigma**2 * np.einsum("ab,ij->aibj", np.ones((k, k)), np.eye(2)),
        np.tile(sigma**2 * np.eye(2), (len(seen), 1, 1)),
    )


@pytest.mark.parametrize("match", [nearest, joint])
def test_clear_cases_are_paired(match: object) -> None:
    seen = compared(LANDMARKS[[2, 0]] + 0.02, LANDMARKS, 0.05)
    assert callable(match)
    np.testing.assert_array_equal(match(seen, PROBABILITY), [2, 0])


@pytest.mark.parametrize("match", [nearest, joint])
def test_what_is_near_nothing_is_paired_with_nothing(match: object) -> None:
    seen = compared(np.array([[0.01, 0.0], [9.0, 9.0]]), LANDMARKS, 0.05)
    assert callable(match)
    np.testing.assert_array_equal(match(seen, PROBABILITY), [0, NONE])


def test_joint_compatibility_is_right_where_the_nearest_errs() -> None:
    # the vehicle is off by 0.6 m: each sighting lies nearer to the next landmark than to its own
    seen = compared(LANDMARKS[:3] + np.array([0.6, 0.0]), LANDMARKS[:3], 0.5)
    alone, together = nearest(seen, PROBABILITY), joint(seen, PROBABILITY)
    np.testing.assert_array_equal(together, [0, 1, 2])
    assert not np.array_equal(alone, [0, 1, 2])


def test_joint_compatibility_leaves_out_what_does_not_agree() -> None:
    # three agree on the vehicle's error, a false one is individually compatible only
    seen = compared(
        np.vstack([LANDMARKS[:3] + np.array([0.3, 0.3]), [[3.3, -0.6]]]),
        LANDMARKS,
        shared_sigma=0.5,
    )
    assert nearest(seen, PROBABILITY)[3] == 3
    np.testing.assert_array_equal(joint(seen, PROBABILITY), [0, 1, 2, NONE])


def fit_of(seen: Comparison, pairing: tuple[int, ...]) -> tuple[int, float]:
    """How good a joint pairing is: how many pairs, and how little they disagree."""
    pairs = [(s, k) for s, k in enumerate(pairing) if k != NONE]
    if not pairs:
        return 0, 0.0
    nis = seen.joint_nis(*map(list, zip(*pairs, strict=True)))
    return (len(pairs), -nis) if nis <= chi2_limit(WIDE, 2 * len(pairs)) else (-1, 0.0)


@pytest.mark.parametrize("seed", range(12))
def test_no_joint_pairing_is_better_than_the_one_that_is_found(seed: int) -> None:
    """All pairings of three sightings with four landmarks in a heap, one by one.

    The gate is so wide that no part of a pairing fails it where the whole does not.
    """
    rng = np.random.default_rng(seed)
    heap = rng.normal(scale=0.4, size=(4, 2))
    shifted = heap[:3] + rng.normal(scale=0.3, size=2) + rng.normal(scale=0.1, size=(3, 2))
    seen = compared(shifted, heap, 0.3, 0.1)
    possible = [
        pairing
        for pairing in product(range(NONE, 4), repeat=3)
        if len({k for k in pairing if k != NONE}) == sum(k != NONE for k in pairing)
    ]
    best = max(possible, key=lambda pairing: fit_of(seen, pairing))
    np.testing.assert_array_equal(joint(seen, WIDE), best)


def test_what_is_of_no_landmark_has_the_id_of_the_unknown() -> None:
    far = compared(np.array([[90.0, 90.0]]), LANDMARKS, 0.05)
    assert nearest(far, PROBABILITY).tolist() == joint(far, PROBABILITY).tolist() == [-1]


def test_of_two_sightings_of_a_landmark_the_nearer_gets_it() -> None:
    seen = compared(np.array([[0.1, 0.0], [0.01, 0.0]]), LANDMARKS[:1], 0.2)
    for match in (nearest, joint):
        np.testing.assert_array_equal(match(seen, PROBABILITY), [NONE, 0])


def test_of_equally_large_pairings_the_best_fit_wins() -> None:
    seen = compared(np.array([[0.45, 0.0], [1.45, 0.0]]), LANDMARKS[:3], shared_sigma=1.0)
    np.testing.assert_array_equal(joint(seen, PROBABILITY), [0, 1])


def test_the_search_ends_in_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(association, "MOST_NODES", 200)
    evaluated = 0
    one = Comparison.joint_nis

    def counted(self: Comparison, sightings: list[int], landmarks: list[int]) -> float:
        nonlocal evaluated
        evaluated += 1
        return one(self, sightings, landmarks)

    monkeypatch.setattr(Comparison, "joint_nis", counted)
    rng = np.random.default_rng(0)
    # all may be anything: thirteen sightings and as many landmarks in a heap
    heap = 0.3 * rng.normal(size=(13, 2))
    found = joint(compared(heap + 0.2 * rng.normal(size=heap.shape), heap, 2.0, 0.3), PROBABILITY)
    assert evaluated < 13 * 220
    paired = found[found != NONE]
    assert len(paired) >= 8
    assert len(np.unique(paired)) == len(paired)


def test_a_singular_covariance_pairs_with_nothing() -> None:
    seen = Comparison(np.zeros((2, 1, 2)), np.zeros((1, 2, 1, 2)), np.zeros((2, 2, 2)))
    assert np.all(np.isinf(seen.nis))
    for match in (nearest, joint):
        np.testing.assert_array_equal(match(seen, PROBABILITY), [NONE, NONE])


def test_without_landmarks_there_is_nothing_to_pair() -> None:
    seen = compared(LANDMARKS, np.empty((0, 2)), 0.1)
    for match in (nearest, joint):
        np.testing.assert_array_equal(match(seen, PROBABILITY), np.full(4, NONE))


def test_some_sightings_against_some_landmarks_are_compared_as_before() -> None:
    rng = np.random.default_rng(4)
    whole = compared(LANDMARKS[:3] + rng.normal(scale=0.1, size=(3, 2)), LANDMARKS, 0.3)
    sightings, landmarks = np.array([2, 0]), np.array([True, False, True, True])
    part = whole.of(sightings, landmarks)
    np.testing.assert_array_equal(part.nis, whole.nis[sightings][:, landmarks])
    assert part.joint_nis([0, 1], [2, 0]) == whole.joint_nis([2, 0], [3, 0])
    assert part.m == 2
