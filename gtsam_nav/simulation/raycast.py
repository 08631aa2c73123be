"""First hits of horizontal rays on walls and posts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.simulation.world import World, segment_distances


@dataclass(frozen=True)
class Hits:
    """What m fans of k rays meet first, arrays of shape (m, k).

    Attributes
    ----------
    range_m : ndarray
        Infinite where nothing is met.
    cosine : ndarray
        Of the angle of incidence: 1 head-on, 0 grazing.
    to_edge_m : ndarray
        From the hit to the nearer end of the straight piece of wall; infinite on posts.
    """

    range_m: Array
    cosine: Array
    to_edge_m: Array


def cast(world: World, origin_n: Array, azimuth: Array, max_range_m: float) -> Hits:
    """Cast fans of rays from points on a short track.

    Parameters
    ----------
    world : World
    origin_n : ndarray, shape (m, 2)
        Where each fan starts, m.
    azimuth : ndarray, shape (m, k)
        Directions of its rays, rad clockwise from north.
    max_range_m : float
        Nothing further away is met.
    """
    segments_n, posts_n = _within_reach(world, origin_n, max_range_m)
    direction = np.stack([np.cos(azimuth), np.sin(azimuth)])
    range_m, cosine, to_edge_m = _meet_segments(origin_n, direction, segments_n)
    to_post = _meet_posts(origin_n, direction, posts_n, world.pile_radius_m)
    on_post = to_post < range_m
    range_m = np.where(on_post, to_post, range_m)
    range_m[range_m > max_range_m] = np.inf
    return Hits(
        range_m=range_m,
        cosine=np.where(on_post, 1.0, cosine),
        to_edge_m=np.where(on_post, np.inf, to_edge_m),
    )


def _within_reach(world: World, origin_n: Array, max_range_m: float) -> tuple[Array, Array]:
    """The segments and posts that a ray from any of these points could meet."""
    middle = origin_n.mean(axis=0, keepdims=True)
    reach = max_range_m + np.linalg.norm(origin_n - middle, axis=1).max()
    posts = world.posts_n
    near_segment = segment_distances(middle, world.segments_n)[0] <= reach
    near_post = np.linalg.norm(posts - middle, axis=1) <= reach + world.pile_radius_m
    return world.segments_n[near_segment], posts[near_post]


def _meet_segments(
    origin_n: Array, direction: Array, segments_n: Array
) -> tuple[Array, Array, Array]:
    """Range, cosine of incidence and distance to the piece's end of the first hits."""
    shape = direction.shape[1:]
    best = np.full(shape, np.inf)
    cosine, to_edge_m = np.zeros(shape), np.full(shape, np.inf)
    north, east = direction
    for start, end in segments_n:
        along = end - start
        length = np.hypot(*along)
        to_start = start - origin_n
        # solve origin + r * direction = start + share * along
        across = north * along[1] - east * along[0]
        with np.errstate(divide="ignore", invalid="ignore"):
            r = (to_start[:, 0] * along[1] - to_start[:, 1] * along[0])[:, None] / across
            share = (to_start[:, :1] * east - to_start[:, 1:] * north) / across
        first = (r > 0) & (r < best) & (share >= 0) & (share <= 1)
        best[first] = r[first]
        cosine[first] = np.abs(across[first]) / length
        to_edge_m[first] = length * (0.5 - np.abs(share[first] - 0.5))
    return best, cosine, to_edge_m


def _meet_posts(origin_n: Array, direction: Array, posts_n: Array, radius_m: float) -> Array:
    """Range of the first post on each ray, infinite where there is none."""
    best = np.full(direction.shape[1:], np.inf)
    for post in posts_n:
        north, east = (post - origin_n).T
        ahead = north[:, None] * direction[0] + east[:, None] * direction[1]
        miss = (north**2 + east**2)[:, None] - ahead**2
        hit = (ahead > 0) & (miss < radius_m**2)
        r = ahead[hit] - np.sqrt(radius_m**2 - miss[hit])
        best[hit] = np.minimum(best[hit], r)
    return best
