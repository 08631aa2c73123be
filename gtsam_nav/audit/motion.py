"""What the velocity sensor tells: bottom lock, the rest at the start, and the way."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gtsam_nav.audit.findings import Finding, Severity
from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.preprocess.rest import initial_rest
from gtsam_nav.series import DvlSeries, OdometrySeries

REST_SPEED_M_S = 0.03
REST_WINDOW_S = 10.0


@dataclass(frozen=True)
class DvlLock:
    """Shares of a DVL's samples by lock, and the longest time without bottom lock."""

    name: str
    bottom_share: float
    water_share: float
    longest_outage_s: float


def dvl_lock(dvl: Sensor) -> DvlLock:
    """Bottom and water lock of a DVL."""
    series = dvl.series
    assert isinstance(series, DvlSeries)
    bottom = series.valid & series.bottom_lock
    locked = np.concatenate([series.t[:1], series.t[bottom], series.t[-1:]])
    return DvlLock(
        name=dvl.name,
        bottom_share=float(np.mean(bottom)),
        water_share=float(np.mean(series.valid & ~series.bottom_lock)),
        longest_outage_s=float(np.max(np.diff(locked))),
    )


def lock_findings(lock: DvlLock) -> Iterator[Finding]:
    """Judge the lock."""
    read = (
        f"bottom lock {lock.bottom_share:.1%}, water lock {lock.water_share:.1%}, "
        f"longest time without bottom lock {lock.longest_outage_s:.1f} s"
    )
    severity: Severity = "ok" if lock.bottom_share > 0.8 else "warning"
    yield Finding("bottom lock", lock.name, severity, read)


def velocity_sensor(mission: Mission) -> Sensor | None:
    """The first DVL that ever saw the bottom, else the first odometry."""
    for dvl in mission.of_type("dvl"):
        series = dvl.series
        assert isinstance(series, DvlSeries)
        if np.any(series.valid & series.bottom_lock):
            return dvl
    return mission.first("odometry")


def initial_rest_s(mission: Mission) -> float | None:
    """Seconds from the start of the mission until the vehicle moves, as far as its sensors tell.

    Slow is what they call rest: a steady drift looks the same to an IMU.

    Returns
    -------
    float or None
        None where neither speed nor an IMU tells.
    """
    start_s, stop_s = mission.span_s
    velocity, imu = velocity_sensor(mission), mission.first("imu")
    ends = []
    if velocity is not None:
        begins = np.arange(start_s, stop_s, REST_WINDOW_S)
        moving = [begin for begin in begins if _median_speed(velocity, begin) > REST_SPEED_M_S]
        ends.append(moving[0] if moving else stop_s)
    if imu is not None:
        rest = initial_rest(imu)
        ends.append(start_s if rest is None else float(rest.spells.t[-1]))
    return min(ends) - start_s if ends else None


def _median_speed(velocity: Sensor, begin: float) -> float:
    """Median speed over a window, m/s; infinite where the sensor is silent."""
    series = velocity.series.crop(begin, begin + REST_WINDOW_S)
    if isinstance(series, DvlSeries):
        v = series.v_d[series.valid & series.bottom_lock]
    else:
        assert isinstance(series, OdometrySeries)
        v = series.v_b
    return float(np.linalg.norm(np.median(v, axis=0))) if len(v) else np.inf


def turned(v_b: Array, heading: Array) -> Array:
    """Horizontal body vectors (n, 2) along north and east, for level flight."""
    c, s = np.cos(heading), np.sin(heading)
    return np.stack([c * v_b[:, 0] - s * v_b[:, 1], s * v_b[:, 0] + c * v_b[:, 1]], axis=1)
