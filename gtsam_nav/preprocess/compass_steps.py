"""Steps of a compass that the gyro does not see: magnetic surroundings that come or go at once.

A slowly varying disturbance is a state of the graph; a step is none of its sort, and would turn the
whole vehicle. The readings after it are put where those before it were: from then on the compass
is off by what it was off by before. How much that is grows uncertain, since nobody knows which side
of the step was right.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.mission import Mission
from gtsam_nav.sensors.noise import HeadingNoise
from gtsam_nav.sensors.silences import longest_step_s, silent_spells
from gtsam_nav.series import HeadingSeries, ImuSeries, IntArray

BESIDE_S = 1.0
"""Readings of so long before and after a step tell its size."""
LEAST_STEP_RAD = np.radians(4.0)
STEP_SIGMAS = 8.0
"""A step is larger than this many standard deviations of the difference of two readings."""
MAX_GAP_S = 1.0
"""Over a longer silence of the compass anything may have happened."""


def without_compass_steps(mission: Mission) -> tuple[Mission, tuple[str, ...]]:
    """The mission with the steps taken off its compass, and a warning for each.

    Unchanged where there is no compass or no gyro to compare it with.
    """
    compass, imu = mission.first("heading"), mission.first("imu")
    if compass is None or imu is None or len(imu.series) < 2:
        return mission, ()
    series = compass.series
    assert isinstance(series, HeadingSeries)
    assert isinstance(imu.series, ImuSeries)
    rate = (imu.series.gyro_i @ imu.R_bs.T)[:, 2]
    mean_rate = 0.5 * (rate[1:] + rate[:-1])
    turned = np.concatenate([[0.0], np.cumsum(mean_rate * np.diff(imu.series.t))])
    unseen = np.unwrap(series.heading) - np.interp(series.t, imu.series.t, turned)
    at = _steps(series, unseen, imu.series.t)
    if not len(at):
        return mission, ()
    offset = np.zeros(len(series))
    warnings = []
    for k in at.tolist():
        size = _size(series.t, unseen, k)
        offset[k:] += size
        warnings.append(
            f"the compass '{compass.name}' steps by {np.degrees(size):.1f} deg at"
            f" {series.t[k]:.1f} s, which the gyro does not see: taken off"
        )
    spread = np.degrees(np.max(np.abs(offset)))
    noise = HeadingNoise.model_validate(compass.noise)
    corrected = replace(
        compass,
        series=replace(series, heading=series.heading - offset),
        noise={**compass.noise, "bias_sigma_deg": float(np.hypot(noise.bias_sigma_deg, spread))},
    )
    return mission.with_sensor(corrected), tuple(warnings)


def _steps(series: HeadingSeries, unseen: Array, t_gyro: Array) -> IntArray:
    """First readings after a step."""
    change = np.abs(wrap_angle(np.diff(unseen)))
    sigma = np.hypot(series.sigma[1:], series.sigma[:-1])
    sudden = (change > np.maximum(LEAST_STEP_RAD, STEP_SIGMAS * sigma)) & (
        np.diff(series.t) < MAX_GAP_S
    )
    candidates = [int(k) for k in np.flatnonzero(sudden) + 1 if _watched(series.t, t_gyro, int(k))]
    # a lone bad reading goes up and down again
    lasting = [k for k in candidates if abs(_size(series.t, unseen, k)) > 0.5 * change[k - 1]]
    return np.array(lasting, dtype=np.int64)


def _watched(t: Array, t_gyro: Array, k: int) -> bool:
    """Whether the gyro speaks all the while that tells of a step before reading k.

    While it is silent the vehicle may have turned, and a turn is no step.
    """
    before, after = _beside(t, k)
    return not len(silent_spells(t_gyro, t[before][0], t[after][-1], longest_step_s(t_gyro)))


def _size(t: Array, unseen: Array, k: int) -> float:
    """Of the step before reading k: medians of what is beside it."""
    before, after = _beside(t, k)
    return float(wrap_angle(np.median(unseen[after]) - np.median(unseen[before])))


def _beside(t: Array, k: int) -> tuple[slice, slice]:
    """Readings before a step and from reading k on."""
    first, stop = np.searchsorted(t, [t[k] - BESIDE_S, t[k] + BESIDE_S])
    return slice(int(first), k), slice(k, int(stop))
