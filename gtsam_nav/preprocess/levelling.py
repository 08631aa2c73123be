"""Roll and pitch by gravity, carried by the gyro: what levels a vehicle without an AHRS."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.mission import Sensor
from gtsam_nav.preprocess.strapdown import readings_at_origin
from gtsam_nav.sensors.noise import ImuNoise

MAX_GAP_S = 0.2
"""Over a longer silence of the IMU the vehicle is taken to keep its velocity."""
LEVELLING_S = 1.0
"""Specific forces are averaged over so long for a reading of roll and pitch."""
LEAST_TILT_SIGMA_RAD = np.radians(0.5)


@dataclass(frozen=True)
class Readings:
    """Inertial readings at the body's origin, along body axes; ``silent`` marks the long steps."""

    t: Array
    gyro_b: Array
    accel_b: Array

    @property
    def silent(self) -> Array:
        """Which of the n - 1 steps are longer than an IMU that works would make them."""
        return np.asarray(np.diff(self.t) > MAX_GAP_S)

    def integral(self, rate: Array) -> Array:
        """Of a rate (n,) over time, zero where the readings are silent; shape (n,)."""
        steps = 0.5 * (rate[1:] + rate[:-1]) * np.diff(self.t)
        steps[self.silent] = 0.0
        return np.concatenate([[0.0], np.cumsum(steps)])


def readings_of(imu: Sensor) -> Readings:
    """What an IMU as mounted would have read at the body's origin."""
    return Readings(imu.series.t, *readings_at_origin(imu))


def tilt_by(imu: Sensor, t: Array) -> Array:
    """Unwrapped roll and pitch at given times, (k, 2) rad, by an IMU alone."""
    readings = readings_of(imu)
    tilt, _ = levelled(readings, ImuNoise.model_validate(imu.noise))
    return np.stack([np.interp(t, readings.t, axis) for axis in tilt.T], axis=1)


def levelled(readings: Readings, noise: ImuNoise) -> tuple[Array, Array]:
    """Unwrapped roll and pitch (n, 2), rad, and the mean gyro biases about x and y (2,), rad/s.

    The gyro turns both; its difference to gravity's direction is smoothed as the gyro drifts.
    """
    from gtsam_nav.preprocess._trend import smooth_trend

    bins = ((readings.t - readings.t[0]) / LEVELLING_S).astype(np.int64)
    _, which, count = np.unique(bins, return_inverse=True, return_counts=True)
    fx, fy, fz = (np.bincount(which, axis) / count for axis in readings.accel_b.T)
    t = np.bincount(which, readings.t) / count
    level = np.column_stack([np.unwrap(np.arctan2(-fy, -fz)), np.arctan2(fx, np.hypot(fy, fz))])
    variance = np.maximum(np.var(level, axis=0), LEAST_TILT_SIGMA_RAD**2)
    tilt = np.stack([np.interp(readings.t, t, axis) for axis in level.T], axis=1)
    bias = np.zeros(2)
    for _ in range(2):  # the rates of roll and pitch depend on roll and pitch
        sr, cr, tp = np.sin(tilt[:, 0]), np.cos(tilt[:, 0]), np.tan(tilt[:, 1])
        p, q, r = readings.gyro_b.T
        rates = (p + tp * (sr * q + cr * r), cr * q - sr * r)
        for axis, rate in enumerate(rates):
            turned = readings.integral(rate)
            offset, trend, _, _ = smooth_trend(
                t,
                level[:, axis] - np.interp(t, readings.t, turned),
                np.full(len(t), variance[axis]),
                noise.gyro_noise_density_rad_s_sqrt_hz**2,
                noise.gyro_bias_walk_rad_s2_sqrt_hz**2,
                noise.gyro_bias_sigma_rad_s**2,
                np.inf,
            )
            tilt[:, axis] = turned + np.interp(readings.t, t, offset)
            bias[axis] = -np.mean(trend)
    return tilt, bias
