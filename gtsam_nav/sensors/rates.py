"""Angular rate of the body, from whatever measures it."""

from __future__ import annotations

import numpy as np

from gtsam_nav.frames import Array, rotation_from_rpy
from gtsam_nav.mission import Mission
from gtsam_nav.sensors.orientation import headings_true, tilt_at
from gtsam_nav.sensors.silences import is_heard, longest_step_s
from gtsam_nav.series import ImuSeries, OdometrySeries


def angular_rate_b(mission: Mission, t: Array, gyro_bias_b: Array) -> Array:
    """Angular rate in body axes at given times, shape (n, 3), rad/s.

    From the IMU less its bias (3,); where there is none, or while it is silent, as
    `rate_without_gyro_b`.
    """
    omega_b = rate_without_gyro_b(mission, t)
    imu = mission.first("imu")
    if imu is None:
        return omega_b
    series = imu.series
    assert isinstance(series, ImuSeries)
    heard = is_heard(series.t, t)
    rates_b = series.gyro_i @ imu.R_bs.T - gyro_bias_b
    omega_b[heard] = np.stack([np.interp(t[heard], series.t, axis) for axis in rates_b.T], axis=1)
    return omega_b


def rate_without_gyro_b(mission: Mission, t: Array) -> Array:
    """Angular rate in body axes at given times, shape (n, 3), rad/s.

    The odometry's yaw rate, else the change of heading over a second; zero where nothing turns or
    nothing measures it.
    """
    omega_b = np.zeros((len(t), 3))
    headings, odometry = headings_true(mission), mission.first("odometry")
    if headings is not None and len(headings) > 1:
        unwrapped = np.unwrap(headings.heading)
        before, after = (np.interp(t + shift, headings.t, unwrapped) for shift in (-0.5, 0.5))
        omega_b = (after - before)[:, None] * _down_b(mission, t)
    if odometry is not None:
        series = odometry.series
        assert isinstance(series, OdometrySeries)
        heard = is_heard(series.t, t)
        rate = np.interp(t[heard], series.t, series.yaw_rate)
        omega_b[heard] = np.outer(rate, [0.0, 0.0, 1.0])
    return omega_b


def mean_gyro_bias_b(mission: Mission) -> Array:
    """Mean bias of the gyro in body axes, shape (3,), rad/s; zero without an IMU and a compass.

    Over the time that both tell, yaw turns by what the compass says; roll and pitch come back. A
    DVL's lever arm makes a constant velocity sideways of it: a wrong course.
    """
    imu, headings = mission.first("imu"), headings_true(mission)
    if imu is None or headings is None or len(headings) < 2:
        return np.zeros(3)
    series = imu.series
    assert isinstance(series, ImuSeries)
    t, rates_b = series.t, series.gyro_i @ imu.R_bs.T
    middle, span_s = 0.5 * (t[1:] + t[:-1]), np.diff(t)
    both = (t[:-1] >= headings.t[0]) & (t[1:] <= headings.t[-1]) & (span_s <= longest_step_s(t))
    both &= is_heard(headings.t, middle)
    if not np.any(both):
        return np.zeros(3)
    turned = np.diff(np.interp(t, headings.t, np.unwrap(headings.heading)))[both]
    by_gyro_b = 0.5 * (rates_b[1:] + rates_b[:-1])[both] * span_s[both, None]
    by_compass_b = turned[:, None] * _down_b(mission, middle[both])
    # over less than the compass's own step its noise would pass for a bias
    told_s = max(float(span_s[both].sum()), longest_step_s(headings.t))
    return np.asarray((by_gyro_b - by_compass_b).sum(axis=0) / told_s)


def _down_b(mission: Mission, t: Array) -> Array:
    """Where down is along body axes at given times, shape (n, 3): what headings turn about."""
    tilt, _ = tilt_at(mission, t)
    return rotation_from_rpy(np.column_stack([tilt, np.zeros(len(t))]))[:, 2]
