"""Bearings of landmarks that count the wrong way: they place each landmark anew as the bow turns.

A landmark stands still. Sightings of one, some seconds apart, are placed by the vehicle's own
motion, with their bearings as stated and reversed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from gtsam_nav.audit import fixes
from gtsam_nav.audit.findings import Finding
from gtsam_nav.audit.significance import losses, prefers
from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.preprocess.planar_motion import PlanarMotion, planar_motion
from gtsam_nav.preprocess.settings import MotionSettings
from gtsam_nav.sensors.landmarks import level_points
from gtsam_nav.series import IntArray, LandmarkSeries

NEAR_S = 30.0
"""Over so long dead reckoning is better than what a wrong sign does."""
FEWEST_PAIRS = 10


def bearing_findings(mission: Mission) -> Iterator[Finding]:
    """Judge the sign of the bearings of each sensor that sees ranges, bearings and ids."""
    sensors = [s for s in mission.of_type("landmarks") if _sees_all(s)]
    try:
        motion = planar_motion(mission, MotionSettings()) if sensors else None
    except DataError:  # nothing measures the turns
        return
    if motion is None:
        return
    for sensor in sensors:
        pairs = _pairs(sensor)
        if len(pairs) >= FEWEST_PAIRS:
            yield _judged(sensor, motion, pairs)


def _judged(sensor: Sensor, motion: PlanarMotion, pairs: IntArray) -> Finding:
    errors = np.array([_moves_m(s, motion, pairs) for s in (sensor, _reversed(sensor))])
    loss = losses(errors)
    stated_m, reversed_m = np.median(errors, axis=1)
    read = f"{len(pairs)} pairs of sightings lie {stated_m:.2f} m apart in the median"
    if prefers(loss[0], loss[1]):
        message = f"{read}, and {reversed_m:.2f} m with reversed bearings: counter-clockwise"
        fix = fixes.scale("bearing_deg", -1)
        return Finding("bearing sign", sensor.name, "warning", message, fix)
    if prefers(loss[1], loss[0]):
        return Finding("bearing sign", sensor.name, "ok", read)
    return Finding("bearing sign", sensor.name, "ok", f"{read}; the sign shows in none")


def _seen(sensor: Sensor) -> LandmarkSeries:
    assert isinstance(sensor.series, LandmarkSeries)
    return sensor.series


def _sees_all(sensor: Sensor) -> bool:
    series = _seen(sensor)
    measured = series.range_m is not None and series.bearing is not None
    return measured and bool(np.any(series.id >= 0))


def _reversed(sensor: Sensor) -> Sensor:
    series = _seen(sensor)
    assert series.bearing is not None
    return replace(sensor, series=replace(series, bearing=-series.bearing))


def _pairs(sensor: Sensor) -> IntArray:
    """Sightings (k, 2) of one landmark as far apart as `NEAR_S` allows, one after the other."""
    series, found = _seen(sensor), []
    for name in np.unique(series.id[series.id >= 0]):
        own = np.flatnonzero(series.id == name)
        t, k = series.t[own], 0
        while k < len(own) - 1:
            last = int(np.searchsorted(t, t[k] + NEAR_S, side="right")) - 1
            if last > k:
                found.append((int(own[k]), int(own[last])))
            k = max(last, k + 1)
    return np.array(found, dtype=np.int64).reshape(-1, 2)


def _moves_m(sensor: Sensor, motion: PlanarMotion, pairs: IntArray) -> Array:
    """How far the second sighting of each pair places the landmark from the first, m."""
    series = _seen(sensor)
    seen_b, _ = level_points(series, sensor)
    p, course, _ = motion.at(series.t)
    c, s = np.cos(course), np.sin(course)
    x, y = seen_b.T
    places = p + np.column_stack([c * x - s * y, s * x + c * y])
    return np.asarray(np.linalg.norm(places[pairs[:, 1]] - places[pairs[:, 0]], axis=1))
