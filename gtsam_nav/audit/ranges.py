"""Ranges without bearings in another unit than m: they change by more than the vehicle moves."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gtsam_nav.audit import fixes
from gtsam_nav.audit.bearings import NEAR_S
from gtsam_nav.audit.courses import Velocity
from gtsam_nav.audit.findings import Finding
from gtsam_nav.audit.significance import FALSE_ALARM
from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.series import LandmarkSeries

UNITS = {"feet": 0.3048, "cm": 1e-2, "mm": 1e-3}
"""In m."""
CLEAR_SIGMAS = 10.0
"""A way that is longer than so many sigmas of the ranges shows in them."""
CLEAR_FACTOR = 1.25
"""So much more than the way a range never changes by, even if the speed is a little low."""


def range_findings(mission: Mission, velocity: Velocity) -> Iterator[Finding]:
    """Judge the unit of each sensor that sees ranges and ids alone.

    Between two sightings of a landmark its range changes by the way made or less: half as much
    where the way leads anywhere, all of it towards the landmark.
    """
    for sensor in mission.of_type("landmarks"):
        series = sensor.series
        assert isinstance(series, LandmarkSeries)
        if series.bearing is None:
            yield from _judged(sensor, _ratios(series, velocity), velocity.name)


def _judged(sensor: Sensor, ratios: Array, other: str) -> Iterator[Finding]:
    from scipy.stats import binom

    n, n_over = len(ratios), int(np.sum(ratios > CLEAR_FACTOR))
    if n and binom.sf(n_over - 1, n, 0.5) < FALSE_ALARM:
        typical = float(np.median(ratios))
        unit = min(UNITS, key=lambda u: abs(np.log(typical * UNITS[u] / 0.5)))
        message = (
            f"between two sightings they change by {typical:.3g} times the way by {other} in the"
            f" median of {n}: they are in {unit}, not in m, unless {other} is too slow"
        )
        fix = fixes.scale("range_m", UNITS[unit])
        yield Finding("range unit", sensor.name, "warning", message, fix)


def _ratios(series: LandmarkSeries, velocity: Velocity) -> Array:
    """What ranges change by, for each m of way, between sightings of one landmark well apart."""
    assert series.range_m is not None
    assert series.sigma_range is not None
    speed = np.linalg.norm(velocity.v_s, axis=1)
    steps = 0.5 * (speed[1:] + speed[:-1]) * np.diff(velocity.t)
    way = np.interp(series.t, velocity.t, np.concatenate([[0.0], np.cumsum(steps)]))
    found = []
    for name in np.unique(series.id[series.id >= 0]):
        own = np.flatnonzero(series.id == name)
        last = own[0]
        for k in own[1:]:
            apart = way[k] - way[last]
            if series.t[k] - series.t[last] > NEAR_S:
                last = k
            elif apart > CLEAR_SIGMAS * series.sigma_range[k]:
                found.append(abs(series.range_m[k] - series.range_m[last]) / apart)
                last = k
    return np.array(found)
