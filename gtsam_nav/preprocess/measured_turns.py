"""How a vehicle turns, by whatever measures it: gyro and compass, either, odometry, or nothing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.preprocess.alignment import Alignment
from gtsam_nav.preprocess.compass_turns import (
    disturbance_walk_rad2_s,
    smoothed_heading,
    turned_by_compass,
)
from gtsam_nav.preprocess.settings import MotionSettings
from gtsam_nav.preprocess.turn_sources import TurnSource, by_odometry, by_rate, spliced
from gtsam_nav.preprocess.turning import unmeasured_yaw_variance_rad2_s
from gtsam_nav.sensors.noise import ImuNoise
from gtsam_nav.sensors.odometry import curvature_sigma
from gtsam_nav.sensors.orientation import headings_true
from gtsam_nav.sensors.rates import mean_gyro_bias_b
from gtsam_nav.sensors.silences import longest_step_s
from gtsam_nav.series import HeadingSeries, ImuSeries, OdometrySeries

MAX_RATE_GAP_S = 0.5
"""A gyro's rate is not carried over a longer silence if a compass or odometry tells of it; a slow
gyro is silent when several of its steps are missing."""


@dataclass(frozen=True)
class Turns:
    """Unwrapped yaw on the grid, growth of its variance, and the others as in `VehicleMotion`."""

    yaw: Array
    variance_rad2_s: float
    gyro_bias_b: Array
    compass_sigma: float | None = None


def measured_turns(
    mission: Mission,
    t: Array,
    start: Alignment,
    settings: MotionSettings,
    fast_imu: Sensor | None = None,
) -> Turns:
    """By the gyro and the compass, by either, by odometry, or none at all.

    Parameters
    ----------
    t : ndarray, shape (n,)
        The grid, s.
    fast_imu : Sensor, optional
        As for `vehicle_motion`. A slower gyro misses turns: there the compass is believed, whatever
        disturbs it.
    """
    headings = headings_true(mission)
    imu = mission.first("imu")
    bias_b = np.zeros(3)
    if headings is not None and turned_by_compass(mission):
        compass, variance, sigma = _by_compass(mission, headings, settings)
        yaw = _closed(spliced(compass, *by_odometry(mission)), compass, t)
        return Turns(yaw, variance, bias_b, sigma)
    turned, rate_variance = _turned(mission, t, settings)
    if headings is None or len(headings) < 2 or imu is None:
        return Turns(start.rpy[2] + turned, rate_variance, bias_b)
    assert isinstance(imu.series, ImuSeries)
    noise = ImuNoise.model_validate(imu.noise)
    misses_none = fast_imu is not None and fast_imu.name == imu.name
    walk = disturbance_walk_rad2_s(mission) if misses_none else 0.0
    offset, trend = heading_less_turn(headings, np.interp(headings.t, t, turned), noise, walk)
    bias_b[:2] = mean_gyro_bias_b(mission)[:2]
    bias_b[2] = -float(np.mean(trend))
    yaw = turned + np.interp(t, headings.t, offset)
    return Turns(yaw, noise.gyro_noise_density_rad_s_sqrt_hz**2, bias_b)


def _by_compass(
    mission: Mission, headings: HeadingSeries, settings: MotionSettings
) -> tuple[TurnSource, float, float]:
    """The smoothed heading, the growth of its variance, and its sigma."""
    walk = disturbance_walk_rad2_s(mission)
    level, sigma = smoothed_heading(headings, walk, settings.sigma_yaw_accel_rad_s2)
    source = TurnSource(headings.t, level, longest_step_s(headings.t))
    # over the memory of the smoother, about a second, its error is one draw
    return source, sigma**2 + walk, sigma


def _closed(turns: TurnSource, compass: TurnSource, t: Array) -> Array:
    """Headings at times (n,) by turns that bridge the compass's silences and end at what it says
    then: what they are off by is spread over each."""
    offset = np.unwrap(compass.turned - np.interp(compass.t, turns.t, turns.turned))
    return np.interp(t, turns.t, turns.turned) + np.interp(t, compass.t, offset)


def _turned(mission: Mission, t: Array, settings: MotionSettings) -> tuple[Array, float]:
    """Integral of the yaw rate over the grid, and the growth of its variance.

    Where a gyro falls silent the compass says how far the vehicle turned, else the odometry.
    """
    imu, odometry = mission.first("imu"), mission.first("odometry")
    span_s = min(mission.span_s[0], float(t[0])), float(t[-1])
    others = list(by_odometry(mission))
    if imu is not None:
        assert isinstance(imu.series, ImuSeries)
        rate = (imu.series.gyro_i @ imu.R_bs.T)[:, 2]
        turns = by_rate(imu.series.t, rate, span_s, longest_step_s(imu.series.t, MAX_RATE_GAP_S))
        headings = headings_true(mission)
        if headings is not None and len(headings) > 1:
            others.insert(0, _by_compass(mission, headings, settings)[0])
        variance = ImuNoise.model_validate(imu.noise).gyro_noise_density_rad_s_sqrt_hz ** 2
        variance += _variance_by_wheels_rad2_s(mission, turns, t)
    elif odometry is not None:
        assert isinstance(odometry.series, OdometrySeries)
        turns, *others = others
        variance = _white_variance_rad2_s(odometry.series)
    else:
        return np.zeros(len(t)), unmeasured_yaw_variance_rad2_s(settings)
    turns = spliced(turns, *others)
    return np.interp(t, turns.t, turns.turned), variance


def _variance_by_wheels_rad2_s(mission: Mission, gyro: TurnSource, t: Array) -> float:
    """What wheels that tell of a gyro's silences add, over the grid (n,), to the growth of the
    variance: their noise and the turn that they do not notice."""
    odometry = mission.first("odometry")
    if odometry is None or len(t) < 2:
        return 0.0
    series = odometry.series
    assert isinstance(series, OdometrySeries)
    (wheels,) = by_odometry(mission)
    middle = 0.5 * (t[1:] + t[:-1])
    told_s = np.diff(t) * (~gyro.tells(middle) & wheels.tells(middle))
    ahead_m = float(np.interp(middle, series.t, series.v_b[:, 0]) @ told_s)
    variance = _white_variance_rad2_s(series) * float(np.sum(told_s))
    return (variance + (curvature_sigma(mission) * ahead_m) ** 2) / float(t[-1] - t[0])


def _white_variance_rad2_s(series: OdometrySeries) -> float:
    """Growth of the variance of turns by noise of yaw rates alone."""
    step_s = float(np.median(np.diff(series.t))) if len(series.t) > 1 else 1.0
    return float(np.median(series.sigma_yaw_rate**2)) * step_s


def heading_less_turn(
    headings: HeadingSeries, turned: Array, noise: ImuNoise, compass_walk_rad2_s: float = 0.0
) -> tuple[Array, Array]:
    """Heading less the gyro's turn, smoothed as the gyro drifts; and its rate of change.

    What disturbs a compass must not bend the way: the graph takes it for an error of headings, not
    of displacements. It walks as the gyro does, so that of what both walked the gyro's share is
    expected to be that of its density.
    """
    from gtsam_nav.preprocess._trend import smooth_trend

    difference = np.unwrap(headings.heading) - turned
    gyro_walk = noise.gyro_noise_density_rad_s_sqrt_hz**2
    level, trend, _, _ = smooth_trend(
        headings.t,
        np.unwrap(difference),
        headings.sigma**2,
        gyro_walk + compass_walk_rad2_s,
        noise.gyro_bias_walk_rad_s2_sqrt_hz**2,
        noise.gyro_bias_sigma_rad_s**2,
        np.inf,
    )
    steps = 0.5 * (trend[1:] + trend[:-1]) * np.diff(headings.t)
    walked = level - np.concatenate([[0.0], np.cumsum(steps)])
    by_compass = compass_walk_rad2_s / (gyro_walk + compass_walk_rad2_s)
    return level - by_compass * (walked - np.mean(walked)), trend
