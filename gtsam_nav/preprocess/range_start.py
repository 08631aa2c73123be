"""Where a mission begins, from ranges alone to surveyed beacons (long baseline).

The first ranges, measured along the dead-reckoned motion, fit few places of that motion on the map.
They are found by least squares from starts all along the circle that one range leaves, at every
heading, and at an unknown depth. The stretch grows until one place is left, and that is certain: a
straight path has two, mirrored at the line of two beacons, and a single beacon tells a place beside
a compass only.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gtsam_nav.frames import Array, Origin, sag_m, wrap_angle
from gtsam_nav.mission import LandmarkMap, Mission, Sensor
from gtsam_nav.preprocess.alignment import Alignment, align
from gtsam_nav.preprocess.depth_by_ranges import depth_spread_m
from gtsam_nav.preprocess.planar_motion import PlanarMotion
from gtsam_nav.preprocess.planar_places import MOST_SIGMA_RAD, are_elsewhere, moved, rotated
from gtsam_nav.sensors.depth import origin_depths
from gtsam_nav.sensors.landmarks import trusted_ids
from gtsam_nav.sensors.noise import LandmarkNoise
from gtsam_nav.sensors.orientation import level_attitudes
from gtsam_nav.sensors.prediction import chi2_limit
from gtsam_nav.sensors.settings import LandmarkSettings
from gtsam_nav.series import BoolArray, IntArray, LandmarkSeries

FIRST_STRETCH_S = 10.0
"""Length of the first stretch of ranges; each next one is twice as long."""
MOST_RANGES, LEAST_RANGES, LEAST_SHARE = 60, 6, 0.7
"""In the search (more are thinned evenly), and how many, or what share, must fit."""
AROUND, HEADINGS, DEPTHS = 24, 24, 3
"""Starts on a circle, turns of the motion at each, and depths where nothing measures them."""
SAME_DEPTH_M = 1e-2
"""Spread of a depth that is measured, or that the mission says."""
STEPS = 30
"""Of the least squares."""
MOST_SIGMA_SHARE = 0.1
"""How uncertain a place may be, as a share of its distance from the beacons."""
GATE = chi2_limit(0.999, 1)
RIVAL = chi2_limit(0.999, 2)
"""A place whose cost is this much higher than the best one's is no rival."""


@dataclass(frozen=True)
class Ranges:
    """Ranges to beacons along the motion.

    Attributes
    ----------
    p : ndarray, shape (k, 2)
        The instrument about the vehicle's place at the first range, in the motion's axes, m.
    beacon : ndarray, shape (k, 2)
        North and east, m.
    height : ndarray, shape (k,)
        Of the instrument above the beacon at the depth that is expected of it, m.
    slant : ndarray, shape (k,)
        m.
    variance : ndarray, shape (k,)
        Of the range, by all that it and the motion since the first are wrong by, m^2.
    """

    p: Array
    beacon: Array
    height: Array
    slant: Array
    variance: Array

    def level(self, deeper_m: Array) -> Array:
        """Distances in the plane, m, of vehicles (s,) so much deeper than expected; (s, k)."""
        height = self.height - np.reshape(deeper_m, (-1, 1))
        return np.sqrt(np.maximum(self.slant**2 - height**2, 0.0))


@dataclass(frozen=True)
class Known:
    """Standard deviations of what is known beside the ranges: the turn (rad, infinite without a
    compass), and how much deeper than expected the vehicle is (m)."""

    turn: float
    deeper: float

    @property
    def information(self) -> Array:
        """Of a place, shape (4,)."""
        return np.array([0.0, 0.0, self.turn**-2, self.deeper**-2])


@dataclass(frozen=True)
class Places:
    """Where the motion may lie: s places (n, e, turn, how much deeper) with covariances, costs and
    what fits."""

    x: Array
    cov: Array
    cost: Array
    fits: BoolArray


