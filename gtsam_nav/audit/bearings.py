"""Bearings that count the wrong way, bearings and ranges in another unit: such sightings place each
landmark anew as the vehicle moves and turns.

A landmark stands still. Sightings of one, some seconds apart, are placed by the vehicle's own
motion, with bearings and ranges as stated and as they may be meant.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

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
DEG, FULL_TURN = float(np.degrees(1.0)), 2 * np.pi


@dataclass(frozen=True)
class Reading:
    """How sightings may be meant: what bearings and ranges are multiplied by."""

    check: str
    name: str
    bearing: float = 1.0
    range: float = 1.0

    @property
    def fix(self) -> str:
        """What mends it in the sensor's card."""
        if self.range != 1.0:
            return fixes.scale("range_m", self.range)
        return fixes.scale("bearing_deg", self.bearing)

    def is_possible(self, bearing: Array) -> bool:
        """Whether bearings in that unit reach as far as these do, and no further."""
        reach = float(np.max(np.abs(bearing)))
        if abs(self.bearing) > 1.0:
            return reach * DEG <= FULL_TURN
        return abs(self.bearing) == 1.0 or reach > FULL_TURN

    def applied(self, sensor: Sensor) -> Sensor:
        """The sensor with what it means."""
        series = _seen(sensor)
        assert series.range_m is not None
        assert series.bearing is not None
        meant = replace(
            series, range_m=self.range * series.range_m, bearing=self.bearing * series.bearing
        )
        return replace(sensor, series=meant)


READINGS = (
    Reading("bearing sign", "as stated"),
    Reading("bearing sign", "reversed: bearings count counter-clockwise", bearing=-1.0),
    Reading("bearing unit", "with bearings in radians, not in degrees", bearing=DEG),
    Reading("bearing unit", "with bearings in radians, and counter-clockwise", bearing=-DEG),
    Reading("bearing unit", "with bearings that were turned into degrees twice", bearing=1 / DEG),
    Reading("range unit", "with ranges in feet, not in m", range=0.3048),
    Reading("range unit", "with ranges in cm, not in m", range=1e-2),
    Reading("range unit", "with ranges in mm, not in m", range=1e-3),
)
"""The stated one first."""


def bearing_findings(mission: Mission) -> Iterator[Finding]:
    """Judge sign and units of each sensor that sees ranges, bearings and ids."""
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
    bearing = _seen(sensor).bearing
    assert bearing is not None
    readings = [r for r in READINGS if r.is_possible(bearing)]
    moves_m = np.array([_moves_m(r.applied(sensor), motion, pairs) for r in readings])
    # in the unit that is read: else a unit so small that nothing moves would explain all
    loss = losses(moves_m / np.array([[r.range] for r in readings]))
    chosen = _meant(loss, [r.check for r in readings])
    stated_m, meant_m = np.median(moves_m[[0, chosen]], axis=1)
    read = f"{len(pairs)} pairs of sightings lie {stated_m:.2f} m apart in the median"
    if chosen:
        reading = readings[chosen]
        message = f"{read}, and {meant_m:.2f} m {reading.name}"
        return Finding(reading.check, sensor.name, "warning", message, reading.fix)
    if prefers(loss[1], loss[0]):
        return Finding("bearing sign", sensor.name, "ok", read)
    return Finding("bearing sign", sensor.name, "ok", f"{read}; the sign shows in none")


def _meant(loss: Array, checks: list[str]) -> int:
    """The reading that the data call for; sign and each unit are questions by themselves."""
    found = [0]
    for question in dict.fromkeys(checks):
        asked = [k for k, check in enumerate(checks) if k and check == question]
        winner = min(asked, key=lambda k: float(np.mean(loss[k])))
        if prefers(loss[0], loss[winner], len(asked)):
            found.append(winner)
    return min(found, key=lambda k: float(np.mean(loss[k])))


def _seen(sensor: Sensor) -> LandmarkSeries:
    assert isinstance(sensor.series, LandmarkSeries)
    return sensor.series


def _sees_all(sensor: Sensor) -> bool:
    series = _seen(sensor)
    measured = series.range_m is not None and series.bearing is not None
    return measured and bool(np.any(series.id >= 0))


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
