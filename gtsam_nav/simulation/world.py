"""What surrounds the vehicle: walls, piles, buoys, and the water between them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from gtsam_nav.frames import Array, Origin
from gtsam_nav.mission import IntArray


@dataclass(frozen=True)
class Wall:
    """A vertical wall along a polyline.

    Attributes
    ----------
    corners_n : ndarray, shape (k, 2)
        North and east of its corners, m.
    reinforcement : float
        How much steel it holds, and which way that turns a compass: -1 to 1.
    """

    corners_n: Array
    reinforcement: float


@dataclass(frozen=True)
class World:
    """A harbour seen from above, in local NED.

    Attributes
    ----------
    walls : tuple of Wall
    piles_n : ndarray, shape (k, 2)
        Centres of round piles, m.
    pile_radius_m : float
    buoy_id : ndarray of int, shape (m,)
    buoys_n : ndarray, shape (m, 3)
        Moored underwater reflectors that a landmark sensor tells apart, m.
    circuit_n : ndarray, shape (w, 2)
        Waypoints of a closed survey circuit, m; the last leads back to the first.
    """

    name: str
    origin: Origin
    walls: tuple[Wall, ...]
    piles_n: Array
    pile_radius_m: float
    buoy_id: IntArray
    buoys_n: Array
    circuit_n: Array

    @cached_property
    def segments_n(self) -> Array:
        """Straight pieces of all walls, shape (s, 2, 2): piece, end, north and east."""
        pieces = [np.stack([w.corners_n[:-1], w.corners_n[1:]], axis=1) for w in self.walls]
        return np.concatenate(pieces)

    def wall_distances(self, p_n: ArrayLike) -> Array:
        """Distance from points (n, 2) to every wall, shape (n, walls), m."""
        first = np.cumsum([0] + [len(w.corners_n) - 1 for w in self.walls[:-1]])
        return np.minimum.reduceat(segment_distances(p_n, self.segments_n), first, axis=1)

    def clearance(self, p_n: ArrayLike) -> Array:
        """Distance from points (n, 2) to the nearest wall, pile or buoy, shape (n,), m."""
        points = np.asarray(p_n, dtype=float)
        posts = np.concatenate([self.piles_n, self.buoys_n[:, :2]])
        to_posts = np.linalg.norm(points[:, None] - posts, axis=2) - self.pile_radius_m
        to_walls = self.wall_distances(points)
        return np.asarray(np.concatenate([to_posts, to_walls], axis=1).min(axis=1))


def segment_distances(p_n: ArrayLike, segments_n: Array) -> Array:
    """Distance from points (n, 2) to segments (s, 2, 2), shape (n, s), m."""
    start = segments_n[:, 0]
    along = segments_n[:, 1] - start
    from_start = np.asarray(p_n, dtype=float)[:, None] - start
    share = np.clip((from_start * along).sum(2) / (along**2).sum(1), 0.0, 1.0)
    return np.asarray(np.linalg.norm(from_start - share[..., None] * along, axis=2))