def range_start(
    mission: Mission,
    motion: PlanarMotion,
    sensor: Sensor,
    landmarks: LandmarkMap,
    settings: LandmarkSettings,
) -> Alignment | None:
    """Pose of the body at the mission's start; None where the ranges do not tell it.

    Parameters
    ----------
    mission : Mission
    motion : PlanarMotion
        Of the same mission.
    sensor : Sensor
        Measures ranges without bearings.
    landmarks : LandmarkMap
    settings : LandmarkSettings
        Whether the ranges' ids are believed; without ids they tell nothing here.
    """
    series = sensor.series
    assert isinstance(series, LandmarkSeries)
    ids = trusted_ids(series, settings)
    usable = np.flatnonzero(np.isin(ids, landmarks.id))
    stated, t = align(mission), series.t[usable]
    landmarks = _below_level(landmarks, mission.origin)
    spread_m = depth_spread_m(mission, settings.use_map)
    known = Known(
        float(stated.sigma_rpy[2]) if motion.course_is_heading else np.inf, spread_m or SAME_DEPTH_M
    )
    stretch_s = FIRST_STRETCH_S
    while len(t):
        n = int(np.searchsorted(t, t[0] + stretch_s, side="right"))
        own = usable[np.unique(np.linspace(0, n - 1, MOST_RANGES).astype(int))]
        depth_m = _depths(mission, series.t[own], stated)
        ranges = _ranges(motion, sensor, landmarks, own, ids, depth_m)
        found = _placed(ranges, known)
        if found is not None:
            return _alignment(
                stated, motion, float(t[0]), *found, mission.origin, unknown_depth=spread_m > 0
            )
        if n == len(t):
            return None
        stretch_s *= 2
    return None


def _below_level(landmarks: LandmarkMap, origin: Origin | None) -> LandmarkMap:
    """The map with depths below the level surface, as a gauge tells the vehicle's."""
    down = sag_m(landmarks.p_n, origin)[:, None] * [0.0, 0.0, 1.0]
    return replace(landmarks, p_n=landmarks.p_n - down)


def _ranges(
    motion: PlanarMotion,
    sensor: Sensor,
    landmarks: LandmarkMap,
    own: IntArray,
    ids: IntArray,
    depth_m: Array,
) -> Ranges:
    """Those samples of a sensor that are given, and how deep the vehicle then is."""
    series, noise = sensor.series, LandmarkNoise.model_validate(sensor.noise)
    assert isinstance(series, LandmarkSeries)
    assert series.range_m is not None
    assert series.sigma_range is not None
    order = np.argsort(landmarks.id)
    beacon = order[np.searchsorted(landmarks.id, ids[own], sorter=order)]
    p, course, variance = motion.at(series.t[own])
    p = p - p[0]
    walked = variance - variance[0]
    way = np.sum(p**2, axis=1)
    # a turn that grows evenly moves the end of a straight way by a third of its variance
    strayed = np.max(walked[:, :2], axis=1) + walked[:, 2] * way / 3 + motion.scale_sigma**2 * way
    slant = series.range_m[own]
    of_slant = series.sigma_range[own] ** 2 + (noise.range_scale_sigma * slant) ** 2
    arm = rotated(np.broadcast_to(sensor.xyz_b[:2], p.shape), course)
    return Ranges(
        p + arm,
        landmarks.p_n[beacon, :2],
        landmarks.p_n[beacon, 2] - depth_m - sensor.xyz_b[2],
        slant,
        of_slant + landmarks.sigma[beacon] ** 2 + strayed,
    )


def _depths(mission: Mission, t: Array, stated: Alignment) -> Array:
    """Of the vehicle below the level surface, m; where nothing measures it, as at the start."""
    gauge = mission.first("depth")
    if gauge is None:
        return np.full(len(t), stated.p_n[2] - sag_m(stated.p_n, mission.origin))
    depth_m, _ = origin_depths(gauge, t, level_attitudes(mission, t))
    return depth_m


def _placed(ranges: Ranges, known: Known) -> tuple[Array, Array] | None:
    """The place and its covariance; None where it is not certain, or not the only one."""
    if len(ranges.p) < LEAST_RANGES:
        return None
    found = _refined(ranges, _starts(ranges, known), known)
    best = int(np.argmin(found.cost))
    x, cov = found.x[best], found.cov[best]
    if np.mean(found.fits[best]) < LEAST_SHARE or not _is_certain(ranges, x, cov):
        return None
    rivals = are_elsewhere(found.x, x) & (found.cost - found.cost[best] < RIVAL)
    return None if np.any(rivals) else (x, cov)


