"""Counts, rates, spans, gaps and clock trouble of each sensor."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gtsam_nav.audit import fixes
from gtsam_nav.audit.findings import Finding
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.preprocess.stamp_units import UNITS, in_other_unit, smaller_units
from gtsam_nav.series import DepthSeries

GAP_FACTOR, LEAST_GAP_S = 5.0, 1.0
"""A silence of more than this many median intervals is a gap, unless it is shorter than that."""
TIMING_CHECKS = ("samples", "gaps", "dropped", "span")

COME_AND_GO = ("landmarks", "clouds")
"""Types whose sensors may fall silent for good: with nothing in sight."""
DIVED_M = 0.5
"""A receiver that is so deep, for most of the time, is out of the satellites' sight."""
MISSED_S, MISSED_SHARE = 10.0, 0.1
"""A sensor that begins so much after the first, or ends so much before the last, lacks a part."""


@dataclass(frozen=True)
class Gap:
    """A silence of a sensor."""

    start_s: float
    length_s: float


@dataclass(frozen=True)
class Dropped:
    """Samples that the reader did not keep, by reason."""

    reason: str
    n_samples: int


@dataclass(frozen=True)
class SensorTiming:
    """When a sensor spoke.

    ``rate_hz`` is that of the median interval; None where there are fewer than two stamps, as is
    the span of a sensor without samples.
    """

    name: str
    type: str
    simulated: bool
    n_samples: int
    rate_hz: float | None
    start_s: float | None
    stop_s: float | None
    gaps: tuple[Gap, ...]
    dropped: tuple[Dropped, ...]


def sensor_timing(mission: Mission, sensor: Sensor) -> SensorTiming:
    """Count, rate, span, gaps and drops of one sensor."""
    stamps = np.unique(sensor.series.t)
    steps = np.diff(stamps)
    median_s = float(np.median(steps)) if len(steps) else np.inf
    long = np.flatnonzero(steps > max(GAP_FACTOR * median_s, LEAST_GAP_S))
    reasons = Counter(r.reason for r in mission.rejections if r.sensor == sensor.name)
    return SensorTiming(
        name=sensor.name,
        type=sensor.type,
        simulated=sensor.simulated,
        n_samples=len(sensor.series),
        rate_hz=1.0 / median_s if len(steps) else None,
        start_s=float(stamps[0]) if len(stamps) else None,
        stop_s=float(stamps[-1]) if len(stamps) else None,
        gaps=tuple(Gap(float(stamps[k]), float(steps[k])) for k in long),
        dropped=tuple(Dropped(reason, n) for reason, n in sorted(reasons.items())),
    )


def timing_findings(timing: SensorTiming) -> Iterator[Finding]:
    """Warnings about silence and dropped samples."""
    samples, gaps, drops, _ = TIMING_CHECKS
    if not timing.n_samples:
        yield Finding(samples, timing.name, "warning", "no usable sample")
    if timing.gaps and timing.type != "landmarks":  # those come and go
        longest = max(timing.gaps, key=lambda gap: gap.length_s)
        yield Finding(
            gaps,
            timing.name,
            "warning",
            f"silent for more than {GAP_FACTOR:g} median intervals: {len(timing.gaps)} times, "
            f"the longest {longest.length_s:.1f} s at {longest.start_s:.1f} s",
        )
    for dropped in timing.dropped:
        yield Finding(drops, timing.name, "warning", f"{dropped.reason}: {dropped.n_samples}")
    n_dropped = sum(dropped.n_samples for dropped in timing.dropped)
    if n_dropped > timing.n_samples > 0:
        share = f"{n_dropped} of {n_dropped + timing.n_samples} samples"
        reason = max(timing.dropped, key=lambda dropped: dropped.n_samples).reason
        message = f"{share} are of no use, mostly for: {reason}"
        yield Finding("mostly dropped", timing.name, "warning", message)


def span_findings(mission: Mission) -> Iterator[Finding]:
    """Warnings about sensors that tell of a part of the mission only."""
    own = [s for s in mission.sensors.values() if s.type != "reference" and len(s.series)]
    if not own:
        return
    begin = min(float(sensor.series.t[0]) for sensor in own)
    end = max(float(sensor.series.t[-1]) for sensor in own)
    allowed_s = max(MISSED_S, MISSED_SHARE * (end - begin))
    for sensor in own:
        first, last = float(sensor.series.t[0]), float(sensor.series.t[-1])
        parts = []
        if first - begin > allowed_s and not _out_of_sight(mission, sensor, begin, first):
            parts.append(f"begins at {first:.1f} s")
        if end - last > allowed_s and not _out_of_sight(mission, sensor, last, end):
            parts.append(f"ends at {last:.1f} s")
        if parts:
            message = f"{' and '.join(parts)}; the mission lasts from {begin:.1f} to {end:.1f} s"
            yield Finding("span", sensor.name, "warning", message)


def _out_of_sight(mission: Mission, sensor: Sensor, begin: float, end: float) -> bool:
    """Whether what a sensor measures may have been out of its sight."""
    if sensor.type in COME_AND_GO:
        return True
    gauge = mission.first("depth") if sensor.type == "gnss" else None
    if gauge is None:
        return False
    depths = gauge.series.crop(begin, end)
    assert isinstance(depths, DepthSeries)
    return len(depths) > 0 and float(np.median(depths.depth_m)) > DIVED_M


def stamp_findings(mission: Mission) -> Iterator[Finding]:
    """Warnings about stamps in another unit than seconds."""
    for name, unit in smaller_units(mission).items():
        message = in_other_unit(mission.sensors[name], unit)
        fix = fixes.scale("t", UNITS[unit])
        yield Finding("stamp unit", name, "warning", message, fix)
