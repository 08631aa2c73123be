"""From the stamps of files to mission time."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission, Rejection, Sensor
from gtsam_nav.pose_edges import EDGES
from gtsam_nav.preprocess.cleaning import CLOCK_JUMP_S, main_stretch
from gtsam_nav.series import BoolArray, IntArray

log = logging.getLogger(__name__)

EARLIEST_UTC = 3e8
"""No log of sensors is older than 1979."""


def on_mission_time(mission: Mission, offsets_s: Mapping[str, float]) -> Mission:
    """Move a mission whose times are its files' stamps to mission time.

    Each sensor's clock offset is added. Samples hours away from what most of the mission forms are
    dropped, so that a clock that jumped never defines time zero; zero is then the earliest sample
    of any sensor, or pose of an edge.

    Parameters
    ----------
    mission : Mission
        ``start_utc`` is the POSIX time of stamp zero, or None.
    offsets_s : mapping of str to float
        ``time_offset_s`` of every sensor that the mission names, those left out included, and that
        of ``edges``, zero where it is not there.

    Raises
    ------
    DataError
        Where no sensor that an estimator could use holds a sample, and there is no edge.
    """
    mission = _one_stretch(_shifted(mission, offsets_s))
    if mission.edges is None and all(s.type == "reference" for s in mission.sensors.values()):
        raise DataError(f"mission '{mission.name}' has no usable sensor. {_why_not(mission)}")
    first = [float(s.series.t[0]) for s in mission.sensors.values()]
    zero = min(first if mission.edges is None else [*first, mission.edges.span_s[0]])
    mission = _shifted(mission, dict.fromkeys([*offsets_s, EDGES], -zero))
    warnings = (
        *mission.warnings,
        *_warnings_of(mission.sensors.values()),
        *_doubled_epoch(mission.start_utc, zero),
    )
    for warning in warnings:
        log.warning("%s: %s", mission.name, warning)
    start_utc = None if mission.start_utc is None else mission.start_utc + zero
    return replace(mission, start_utc=start_utc, warnings=warnings)


def _shifted(mission: Mission, offsets_s: Mapping[str, float]) -> Mission:
    """A copy whose samples, edges and rejections are moved in time, sensor by sensor."""
    sensors: dict[str, Sensor] = {}
    rejections = [replace(r, t=r.t + offsets_s[r.sensor]) for r in mission.rejections]
    for name, sensor in mission.sensors.items():
        series = sensor.series
        t = series.t + offsets_s[name]
        # stamps that were apart by less than the sum can resolve fall together
        apart = np.append(True, np.diff(t) > 0) | series.REPEATED_STAMPS
        if not np.all(apart):
            rejections += _rejections(sensor, t, ~apart, "duplicate stamp")
            series, t = series.select(apart), t[apart]
        sensors[name] = replace(sensor, series=replace(series, t=t))
    edges = mission.edges and mission.edges.shift(offsets_s.get(EDGES, 0.0))
    relations = mission.relations and mission.relations.shift(offsets_s[mission.relations.sensor])
    return replace(
        mission,
        sensors=sensors,
        edges=edges,
        relations=relations,
        rejections=tuple(rejections),
    )


def _rejections(sensor: Sensor, t: Array, dropped: BoolArray, reason: str) -> list[Rejection]:
    rows = sensor.series.row
    return [
        Rejection(t=float(t[k]), sensor=sensor.name, index=int(rows[k]), reason=reason)
        for k in np.flatnonzero(dropped)
    ]


def _one_stretch(mission: Mission) -> Mission:
    estimating = [s for s in mission.sensors.values() if s.type != "reference"]
    if not estimating:
        return mission
    start, stop = main_stretch(s.series.t for s in estimating)
    kept: dict[str, Sensor] = {}
    rejections = list(mission.rejections)
    warnings = list(mission.warnings)
    for sensor in mission.sensors.values():
        t = sensor.series.t
        # a reference may begin before and end after what it is to judge
        inside = (t >= start - CLOCK_JUMP_S) & (t <= stop + CLOCK_JUMP_S)
        if np.all(inside):
            kept[sensor.name] = sensor
            continue
        if np.any(inside):
            kept[sensor.name] = replace(sensor, series=sensor.series.select(inside))
        else:
            warnings.append(
                f"sensor '{sensor.name}' is left out: its samples, {t[0]:.1f} to {t[-1]:.1f} s, "
                f"never overlap in time with the others, {start:.1f} to {stop:.1f} s; "
                "check its time_offset_s and the unit of its stamps"
            )
        reason = "clock jump" if np.any(inside) else "no overlap in time"
        rejections += _rejections(sensor, t, ~inside, reason)
    edges = mission.edges and mission.edges.crop(start - CLOCK_JUMP_S, stop + CLOCK_JUMP_S)
    left_out = len(mission.edges or ()) - len(edges or ())
    if left_out:
        warnings.append(f"{left_out} edges are left out: no sensor was near in time")
    return replace(
        mission,
        sensors=kept,
        edges=edges,
        rejections=tuple(rejections),
        warnings=tuple(warnings),
    )


def _warnings_of(sensors: Iterable[Sensor]) -> list[str]:
    found = []
    listed = list(sensors)
    for sensor in listed:
        t = sensor.series.t
        others = [s.series.t for s in listed if s.type != "reference" and s.name != sensor.name]
        if others and all(t[-1] < o[0] or t[0] > o[-1] for o in others):
            found.append(
                f"sensor '{sensor.name}' never overlaps in time with another; "
                "check its time_offset_s and the unit of its stamps"
            )
        if np.any(np.diff(sensor.series.row) < 0):
            late = int(np.sum(sensor.series.row < np.maximum.accumulate(sensor.series.row)))
            found.append(f"sensor '{sensor.name}': {late} samples were out of order and are sorted")
        if sensor.simulated:
            kind = "sonar" if sensor.type in ("beams", "scans") else sensor.type
            found.append(f"simulated {kind}: the samples of sensor '{sensor.name}' are synthetic")
    return found


def _doubled_epoch(start_utc: float | None, zero: float) -> list[str]:
    """Whether stamps that are POSIX seconds themselves are counted from a start in our days."""
    if start_utc is None or min(start_utc, zero) < EARLIEST_UTC:
        return []
    return [
        f"start_utc, {start_utc:.0f}, is the UTC of stamp zero, but stamps begin at {zero:.0f} s:"
        " where they are POSIX seconds themselves, start_utc is 0"
    ]


def _why_not(mission: Mission) -> str:
    dropped = [f"{sensor}: {n} x {reason}" for (sensor, reason), n in mission.dropped.items()]
    return " ".join([*mission.warnings, "Dropped:", "; ".join(dropped) or "nothing"])


def nearest_of(stamps: Array, t: Array) -> IntArray:
    """Index of the rising stamp nearest to each time; of two as near, the earlier."""
    return np.asarray(np.searchsorted(0.5 * (stamps[1:] + stamps[:-1]), t))