def _is_certain(ranges: Ranges, x: Array, cov: Array) -> bool:
    sigma_m = float(np.sqrt(np.linalg.eigvalsh(cov[:2, :2])[-1]))
    near_m = float(np.median(ranges.level(x[3])))
    return bool(np.sqrt(cov[2, 2]) <= MOST_SIGMA_RAD and sigma_m <= MOST_SIGMA_SHARE * near_m)


def _starts(ranges: Ranges, known: Known) -> Array:
    """Places (s, 4) all along the circle of the middle range, at every heading and depth."""
    k = len(ranges.p) // 2
    north_up, knows_depth = np.isfinite(known.turn), known.deeper <= SAME_DEPTH_M
    turns = np.zeros(1) if north_up else np.arange(HEADINGS) * 2 * np.pi / HEADINGS
    depths = np.zeros(1) if knows_depth else np.linspace(0.0, known.deeper, DEPTHS)
    around = np.arange(AROUND) * 2 * np.pi / AROUND
    turn, angle, deeper = (grid.ravel() for grid in np.meshgrid(turns, around, depths))
    radius = ranges.level(deeper)[:, k, None]
    on_circle = np.column_stack([np.cos(angle), np.sin(angle)]) * radius
    here = rotated(np.broadcast_to(ranges.p[k], on_circle.shape), turn)
    return np.column_stack([ranges.beacon[k] + on_circle - here, turn, deeper])


def _refined(ranges: Ranges, x: Array, known: Known) -> Places:
    """Gauss-Newton under Cauchy's weights from all starts (s, 4) at once."""
    prior = known.information
    for _ in range(STEPS):
        residual, J = _residuals(ranges, x)
        squared = residual**2 / ranges.variance
        weight = 1.0 / (1.0 + squared / GATE) / ranges.variance
        normal = np.einsum("sk,ski,skj->sij", weight, J, J)
        # no step along what the ranges do not tell
        normal += 1e-9 * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(4)
        normal += np.diag(prior)
        gradient = np.einsum("sk,ski,sk->si", weight, J, residual) + prior * x
        x = x - np.linalg.solve(normal, gradient[..., None])[..., 0]
        x[:, 2] = wrap_angle(x[:, 2])
    cost = np.sum(np.minimum(squared, GATE), axis=1) + x**2 @ prior
    return Places(x, np.linalg.inv(normal), cost, squared <= GATE)


def _residuals(ranges: Ranges, x: Array) -> tuple[Array, Array]:
    """Of s places, shapes (s, k) and (s, k, 4)."""
    c, s = np.cos(x[:, 2:3]), np.sin(x[:, 2:3])
    north = c * ranges.p[:, 0] - s * ranges.p[:, 1]
    east = s * ranges.p[:, 0] + c * ranges.p[:, 1]
    off = np.stack([x[:, :1] + north, x[:, 1:2] + east], axis=2) - ranges.beacon
    height = ranges.height - x[:, 3:]
    slant = np.sqrt(np.sum(off**2, axis=2) + height**2)
    away = np.maximum(slant, 1e-9)
    towards = off / away[..., None]
    by_turn = towards[..., 1] * north - towards[..., 0] * east
    by_others = np.stack([by_turn, -height / away], axis=2)
    return slant - ranges.slant, np.concatenate([towards, by_others], axis=2)


def _alignment(
    stated: Alignment,
    motion: PlanarMotion,
    first_s: float,
    x: Array,
    cov: Array,
    origin: Origin | None,
    *,
    unknown_depth: bool,
) -> Alignment:
    """The pose at the mission's start: the place, carried back along the motion."""
    p, course, variance = motion.at(np.array([stated.t, first_s]))
    place = moved(x, p[:1] - p[1])[0]
    strayed = np.abs(variance[1] - variance[0])
    sigma_depth = np.sqrt(cov[3, 3]) if unknown_depth else stated.sigma_p[2]
    deeper_m = x[3] if unknown_depth else 0.0
    return replace(
        stated,
        p_n=stated.level_at(place, origin) + np.array([0.0, 0.0, deeper_m]),
        sigma_p=np.append(np.sqrt(np.diag(cov)[:2] + strayed[:2]), sigma_depth),
        rpy=np.append(stated.rpy[:2], wrap_angle(course[0] + x[2])),
        sigma_rpy=np.append(stated.sigma_rpy[:2], np.sqrt(cov[2, 2] + strayed[2])),
        georeferenced=True,
        heading_known=True,
    )
