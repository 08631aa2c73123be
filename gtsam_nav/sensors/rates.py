"""Angular rate of the body, from whatever measures it."""

from __future__ import annotations

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission
from gtsam_nav.sensors.orientation import headings_true
from gtsam_nav.series import ImuSeries, OdometrySeries


def angular_rate_b(mission: Mission, t: Array) -> Array:
    """Angular rate in body axes at given times, shape (n, 3), rad/s.

    From the IMU with its bias (see `mean_gyro_bias_b`), else the odometry's yaw rate, else the
    change of heading over a second; zero where nothing turns or nothing measures it.
    """
    imu = mission.first("imu")
    if imu is not None:
        series = imu.series
        assert isinstance(series, ImuSeries)
        rates_b = series.gyro_i @ imu.R_bs.T
        return np.stack([np.interp(t, series.t, axis) for axis in rates_b.T], axis=1)
    omega_b = np.zeros((len(t), 3))
    odometry = mission.first("odometry")
    headings = headings_true(mission)
    if odometry is not None:
        assert isinstance(odometry.series, OdometrySeries)
        omega_b[:, 2] = np.interp(t, odometry.series.t, odometry.series.yaw_rate)
    elif headings is not None and len(headings) > 1:
        unwrapped = np.unwrap(headings.heading)
        before, after = (np.interp(t + shift, headings.t, unwrapped) for shift in (-0.5, 0.5))
        omega_b[:, 2] = after - before
    return omega_b


def mean_gyro_bias_b(mission: Mission) -> Array:
    """Mean bias of the gyro in body axes, shape (3,), rad/s; zero without an IMU and a compass.

    Yaw turns by what the compass says of the whole mission, roll and pitch come back. A DVL's lever
    arm makes a constant velocity sideways of it: a wrong course.
    """
    imu, headings = mission.first("imu"), headings_true(mission)
    if imu is None or headings is None or len(headings) < 2:
        return np.zeros(3)
    series = imu.series
    assert isinstance(series, ImuSeries)
    both = (series.t >= headings.t[0]) & (series.t <= headings.t[-1])
    if not np.any(both):
        return np.zeros(3)
    turned = np.unwrap(headings.heading)[[0, -1]]
    yaw_rate = (turned[1] - turned[0]) / (headings.t[-1] - headings.t[0])
    mean_b = (series.gyro_i[both] @ imu.R_bs.T).mean(axis=0)
    return np.asarray(mean_b - [0.0, 0.0, yaw_rate])
