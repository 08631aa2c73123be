"""Up and down as DVL, depth gauge and accelerometer saw it: signs, and whose clock is late.

Waves show in all three: as velocity, as its integral, as its derivative.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from gtsam_nav.audit import fixes
from gtsam_nav.audit.agreement import Agreement, agreement
from gtsam_nav.audit.blame import Pair, suspects
from gtsam_nav.audit.findings import Finding
from gtsam_nav.audit.lagged_products import Signal, integrated
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.series import DepthSeries, DvlSeries, ImuSeries

ABOVE_M = 0.5
"""So far above the water neither a bad zero nor the air pressure puts a gauge at the surface."""


@dataclass(frozen=True)
class VerticalPair:
    """How one sensor's vertical motion goes with another's, positive down both."""

    y: str
    x: str
    agreement: Agreement

    @property
    def pair(self) -> Pair:
        """Their names."""
        return self.y, self.x


def vertical_pairs(mission: Mission) -> tuple[VerticalPair, ...]:
    """Each two of the first IMU, DVL and depth gauge that have anything in common."""
    sensors = [s for kind in ("imu", "dvl", "depth") if (s := mission.first(kind)) is not None]
    found = []
    for x, y in combinations(sensors, 2):
        seen = _compared(y, x)
        if seen is not None:
            found.append(VerticalPair(y.name, x.name, seen))
    return tuple(found)


def _compared(y: Sensor, x: Sensor) -> Agreement | None:
    """Depths with depths, else velocities with velocities."""
    as_depth = isinstance(y.series, DepthSeries)
    signals = [_depth(s) if as_depth else _velocity(s) for s in (y, x)]
    return None if any(len(s.t) < 2 for s in signals) else agreement(*signals)


def _velocity(sensor: Sensor) -> Signal:
    series = sensor.series
    if isinstance(series, ImuSeries):
        down = series.accel_i @ sensor.R_bs[2]
        return integrated(series.t, down - np.mean(down))
    assert isinstance(series, DvlSeries)
    locked = series.valid & series.bottom_lock
    return Signal(series.t[locked], series.v_d[locked] @ sensor.R_bs[2])


def _depth(sensor: Sensor) -> Signal:
    series = sensor.series
    if isinstance(series, DepthSeries):
        return Signal(series.t, series.depth_m)
    velocity = _velocity(sensor)
    return integrated(velocity.t, velocity.values) if len(velocity.t) > 1 else velocity


def reversed_heave(
    mission: Mission, pairs: tuple[VerticalPair, ...], upside_down: bool
) -> dict[str, str]:
    """DVL and depth gauge that go up where the others go down, and how that was read.

    Parameters
    ----------
    mission : Mission
    pairs : tuple of VerticalPair
    upside_down : bool
        Whether gravity already says that the accelerometer's sign is wrong: then it is no witness.
    """
    imu = mission.first("imu")
    counted = [p for p in pairs if not (upside_down and imu is not None and imu.name in p.pair)]
    wrong = suspects(
        [p.pair for p in counted if p.agreement.gain < 0],
        [p.pair for p in counted if p.agreement.gain > 0],
    )
    found = {}
    for sensor in filter(None, (mission.first("dvl"), mission.first("depth"))):
        if sensor.name in wrong:
            others = [p.x if p.y == sensor.name else p.y for p in counted if sensor.name in p.pair]
            goes = "goes" if len(others) == 1 else "go"
            found[sensor.name] = f"goes up where {' and '.join(others)} {goes} down"
    return found


def vertical_findings(mission: Mission, heave: Mapping[str, str]) -> Iterator[Finding]:
    """Judge the signs of a DVL's z and of a depth.

    Parameters
    ----------
    mission : Mission
    heave : mapping of str to str
        What `reversed_heave` found, but for what is told elsewhere.
    """
    for kind, column, check in (("dvl", "vz", "velocity axes"), ("depth", "depth_m", "depth sign")):
        sensor = mission.first(kind)
        if sensor is None:
            continue
        if sensor.name not in heave:
            yield from _above_the_water(sensor)
            continue
        message = f"{heave[sensor.name]}: {column} reversed"
        yield Finding(check, sensor.name, "warning", message, fixes.scale(column, -1))


def _above_the_water(sensor: Sensor) -> Iterator[Finding]:
    """A gauge whose depths say that it flies."""
    series = sensor.series
    if not isinstance(series, DepthSeries):
        return
    height_m = -float(np.median(series.depth_m))
    if height_m > ABOVE_M:
        message = f"half of the time it is {height_m:.1f} m or more above the water: reversed"
        yield Finding("depth sign", sensor.name, "warning", message, fixes.scale("depth_m", -1))
