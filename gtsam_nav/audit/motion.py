"""What the velocity sensor tells: bottom lock, the rest at the start, and the way."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gtsam_nav.audit.findings import Finding, Severity
from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.preprocess.rest import initial_rest
from gtsam_nav.series import DvlSeries, OdometrySeries, Series

REST_SPEED_M_S, REST_SIGMA_M_S = 0.03, 0.005
"""What counts as motion, and how well a window's median must tell it."""
SHORTEST_WINDOW_S, LONGEST_WINDOW_S = 1.0, 10.0


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
    reads_water = lock.water_share > 0.8 and lock.bottom_share == 0.0  # a log, not a DVL
    severity: Severity = "ok" if reads_water or lock.bottom_share > 0.8 else "warning"
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
        window_s = _window_s(velocity)
        begins = np.arange(start_s, stop_s, window_s)
        moving = (b for b in begins if _median_speed(velocity, b, window_s) > REST_SPEED_M_S)
        ends.append(next(moving, stop_s))
    if imu is not None:
        rest = initial_rest(imu)
        ends.append(start_s if rest is None else float(rest.spells.t[-1]))
    return min(ends) - start_s if ends else None


def _window_s(velocity: Sensor) -> float:
    """What a window takes for a median as good as `REST_SIGMA_M_S`, by the samples' scatter."""
    t, v = _velocities(velocity.series)
    if len(t) < 3:
        return LONGEST_WINDOW_S
    noise_m_s = 1.4826 * float(np.max(np.median(np.abs(np.diff(v, axis=0)), axis=0))) / np.sqrt(2)
    n_needed = (1.2533 * noise_m_s / REST_SIGMA_M_S) ** 2
    # fewer than three samples may be none, where stamps jitter
    interval_s = float(np.median(np.diff(t)))
    enough_s = float(np.clip(n_needed * interval_s, SHORTEST_WINDOW_S, LONGEST_WINDOW_S))
    return max(enough_s, 3.0 * interval_s)


def _median_speed(velocity: Sensor, begin: float, window_s: float) -> float:
    """Median speed over a window, m/s; infinite where the sensor is silent."""
    _, v = _velocities(velocity.series.crop(begin, begin + window_s))
    return float(np.linalg.norm(np.median(v, axis=0))) if len(v) else np.inf


def _velocities(series: Series) -> tuple[Array, Array]:
    """Times (n,), and velocities over ground (n, 2 or 3)."""
    if isinstance(series, DvlSeries):
        locked = series.valid & series.bottom_lock
        return series.t[locked], series.v_d[locked]
    assert isinstance(series, OdometrySeries)
    return series.t, series.v_b


def turned(v_b: Array, heading: Array) -> Array:
    """Horizontal body vectors (n, 2) along north and east, for level flight."""
    c, s = np.cos(heading), np.sin(heading)
    return np.stack([c * v_b[:, 0] - s * v_b[:, 1], s * v_b[:, 0] + c * v_b[:, 1]], axis=1)
