"""What surrounds the vehicle: walls, piles, landmarks, and the course between them."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from gtsam_nav.frames import Array, Origin
from gtsam_nav.series import IntArray


@dataclass(frozen=True)
class Wall:
    """A vertical wall along a polyline.

    Attributes
    ----------
    corners_n : ndarray, shape (k, 2)
        North and east of its corners, m.
    reinforcement : float
        How much steel it holds, and which way that turns a compass: -1 to 1.
    height_m : float
        Of its top above the water.
    """

    corners_n: Array
    reinforcement: float
    height_m: float = 2.0


@dataclass(frozen=True)
class Course:
    """Where the vehicle goes, seen from above: a smooth curve through waypoints.

    Attributes
    ----------
    waypoints_n : ndarray, shape (w, 2)
        North and east, m.
    closed : bool
        Whether the last leads back to the first, for as long as the mission lasts; else the
        vehicle stops at the last one.
    """

    waypoints_n: Array
    closed: bool


@dataclass(frozen=True)
class World:
    """A place seen from above, in local NED, and the course through it.

    Attributes
    ----------
    origin : Origin or None
        None stands for a laboratory's own frame: no Earth rate, standard gravity.
    course : Course
    landmark_id : ndarray of int, shape (m,)
    landmarks_n : ndarray, shape (m, 3)
        What a landmark sensor tells apart (moored reflectors, beacons), m.
    walls : tuple of Wall
    piles_n : ndarray, shape (k, 2)
        Centres of round piles, m.
    pile_radius_m, pile_height_m : float
        The latter above the water.
    basin_n : ndarray, shape (c, 2)
        Corners of the water's outline; beyond it lies level ground.
    ground_m : float
        Height of that ground above the water.
    flat : bool
        Gravity is that of the origin everywhere, wrong by 1.5e-6 m/s^2 a metre away from it; else
        it follows the ellipsoid.
    """

    name: str
    origin: Origin | None
    course: Course
    landmark_id: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    landmarks_n: Array = field(default_factory=lambda: np.zeros((0, 3)))
    walls: tuple[Wall, ...] = ()
    piles_n: Array = field(default_factory=lambda: np.zeros((0, 2)))
    pile_radius_m: float = 0.3
    pile_height_m: float = 3.0
    basin_n: Array = field(default_factory=lambda: np.zeros((0, 2)))
    ground_m: float = 1.5
    flat: bool = False

    @cached_property
    def segments_n(self) -> Array:
        """Straight pieces of all walls, shape (s, 2, 2): piece, end, north and east."""
        pieces = [np.stack([w.corners_n[:-1], w.corners_n[1:]], axis=1) for w in self.walls]
        return np.concatenate([np.zeros((0, 2, 2)), *pieces])

    @property
    def posts_n(self) -> Array:
        """Centres of what is round: piles and landmarks, shape (k + m, 2), m."""
        return np.concatenate([self.piles_n, self.landmarks_n[:, :2]])

    def wall_distances(self, p_n: ArrayLike) -> Array:
        """Distance from points (n, 2) to every wall, shape (n, walls), m."""
        if not self.walls:
            return np.zeros((len(np.asarray(p_n)), 0))
        first = np.cumsum([0] + [len(w.corners_n) - 1 for w in self.walls[:-1]])
        return np.minimum.reduceat(segment_distances(p_n, self.segments_n), first, axis=1)

    def clearance(self, p_n: ArrayLike) -> Array:
        """Distance from points (n, 2) to the nearest wall, pile or landmark, shape (n,), m."""
        points = np.asarray(p_n, dtype=float)
        to_posts = np.linalg.norm(points[:, None] - self.posts_n, axis=2) - self.pile_radius_m
        to_walls = self.wall_distances(points)
        return np.asarray(np.concatenate([to_posts, to_walls], axis=1).min(axis=1))


def segment_distances(p_n: ArrayLike, segments_n: Array) -> Array:
    """Distance from points (n, 2) to segments (s, 2, 2), shape (n, s), m."""
    start = segments_n[:, 0]
    along = segments_n[:, 1] - start
    from_start = np.asarray(p_n, dtype=float)[:, None] - start
    share = np.clip((from_start * along).sum(2) / (along**2).sum(1), 0.0, 1.0)
    return np.asarray(np.linalg.norm(from_start - share[..., None] * along, axis=2))
