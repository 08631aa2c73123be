"""Places that ranges to surveyed beacons tell of a vehicle whose motion only an IMU measures.

Inertial readings alone are kilometres off within minutes: from there no graph finds back to the
ranges, and where it does, to the wrong side of the beacons. The ranges themselves, on a path of no
great acceleration, tell a first guess: least squares over all of them, which trust them the more
the nearer the path has come. Nothing tells a path from its image on the other side of a plane of
beacons but that the vehicle is in the water: above beacons on the bottom, below those of a surface.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from gtsam_nav.frames import Array, sag_m
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.preprocess.depth_by_ranges import DEEPER_M, DIVE_M_SQRT_S
from gtsam_nav.preprocess.motion import measures_velocity
from gtsam_nav.sensors.depth import origin_depths
from gtsam_nav.sensors.landmarks import trusted_ids
from gtsam_nav.sensors.noise import LandmarkNoise
from gtsam_nav.sensors.orientation import level_attitudes
from gtsam_nav.sensors.prediction import chi2_limit
from gtsam_nav.sensors.settings import LandmarkSettings
from gtsam_nav.series import GnssSeries, IntArray, LandmarkSeries

FEWEST_BEACONS, LEAST_BREADTH = 3, 0.1
"""Beacons in one line tell no side of it: so broad, as a share of their length, they must lie."""
ACCELERATION_M_S2 = 0.3
"""That lasts a second: how far a path may leave a straight line."""
MEASURED_DEPTH_M, STATED_DEPTH_M_SQRT_S = 0.1, 1e-3
"""Spread of a depth that a gauge measures, and walk of one that is stated to be constant."""
STEPS, STILL_M = 40, 1e-2
"""Of the least squares; after each the ranges are trusted twice as far, from the longest on."""
GATE = chi2_limit(0.999, 1)
LEAST_SHARE, FEWEST_RANGES = 0.5, 12
"""Of the ranges that must fit: a few are joined by some path whatever one of them is off by."""


@dataclass(frozen=True)
class _Ranges:
    """Ranges (n,) to surveyed beacons.

    Attributes
    ----------
    t : ndarray, shape (k,)
        Mission times at which there are any, s.
    at : ndarray of int, shape (n,)
        The time of each.
    beacon_n : ndarray, shape (n, 3)
        Moved by the height of the instrument in the vehicle: the range is the vehicle's own.
    range_m, variance : ndarray, shape (n,)
    """

    t: Array
    at: IntArray
    beacon_n: Array
    range_m: Array
    variance: Array


def ranges_tell_places(mission: Mission, settings: LandmarkSettings) -> bool:
    """Whether an IMU and ranges, without bearings, to enough surveyed beacons tell the way."""
    return _telling_ranges(mission, settings) is not None


def fixes_by_ranges(mission: Mission, settings: LandmarkSettings) -> Sensor | None:
    """Places of the body's origin, as a receiver's fixes; None where the ranges tell none.

    Where nothing measures the depth the vehicle is taken to be above beacons that are deeper than
    the water's surface, and below others.
    """
    ranges = _telling_ranges(mission, settings)
    if ranges is None:
        return None
    p_n, sigma_m = _path(ranges, mission)
    fits = _residuals(ranges, p_n)[0] ** 2 < GATE * ranges.variance
    if np.mean(fits) < LEAST_SHARE or len(fits) < FEWEST_RANGES:
        return None
    sigma = np.full(p_n.shape, sigma_m)
    return Sensor("ranges", "gnss", GnssSeries(t=ranges.t, p_n=p_n, sigma=sigma))


def said_of_side(mission: Mission) -> Iterator[str]:
    """What is said of a depth that such ranges alone tell."""
    if mission.first("depth") is None and mission.initial.p_n is None:
        yield (
            "nothing measures the depth: ranges tell it but for the side of the beacons; the"
            " vehicle is taken to be above those on the bottom, or below those of the surface; a"
            " depth gauge would tell it, or 'initial: position_ned_m'"
        )


def _telling_ranges(mission: Mission, settings: LandmarkSettings) -> _Ranges | None:
    others = mission.first("gnss") is not None or mission.edges is not None
    if others or mission.first("imu") is None or measures_velocity(mission):
        return None
    ranges = _ranges(mission, settings)
    return ranges if ranges is not None and _are_spread(ranges.beacon_n) else None


def _ranges(mission: Mission, settings: LandmarkSettings) -> _Ranges | None:
    known = mission.landmark_map
    if known is None or not settings.use_map:
        return None
    rows = []
    order = np.argsort(known.id)
    for sensor in mission.of_type("landmarks"):
        series, noise = sensor.series, LandmarkNoise.model_validate(sensor.noise)
        assert isinstance(series, LandmarkSeries)
        if series.range_m is None or series.sigma_range is None or series.bearing is not None:
            continue
        ids = trusted_ids(series, settings)
        own = np.flatnonzero(np.isin(ids, known.id) & np.isfinite(series.range_m))
        beacon = order[np.searchsorted(known.id, ids[own], sorter=order)]
        range_m = series.range_m[own]
        arm_m = float(np.hypot(*sensor.xyz_b[:2]))
        variance = series.sigma_range[own] ** 2 + (noise.range_scale_sigma * range_m) ** 2
        variance += known.sigma[beacon] ** 2 + arm_m**2
        beacon_n = known.p_n[beacon] - [0.0, 0.0, sensor.xyz_b[2]]
        rows.append(np.column_stack([series.t[own], beacon_n, range_m, variance]))
    if not rows or not sum(map(len, rows)):
        return None
    every = np.vstack(rows)
    t, at = np.unique(every[:, 0], return_inverse=True)
    return _Ranges(t, at, every[:, 1:4], every[:, 4], every[:, 5])


def _are_spread(beacon_n: Array) -> bool:
    level = np.unique(beacon_n[:, :2], axis=0)
    if len(level) < FEWEST_BEACONS:
        return False
    length, breadth = np.linalg.svd(level - level.mean(axis=0), compute_uv=False)
    return bool(breadth > LEAST_BREADTH * length)


def _path(ranges: _Ranges, mission: Mission) -> tuple[Array, Array]:
    """Places (k, 3) by Gauss-Newton under Cauchy's weights, and the spread (3,) of the first."""
    from scipy.sparse import csc_array, diags_array
    from scipy.sparse.linalg import splu

    k = len(ranges.t)
    begin, prior = _begin(ranges, mission)
    information = _smoothness(ranges.t, mission) + prior
    x, rows = begin.copy(), np.repeat(np.arange(len(ranges.at)), 3)
    columns = 3 * np.repeat(ranges.at, 3) + np.tile(np.arange(3), len(ranges.at))
    doubt = float(ranges.range_m.max()) ** 2
    for _ in range(STEPS):
        residual, towards = _residuals(ranges, x)
        variance = ranges.variance + doubt
        weight = 1.0 / (1.0 + residual**2 / variance / GATE) / variance
        J = csc_array((towards.ravel(), (rows, columns)), shape=(len(rows) // 3, 3 * k))
        weighted = J.T @ diags_array(weight)
        normal = (information + weighted @ J).tocsc()
        off = information @ (x - begin).ravel() + weighted @ residual
        solver = splu(normal)
        step = solver.solve(np.asarray(off)).reshape(k, 3)
        x, doubt = x - step, doubt / 4
        if doubt < ranges.variance.min() and np.abs(step).max() < STILL_M:
            break
    cov = solver.solve(np.eye(3 * k, 3))
    return x, np.sqrt(np.diag(cov[:3]))


def _begin(ranges: _Ranges, mission: Mission) -> tuple[Array, Any]:
    """The path before any range is looked at, and the information (3 k, 3 k) on it."""
    from scipy.sparse import diags_array

    k, information = len(ranges.t), np.zeros((len(ranges.t), 3))
    begin = np.tile(ranges.beacon_n.mean(axis=0), (k, 1))
    spread_m = float(np.sqrt(np.mean(ranges.range_m**2)))
    information[0] = spread_m**-2
    deep_m = begin[0, 2]
    begin[:, 2] = 0.0 if deep_m > DEEPER_M else deep_m + spread_m / 2
    initial, depth = mission.initial, mission.first("depth")
    if initial.p_n is not None:
        begin[:] = initial.p_n
        moved_m = spread_m if ranges.t[0] > mission.span_s[0] + 1.0 else 0.0
        information[0] = 1.0 / (initial.sigma_p**2 + moved_m**2)
    if depth is not None:
        depth_m, _ = origin_depths(depth, ranges.t, level_attitudes(mission, ranges.t))
        begin[:, 2] = depth_m + sag_m(begin, mission.origin)
        information[:, 2] = MEASURED_DEPTH_M**-2
    return begin, diags_array(information.ravel())


def _smoothness(t: Array, mission: Mission) -> Any:
    """Information (3 k, 3 k) of a path of white accelerations, whose depth walks at random."""
    from scipy.sparse import csr_array, diags_array, eye_array, kron

    k = len(t)
    if k < 2:
        return csr_array((3 * k, 3 * k))
    dt = np.diff(t)
    slope: Any = diags_array(1.0 / dt) @ (eye_array(k - 1, k, k=1) - eye_array(k - 1, k))
    bend: Any = (eye_array(k - 2, k - 1, k=1) - eye_array(k - 2, k - 1)) @ slope
    # two slopes differ by what accelerations over both spans make of their means
    of_bend = 3.0 / (ACCELERATION_M_S2**2 * (dt[1:] + dt[:-1]))
    walk = STATED_DEPTH_M_SQRT_S if mission.constraints.constant_depth else DIVE_M_SQRT_S
    of_step = dt / walk**2  # of a slope, whose variance is the walk's over the span
    level: Any = bend.T @ diags_array(of_bend) @ bend
    down: Any = slope.T @ diags_array(of_step) @ slope
    return kron(level, np.diag([1.0, 1.0, 0.0])) + kron(down, np.diag([0.0, 0.0, 1.0]))


def _residuals(ranges: _Ranges, x: Array) -> tuple[Array, Array]:
    """Distances less ranges (n,), and their derivatives (n, 3) in the places."""
    off = x[ranges.at] - ranges.beacon_n
    away = np.maximum(np.linalg.norm(off, axis=1), 1e-9)
    return away - ranges.range_m, off / away[:, None]
