"""Compiled: first hits of rays in space on upright walls, posts and level ground."""

from __future__ import annotations

import math

import numba
import numpy as np

from gtsam_nav.frames import Array


@numba.njit(cache=True, error_model="numpy")
def first_hits(
    origin_n: Array,
    ray_n: Array,
    segments_n: Array,
    heights_m: Array,
    posts_n: Array,
    post_radius_m: float,
    post_height_m: float,
    basin_n: Array,
    ground_m: float,
) -> Array:
    """Range of the first hit of each ray, infinite where there is none; water gives no echo.

    Parameters
    ----------
    origin_n, ray_n : ndarray, shape (k, 3)
        Start and direction (unit length) of each ray, NED with the water at zero depth, m.
    segments_n, heights_m : ndarray, shapes (s, 2, 2) and (s,)
        Straight pieces of walls, and how far these stand out of the water.
    posts_n : ndarray, shape (p, 2)
    basin_n : ndarray, shape (c, 2)
        Beyond this outline there is ground at ``ground_m`` above the water.
    """
    ranges = np.full(len(ray_n), np.inf)
    for i in range(len(ray_n)):
        x, y, d = origin_n[i]
        u, v, w = ray_n[i]
        best = np.inf
        for s in range(len(segments_n)):
            ax, ay = segments_n[s, 0]
            lx, ly = segments_n[s, 1, 0] - ax, segments_n[s, 1, 1] - ay
            across = u * ly - v * lx
            r = ((ax - x) * ly - (ay - y) * lx) / across
            if not 0.0 < r < best:
                continue
            share = ((ax - x) * v - (ay - y) * u) / across
            if 0.0 <= share <= 1.0 and -heights_m[s] <= d + r * w <= 0.0:
                best = r
        level = u * u + v * v
        for p in range(len(posts_n)):
            north, east = posts_n[p, 0] - x, posts_n[p, 1] - y
            ahead = north * u + east * v
            inside = ahead * ahead - level * (north * north + east * east - post_radius_m**2)
            if ahead > 0.0 and inside > 0.0:
                r = (ahead - math.sqrt(inside)) / level
                if 0.0 < r < best and -post_height_m <= d + r * w <= 0.0:
                    best = r
        r = (-ground_m - d) / w
        if 0.0 < r < best and len(basin_n) and not _inside(x + r * u, y + r * v, basin_n):
            best = r
        ranges[i] = best
    return ranges


@numba.njit(cache=True, error_model="numpy")
def _inside(x: float, y: float, outline: Array) -> bool:
    """Whether a point lies in a polygon: a ray from it crosses the outline an odd number times."""
    odd = False
    for k in range(len(outline)):
        ax, ay = outline[k]
        bx, by = outline[k - 1]
        if (ay > y) != (by > y) and x < ax + (y - ay) / (by - ay) * (bx - ax):
            odd = not odd
    return odd
