"""The way of a GNSS antenna by everything but its fixes, to compare successive fixes with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtsam_nav.frames import Array, rotation_from_rpy
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.preprocess.alignment import align
from gtsam_nav.preprocess.inertial_motion import free_path
from gtsam_nav.preprocess.motion import measures_velocity
from gtsam_nav.preprocess.planar_motion import planar_motion
from gtsam_nav.preprocess.settings import MotionSettings
from gtsam_nav.sensors.noise import GnssNoise
from gtsam_nav.sensors.orientation import headings_true
from gtsam_nav.series import GnssSeries


@dataclass(frozen=True)
class AntennaPath:
    """A level path at the fixes' times, from anywhere on.

    Attributes
    ----------
    p : ndarray, shape (n, 2)
        North and east, m.
    v : ndarray, shape (n, 2)
        Of the vehicle, m/s.
    variance : ndarray, shape (n,)
        Of the way since the first fix, each axis, as far as it is white noise, m^2.
    """

    p: Array
    v: Array
    variance: Array


def antenna_path(
    mission: Mission, receiver: Sensor, t: Array, settings: MotionSettings
) -> AntennaPath | None:
    """By DVL or odometry under a compass, else by the receiver's velocities, else by the IMU;
    None where nothing of these tells it."""
    series = receiver.series
    assert isinstance(series, GnssSeries)
    headings = headings_true(mission)
    if measures_velocity(mission) and headings is not None and len(headings) > 1:
        return _by_speeds(mission, receiver, t, settings)
    if series.v_n is not None:
        return _by_velocities(series, t, GnssNoise.model_validate(receiver.noise))
    imu = mission.first("imu")
    if imu is not None and len(imu.series) >= 2:
        return _by_inertia(mission, imu, receiver, t)
    return None


def _by_speeds(
    mission: Mission, receiver: Sensor, t: Array, settings: MotionSettings
) -> AntennaPath | None:
    motion = planar_motion(mission, settings, readings_suffice=True)
    if motion is None:
        return None
    p, course, variance = motion.at(t)
    c, s = np.cos(course), np.sin(course)
    x, y, _ = receiver.xyz_b
    arm = np.column_stack([c * x - s * y, s * x + c * y])
    speed = np.gradient(motion.p, motion.t, axis=0)
    v = np.stack([np.interp(t, motion.t, axis) for axis in speed.T], axis=1)
    return AntennaPath(p + arm, v, variance[:, 0])


def _by_velocities(series: GnssSeries, t: Array, noise: GnssNoise) -> AntennaPath:
    assert series.v_n is not None
    told = series.t - noise.velocity_lag_s
    v = np.stack([np.interp(t, told, axis) for axis in series.v_n[:, :2].T], axis=1)
    steps_s = np.diff(t)
    way = 0.5 * (v[1:] + v[:-1]) * steps_s[:, None]
    variance = noise.sigma_velocity_m_s**2 * steps_s**2 / 2
    return AntennaPath(
        np.vstack([np.zeros(2), np.cumsum(way, axis=0)]),
        v,
        np.concatenate([[0.0], np.cumsum(variance)]),
    )


def _by_inertia(mission: Mission, imu: Sensor, receiver: Sensor, t: Array) -> AntennaPath:
    path = free_path(mission, imu, receiver, align(mission))
    rpy, p_n, v_n = path.at(t)
    antenna_n = p_n + rotation_from_rpy(rpy) @ receiver.xyz_b
    return AntennaPath(antenna_n[:, :2], v_n[:, :2], np.zeros(len(t)))
