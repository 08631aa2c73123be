"""Landmarks from ranges alone and from bearings alone: placed once one place is left."""

from __future__ import annotations

import numpy as np
import pytest

from gtsam_nav.frames import Array, rotation_from_rpy
from gtsam_nav.preprocess.landmark_placing import (
    NO_PARALLAX,
    TWO_PLACES,
    Placed,
    Views,
    place_by_views,
)
from gtsam_nav.sensors.landmarks import Sighting, polar_coordinates

LANDMARK_N = np.array([30.0, 20.0, 0.0])
SIGMA_M, SIGMA_RAD = 0.2, 0.01


def line(n: int = 40, length_m: float = 40.0) -> Array:
    return np.column_stack([np.linspace(0.0, length_m, n), np.zeros(n), np.zeros(n)])


def corner(n: int = 40) -> Array:
    there = line(n // 2, 20.0)
    return np.vstack([there, [20.0, 0.0, 0.0] + there[:, [1, 0, 2]]])


def views(
    path: Array, kind: str, scale: float = 0.0, landmark_n: Array = LANDMARK_N, seed: int = 0
) -> Views:
    """Exact motion, noisy sightings, the sensor turned as it likes."""
    rng = np.random.default_rng(seed)
    R_ns = rotation_from_rpy(
        np.column_stack([*np.zeros((2, len(path))), rng.normal(size=len(path))])
    )
    p_s = np.einsum("kji,kj->ki", R_ns, landmark_n - path)
    polar, _ = polar_coordinates(p_s, True)
    polar[:, 0] = (1 + scale) * polar[:, 0] + SIGMA_M * rng.normal(size=len(path))
    polar[:, 1:] += SIGMA_RAD * rng.normal(size=(len(path), 2))
    seen = [
        Sighting(
            float(r) if "range" in kind else None,
            float(b) if "bearing" in kind else None,
            float(e) if "elevation" in kind else None,
            SIGMA_M,
            SIGMA_RAD,
        )
        for r, b, e in polar
    ]
    drift = np.arange(len(path)) * 1e-6
    return Views(seen, R_ns, path, drift, drift)


@pytest.mark.parametrize("seed", range(3))
def test_ranges_place_a_landmark_after_a_turn(seed: int) -> None:
    placed = place_by_views(views(corner(), "range", seed=seed), level=True, range_scale_sigma=0.0)
    assert isinstance(placed, Placed)
    assert placed.n_views > 20  # the first leg is straight
    np.testing.assert_allclose(placed.p_n, LANDMARK_N, atol=1.5)


def test_along_a_straight_line_two_mirrored_places_fit() -> None:
    assert place_by_views(views(line(), "range"), level=True, range_scale_sigma=0.0) == TWO_PLACES


def test_a_doubtful_range_scale_does_not_mislead() -> None:
    """Ranges 7 % too long, and both legs long enough to tell."""
    path = corner(80) * 2.0
    placed = place_by_views(views(path, "range", scale=0.07), level=True, range_scale_sigma=0.1)
    assert isinstance(placed, Placed)
    np.testing.assert_allclose(placed.p_n, LANDMARK_N, atol=3.0)


def test_bearings_place_a_landmark_once_there_is_parallax() -> None:
    path = line()
    placed = place_by_views(views(path, "bearing"), level=True, range_scale_sigma=0.0)
    assert isinstance(placed, Placed)
    np.testing.assert_allclose(placed.p_n, LANDMARK_N, atol=6.0)
    seen_from = path[placed.n_views - 1]
    assert np.linalg.norm(seen_from - path[0]) > 3.0


def test_bearings_without_parallax_never_do() -> None:
    path = line(length_m=0.5)
    found = place_by_views(views(path, "bearing"), level=True, range_scale_sigma=0.0)
    assert found == NO_PARALLAX


def test_in_three_dimensions_ranges_need_a_dive() -> None:
    """At one depth the landmark above and the one below fit alike."""
    deep_n = np.array([30.0, 20.0, 15.0])
    level = views(corner(60), "range", landmark_n=deep_n)
    assert place_by_views(level, level=False, range_scale_sigma=0.0) == TWO_PLACES
    path = corner(60)
    path[:, 2] = 10.0 - 10.0 * np.cos(np.linspace(0.0, 2 * np.pi, 60))
    placed = place_by_views(
        views(path, "range", landmark_n=deep_n), level=False, range_scale_sigma=0.0
    )
    assert isinstance(placed, Placed)
    np.testing.assert_allclose(placed.p_n, deep_n, atol=4.0)


def test_bearing_and_elevation_place_it_in_three_dimensions() -> None:
    deep_n = np.array([30.0, 20.0, 15.0])
    placed = place_by_views(
        views(line(), "bearing elevation", landmark_n=deep_n), level=False, range_scale_sigma=0.0
    )
    assert isinstance(placed, Placed)
    np.testing.assert_allclose(placed.p_n, deep_n, atol=6.0)


def test_one_sighting_is_too_few() -> None:
    one = views(line(1), "range")
    assert place_by_views(one, level=True, range_scale_sigma=0.0) == NO_PARALLAX


def test_ranges_that_contradict_each_other_place_nothing() -> None:
    path = corner()
    mixed = [
        views(path, "range", landmark_n=np.array([x, y, 0.0])).sightings[k]
        for k, (x, y) in enumerate(np.random.default_rng(1).uniform(-60, 60, (len(path), 2)))
    ]
    spoilt = Views(
        mixed,
        *(
            getattr(views(path, "range"), name)
            for name in ("R_ns", "p_n", "position_variance", "yaw_variance")
        ),
    )
    assert isinstance(place_by_views(spoilt, level=True, range_scale_sigma=0.0), str)
