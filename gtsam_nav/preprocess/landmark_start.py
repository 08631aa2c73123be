"""Where a mission begins, from its first sightings of surveyed landmarks.

The sightings of the first seconds, laid out along the dead-reckoned motion, form a constellation;
its place on the map is searched from many starts: each of a few sightings on each landmark that it
may be of, at every heading. The best are refined by least squares on the sightings that fit, so
that a false one among them does no harm. The stretch grows until it tells the place, and one only.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.mission import LandmarkMap, Mission, Sensor
from gtsam_nav.preprocess.alignment import Alignment, align
from gtsam_nav.preprocess.planar_motion import PlanarMotion
from gtsam_nav.preprocess.planar_places import (
    MOST_SIGMA_RAD,
    OTHER_HEADING_RAD,
    are_elsewhere,
    moved,
    rotated,
)
from gtsam_nav.preprocess.planar_smoothing import SightedPoints, smooth
from gtsam_nav.preprocess.range_start import range_start
from gtsam_nav.sensors.landmarks import level_points, trusted_ids
from gtsam_nav.sensors.prediction import chi2_limit
from gtsam_nav.sensors.settings import LandmarkSettings
from gtsam_nav.series import BoolArray, IntArray, LandmarkSeries

FIRST_STRETCH_S = 2.0
"""Length of the first stretch of sightings; each next one is twice as long."""
MOST_SIGHTINGS, MOST_SEEDS, MOST_REFINED = 60, 10, 12
"""Sightings in the search, those of them that starts are made of, and starts that are refined."""
HEADING_STEP_RAD = np.radians(5.0)
LEAST_SIGHTINGS, LEAST_LANDMARKS, LEAST_SHARE = 4, 2, 0.7
"""What must fit: sightings, landmarks, and a share of the sightings (of few, all but one)."""
SMOOTHED_S = 60.0
"""How long after the first sighting they still help to place the start."""
STEPS = 10
"""Of the least squares."""
GATE = chi2_limit(0.999, 2)


@dataclass(frozen=True)
class Sighted:
    """Sightings as level points.

    Attributes
    ----------
    t : ndarray, shape (k,)
    id : ndarray of int, shape (k,)
        -1 where unknown.
    p_b : ndarray, shape (k, 2)
        In body axes, m.
    cov_b : ndarray, shape (k, 2, 2)
    """

    t: Array
    id: IntArray
    p_b: Array
    cov_b: Array

    def thinned(self, stop_s: float) -> Sighted:
        """Up to MOST_SIGHTINGS of those until a time, evenly."""
        n = int(np.searchsorted(self.t, stop_s, side="right"))
        k = np.unique(np.linspace(0, n - 1, MOST_SIGHTINGS).astype(int))
        return Sighted(self.t[k], self.id[k], self.p_b[k], self.cov_b[k])


@dataclass(frozen=True)
class Constellation:
    """Sightings laid out along the motion.

    Attributes
    ----------
    id : ndarray of int, shape (k,)
    p : ndarray, shape (k, 2)
        About the vehicle's place at the first sighting, m.
    cov : ndarray, shape (k, 2, 2)
        Of the sighting and of the motion since the first one, m^2.
    """

    id: IntArray
    p: Array
    cov: Array


@dataclass(frozen=True)
class Fit:
    """A place of the constellation: x (n, e, rotation), its covariance, what fits, and the cost."""

    x: Array
    cov: Array
    fits: BoolArray
    landmark: IntArray
    cost: float


def landmark_start(
    mission: Mission, motion: PlanarMotion, settings: LandmarkSettings
) -> Alignment | None:
    """Pose of the body at the mission's start from surveyed landmarks; None where they do not tell.

    The same sightings tell the estimator again what they told here: it should start with sigmas
    well above these.

    Parameters
    ----------
    mission : Mission
        With a landmark map and sightings.
    motion : PlanarMotion
        Of the same mission.
    settings : LandmarkSettings
        Whether the sightings' ids are believed.
    """
    sensor, landmarks = mission.first("landmarks"), mission.landmark_map
    if sensor is None or landmarks is None:
        return None
    assert isinstance(sensor.series, LandmarkSeries)
    if sensor.series.range_m is None:
        return None
    if sensor.series.bearing is None:
        return range_start(mission, motion, sensor, landmarks, settings)
    sighted = _sighted(sensor, settings, landmarks)
    stretch_s = FIRST_STRETCH_S
    while len(sighted.t):
        stop_s = sighted.t[0] + stretch_s
        points = _constellation(sighted.thinned(stop_s), motion)
        found = _placed(points, landmarks, motion.course_is_heading)
        if found is not None:
            return _alignment(mission, motion, found, sighted, landmarks)
        if stop_s >= sighted.t[-1]:
            return None
        stretch_s *= 2
    return None


def _sighted(sensor: Sensor, settings: LandmarkSettings, landmarks: LandmarkMap) -> Sighted:
    """All sightings that may be of mapped landmarks."""
    series = sensor.series
    assert isinstance(series, LandmarkSeries)
    ids = trusted_ids(series, settings)
    usable = (ids < 0) | np.isin(ids, landmarks.id)
    series = series.select(usable)
    p_b, cov_b = level_points(series, sensor)
    return Sighted(series.t, ids[usable], p_b, cov_b)


def _constellation(seen: Sighted, motion: PlanarMotion) -> Constellation:
    p, course, variance = motion.at(seen.t)
    points = p - p[0] + rotated(seen.p_b, course)
    drift = variance - variance[0]
    walked = np.max(drift[:, :2], axis=1) + drift[:, 2] * np.sum(points**2, axis=1)
    c, s = np.cos(course), np.sin(course)
    R = np.moveaxis(np.array([[c, -s], [s, c]]), 2, 0)
    cov = R @ seen.cov_b @ np.swapaxes(R, 1, 2) + walked[:, None, None] * np.eye(2)
    return Constellation(seen.id, points, cov)


def _placed(points: Constellation, landmarks: LandmarkMap, north_up: bool) -> Fit | None:
    """The place of a constellation; None where it is not certain, or not the only one."""
    # a sighting may be of the landmark with its id, or of any where it has none
    may_be = (points.id[:, None] == landmarks.id) | (points.id[:, None] < 0)
    starts = _starts(points, landmarks.p_n[:, :2], may_be, north_up)
    fits = [_refined(points, landmarks, may_be, x) for x in starts]
    usable = sorted((fit for fit in fits if _is_certain(fit)), key=lambda fit: fit.cost)
    if not usable:
        return None
    best = usable[0]
    elsewhere = are_elsewhere(np.array([fit.x for fit in usable]), best.x)
    rivals = [fit for fit, is_other in zip(usable, elsewhere, strict=True) if is_other]
    return None if rivals and rivals[0].cost - best.cost < GATE else best


def _starts(points: Constellation, landmarks: Array, may_be: BoolArray, north_up: bool) -> Array:
    """The most promising of many places (n, e, rotation), no two alike, shape (k, 3)."""
    seeds = np.unique(np.linspace(0, len(points.id) - 1, MOST_SEEDS).astype(int))
    turns = np.arange(-np.pi, np.pi, HEADING_STEP_RAD)
    if north_up:
        turns = turns[np.abs(turns) <= OTHER_HEADING_RAD]
    c, s = np.cos(turns), np.sin(turns)
    turned = np.einsum("tij,kj->tki", np.moveaxis(np.array([[c, -s], [s, c]]), 2, 0), points.p)
    # half a step of heading is not the sightings' fault
    variance = np.trace(points.cov, axis1=1, axis2=2) / 2
    variance = variance + (HEADING_STEP_RAD / 2) ** 2 * np.sum(points.p**2, axis=1)
    x, cost = [], []
    for seed, landmark in np.argwhere(may_be[seeds]):
        place = landmarks[landmark] - turned[:, seeds[seed]]
        off = (place[:, None] + turned)[:, :, None] - landmarks
        squared = np.where(may_be, np.sum(off**2, axis=3), np.inf).min(axis=2) / variance
        x.append(np.column_stack([place, turns]))
        cost.append(np.sum(np.minimum(squared, GATE), axis=1))
    return _unlike(np.concatenate(x), np.concatenate(cost))


def _unlike(x: Array, cost: Array) -> Array:
    """The cheapest places, without those that lie near a cheaper one."""
    left = np.argsort(cost, kind="stable")
    chosen: list[Array] = []
    while len(left) and len(chosen) < MOST_REFINED:
        best = x[left[0]]
        chosen.append(best)
        left = left[are_elsewhere(x[left], best)]
    return np.array(chosen)


def _refined(points: Constellation, landmarks: LandmarkMap, may_be: BoolArray, x: Array) -> Fit:
    """Gauss-Newton from a start, on the points that fit at each step."""
    position = landmarks.p_n[:, :2]
    cov = np.full((3, 3), np.inf)
    for _ in range(STEPS):
        at = moved(x, points.p)
        off = np.where(may_be[..., None], at[:, None] - position, np.inf)
        landmark = np.argmin(np.sum(off**2, axis=2), axis=1)
        residual = off[np.arange(len(at)), landmark]
        c, s = np.cos(x[2]), np.sin(x[2])
        R = np.array([[c, -s], [s, c]])
        spread = R @ points.cov @ R.T + landmarks.sigma[landmark, None, None] ** 2 * np.eye(2)
        information = np.linalg.inv(spread)
        squared = np.einsum("ki,kij,kj->k", residual, information, residual)
        fits = squared <= GATE
        cost = float(np.sum(np.minimum(squared, GATE)))
        J: Array = np.tile(np.eye(2, 3), (len(at), 1, 1))
        J[:, 0, 2], J[:, 1, 2] = -(at - x[:2])[:, 1], (at - x[:2])[:, 0]
        JtW = np.swapaxes(J, 1, 2) @ information * fits[:, None, None]
        normal = np.sum(JtW @ J, axis=0)
        if np.linalg.cond(normal) > 1e12:
            break
        cov = np.linalg.inv(normal)
        x = x - cov @ np.sum(JtW @ residual[..., None], axis=0)[:, 0]
    return Fit(x, cov, fits, landmark, cost)


def _is_certain(fit: Fit) -> bool:
    n_fit, n = int(np.sum(fit.fits)), len(fit.fits)
    return (
        bool(np.sqrt(fit.cov[2, 2]) <= MOST_SIGMA_RAD)
        and n_fit >= max(LEAST_SIGHTINGS, min(n - 1, int(np.ceil(LEAST_SHARE * n))))
        and len(np.unique(fit.landmark[fit.fits])) >= LEAST_LANDMARKS
    )


def _alignment(
    mission: Mission, motion: PlanarMotion, fit: Fit, sighted: Sighted, landmarks: LandmarkMap
) -> Alignment:
    """The pose at the mission's start: the fit's, carried along the motion and smoothed."""
    stated = align(mission)
    seen = sighted.thinned(max(sighted.t[0], stated.t) + SMOOTHED_S)
    t = np.unique(np.append(seen.t, stated.t))
    p, course, _ = motion.at(t)
    p_first, _, _ = motion.at(sighted.t[:1])
    begin = np.column_stack([moved(fit.x, p - p_first), course + fit.x[2]])
    may_be = (seen.id[:, None] == landmarks.id) | (seen.id[:, None] < 0)

    def known(seems: Array) -> Array:
        off = np.sum((seems[:, None] - landmarks.p_n[:, :2]) ** 2, axis=2)
        return landmarks.p_n[np.argmin(np.where(may_be, off, np.inf), axis=1), :2]

    points = SightedPoints(np.searchsorted(t, seen.t), seen.p_b, seen.cov_b)
    x, cov = smooth(begin, motion.increments(t), points, known, GATE)
    sigma = np.sqrt(np.diag(cov)[:3])
    return replace(
        stated,
        p_n=stated.level_at(x[0, :2], mission.origin),
        sigma_p=np.append(sigma[:2], stated.sigma_p[2]),
        rpy=np.append(stated.rpy[:2], wrap_angle(x[0, 2])),
        sigma_rpy=np.append(stated.sigma_rpy[:2], sigma[2]),
        georeferenced=True,
        heading_known=True,
    )
