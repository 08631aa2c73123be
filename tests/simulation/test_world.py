"""The marina: its size, its water, and the rays that cross it."""

from __future__ import annotations

import numpy as np
import pytest

from gtsam_nav.frames import Origin
from gtsam_nav.simulation.marina import CORRIDOR_AZIMUTH_DEG, marina
from gtsam_nav.simulation.raycast import cast
from gtsam_nav.simulation.world import Course, Wall, World, segment_distances


def box_with_post() -> World:
    """A room of 20 m x 10 m around zero with one post at (4, 0)."""
    corners = np.array([[10, 5], [10, -5], [-10, -5], [-10, 5], [10, 5.0]])
    return World(
        name="box",
        origin=Origin(0.0, 0.0),
        course=Course(np.array([[1.0, 1.0], [-1.0, 1.0], [0.0, -1.0]]), closed=True),
        landmark_id=np.array([1]),
        landmarks_n=np.array([[0.0, 3.0, 1.0]]),
        walls=(Wall(corners, 1.0),),
        piles_n=np.array([[4.0, 0.0]]),
        pile_radius_m=0.5,
    )


def test_marina_has_the_size_that_it_claims() -> None:
    turn = np.radians(CORRIDOR_AZIMUTH_DEG)
    corners = np.concatenate([w.corners_n for w in marina().walls])
    along = corners @ [np.cos(turn), np.sin(turn)]
    across = corners @ [-np.sin(turn), np.cos(turn)]
    assert np.ptp(along) == pytest.approx(240, abs=1)
    assert np.ptp(across) == pytest.approx(120, abs=1)


def test_distance_to_a_segment_beside_and_beyond_its_ends() -> None:
    segment = np.array([[[0.0, 0.0], [10.0, 0.0]]])
    distances = segment_distances([[5.0, 2.0], [13.0, 4.0], [-3.0, 0.0]], segment)
    np.testing.assert_allclose(distances[:, 0], [2.0, 5.0, 3.0])


def test_clearance_counts_walls_piles_and_buoys() -> None:
    world = box_with_post()
    clear = world.clearance([[8.0, 0.0], [2.0, 0.0], [0.0, 2.0]])
    np.testing.assert_allclose(clear, [2.0, 1.5, 0.5])


def test_wall_distances_are_one_column_a_wall() -> None:
    world = marina()
    points = world.course.waypoints_n
    distances = world.wall_distances(points)
    for column, wall in zip(distances.T, world.walls, strict=True):
        pieces = np.stack([wall.corners_n[:-1], wall.corners_n[1:]], axis=1)
        np.testing.assert_allclose(column, segment_distances(points, pieces).min(axis=1))


def test_rays_meet_the_nearest_thing_at_its_range_and_incidence() -> None:
    azimuth = np.radians([[0.0, 180.0, 270.0, 135.0]])
    hits = cast(box_with_post(), np.zeros((1, 2)), azimuth, 50.0)
    np.testing.assert_allclose(hits.range_m[0], [3.5, 10.0, 5.0, 5 * np.sqrt(2)])
    np.testing.assert_allclose(hits.cosine[0], [1.0, 1.0, 1.0, np.sqrt(0.5)])
    np.testing.assert_allclose(hits.to_edge_m[0], [np.inf, 5.0, 10.0, 5.0])


def test_rays_meet_nothing_beyond_the_range() -> None:
    hits = cast(box_with_post(), np.zeros((1, 2)), np.radians([[180.0, 270.0]]), 8.0)
    assert np.isinf(hits.range_m[0, 0])
    assert hits.range_m[0, 1] == pytest.approx(5.0)


def test_open_water_has_no_walls_to_meet() -> None:
    world = World("sea", None, Course(np.array([[0.0, 0.0], [5.0, 0.0]]), closed=False))
    assert world.wall_distances([[1.0, 2.0]]).shape == (1, 0)
    assert world.segments_n.shape == (0, 2, 2)
    assert np.isinf(cast(world, np.zeros((1, 2)), np.zeros((1, 3)), 50.0).range_m).all()
