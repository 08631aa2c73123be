"""Sightings that follow each other and are surely of one landmark: no map is needed to see that."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.preprocess.planar_motion import PlanarMotion
from gtsam_nav.preprocess.planar_smoothing import SightedPoints
from gtsam_nav.sensors.prediction import chi2_limit
from gtsam_nav.series import IntArray

LINK_S = 3.0
"""A landmark that was not seen for longer begins a new tracklet."""
GATE = chi2_limit(0.999, 2)
MEDIAN = chi2_limit(0.5, 2)


@dataclass(eq=False)
class _Open:
    """A tracklet's latest sighting: its time, point and covariance by dead reckoning."""

    number: int
    t: float
    p: Array
    cov: Array
    variance: Array
    reach2: float


SHARED = 10.0
"""Between the scatter of successive sightings and that of sightings from elsewhere, in variance."""


def noise_found(t: Array, seen: SightedPoints, motion: PlanarMotion) -> float:
    """By how much the variance of the sightings is smaller than stated, at most one.

    Told by the scatter of successive sightings of a landmark, which may share errors.
    """
    number = tracklets(t, seen, motion)
    order = np.argsort(number, kind="stable")
    a, b = order[:-1], order[1:]
    follows = number[a] == number[b]
    a, b = a[follows], b[follows]
    if not len(a):
        return 1.0
    p, course, _ = motion.at(t[seen.pose])
    R = _rotations(course)
    points = p + np.einsum("kij,kj->ki", R, seen.p_b)
    cov = R @ seen.cov_b @ np.swapaxes(R, 1, 2)
    off = points[b] - points[a]
    squared = np.einsum("ki,kij,kj->k", off, np.linalg.inv(cov[a] + cov[b]), off)
    return min(1.0, SHARED * float(np.median(squared)) / MEDIAN)


def _rotations(angle: Array) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.moveaxis(np.array([[c, -s], [s, c]]), 2, 0)


def tracklets(t: Array, seen: SightedPoints, motion: PlanarMotion) -> IntArray:
    """Number of the tracklet that each sighting belongs to, shape (k,), from zero without gaps.

    Parameters
    ----------
    t : ndarray, shape (m,)
        Times of the poses.
    seen : SightedPoints
        In the order of their poses.
    motion : PlanarMotion
        Whose dead reckoning carries a point from one sighting to the next.
    """
    p, course, variance = motion.at(t)
    R = _rotations(course[seen.pose])
    arms = np.einsum("kij,kj->ki", R, seen.p_b)
    covs = R @ seen.cov_b @ np.swapaxes(R, 1, 2)
    number, count = np.empty(len(seen.pose), dtype=np.int64), 0
    still_open: list[_Open] = []
    moments, first = np.unique(seen.pose, return_index=True)
    for pose, a, b in zip(moments, first, np.append(first[1:], len(seen.pose)), strict=True):
        still_open = [o for o in still_open if t[pose] - o.t <= LINK_S]
        fresh = [
            _Open(-1, float(t[pose]), p[pose] + arms[k], covs[k], variance[pose], arms[k] @ arms[k])
            for k in range(a, b)
        ]
        links = _links(fresh, still_open)
        for new, old in zip(fresh, links, strict=True):
            new.number = count if old is None else old.number
            count += old is None
        still_open = fresh + [old for old in still_open if old not in links]
        number[a:b] = [new.number for new in fresh]
    return number


def _links(fresh: list[_Open], still_open: list[_Open]) -> list[_Open | None]:
    """The open tracklet that each sighting of a moment continues: the nearest, each one once."""
    squared = np.array([[_squared(new, old) for old in still_open] for new in fresh])
    squared = squared.reshape(len(fresh), len(still_open))
    linked: list[_Open | None] = [None] * len(fresh)
    for pair in np.argsort(squared, axis=None, kind="stable").tolist():
        i, j = divmod(pair, len(still_open))
        if squared[i, j] > GATE:
            break
        if linked[i] is None and still_open[j] not in linked:
            linked[i] = still_open[j]
    return linked


def _squared(new: _Open, old: _Open) -> float:
    forward, starboard, turned = new.variance - old.variance
    moved = max(forward, starboard) + turned * max(new.reach2, old.reach2)
    off = new.p - old.p
    return float(off @ np.linalg.solve(new.cov + old.cov + moved * np.eye(2), off))
