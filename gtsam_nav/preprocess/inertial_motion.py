"""The motion of a vehicle without a velocity sensor: inertial readings, drawn onto the fixes.

A first guess for the graph. Attitude: roll and pitch by levelling, yaw by the compass, else by the
course over ground, each carried by the gyro and smoothed as the gyro drifts. Position: the
accelerations, integrated twice, and a smooth difference to the fixes. Without fixes: the strapdown
integration alone.
"""

from __future__ import annotations

import numpy as np

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array, earth_rate_n, rotation_from_rpy, rpy_from_rotation
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.preprocess.alignment import Alignment, at_rest
from gtsam_nav.preprocess.first_fixes import locating_receiver
from gtsam_nav.preprocess.levelling import MAX_GAP_S, Readings, levelled, readings_of
from gtsam_nav.preprocess.measured_turns import heading_less_turn
from gtsam_nav.preprocess.motion import VehicleMotion, motion_grid
from gtsam_nav.preprocess.robust_trend import robust_trend
from gtsam_nav.preprocess.settings import MotionSettings
from gtsam_nav.preprocess.strapdown import gravity_at, integrate
from gtsam_nav.sensors.noise import ImuNoise
from gtsam_nav.sensors.orientation import headings_true, tilt_at
from gtsam_nav.series import GnssSeries

ACCELERATION_ERROR_M_S2 = 0.3
"""What accelerations that were turned by a guessed attitude are wrong by, over a second."""
FASTEST_M_S = 100.0
"""Spread of a velocity that nothing is known of."""
MANOEUVRE_M_S2 = 1.0
"""Acceleration of a vehicle that only its fixes tell of."""
LEAST_COURSE_SPEED_M_S = 1.0
SIDESLIP_RAD = np.radians(5.0)
REST_S = 2.0


def inertial_motion(mission: Mission, start: Alignment, settings: MotionSettings) -> VehicleMotion:
    """First guess of a mission's motion from its IMU and fixes.

    Raises
    ------
    DataError
        Where there is no IMU either.
    """
    imu = mission.first("imu")
    if imu is None or len(imu.series) < 2:
        beside = "; of 3-D clouds alone, method kiss tells it" if mission.first("scans") else ""
        raise DataError(
            f"mission '{mission.name}': the motion needs a DVL with valid samples, odometry or an"
            f" IMU; the mission has: {mission.aboard}{beside}"
        )
    readings = readings_of(imu)
    fixes = locating_receiver(mission) or mission.first("gnss")
    if fixes is None or len(fixes.series) < 2:
        rpy, p_n, v_n, bias_b = _unaided(mission, readings, imu, start)
    else:
        rpy, bias_b = _attitude(mission, readings, imu, fixes, start)
        p_n, v_n = _onto_fixes(mission, readings, rpy, fixes)
        if locating_receiver(mission) is None:
            p_n = p_n + start.p_n - p_n[0]
    t = motion_grid(mission, start, settings)

    def at(values: Array) -> Array:
        return np.stack([np.interp(t, readings.t, column) for column in values.T], axis=1)

    rpy, v_n = at(rpy), at(v_n)
    speed_variance = ACCELERATION_ERROR_M_S2**2
    noise = ImuNoise.model_validate(imu.noise)
    return VehicleMotion(
        t=t,
        p_n=at(p_n),
        rpy=rpy,
        v_b=np.einsum("nji,nj->ni", rotation_from_rpy(rpy), v_n),
        sigma_v=np.full(len(t), np.sqrt(speed_variance)),
        position_variance=speed_variance * (t - t[0]),
        position_variance_m2_s=speed_variance,
        yaw_variance_rad2_s=noise.gyro_noise_density_rad_s_sqrt_hz**2,
        gyro_bias_b=bias_b,
        rejections=(),
    )


def _unaided(
    mission: Mission, readings: Readings, imu: Sensor, start: Alignment
) -> tuple[Array, Array, Array, Array]:
    """Roll, pitch, unwrapped yaw, position, velocity and gyro bias by inertial readings alone."""
    bias_b = _bias_at_rest(mission, readings, imu, start)
    moving = integrate(
        readings.t,
        readings.gyro_b - bias_b,
        readings.accel_b,
        start.R_nb,
        np.zeros(3),
        start.p_n,
        mission.origin,
        max_gap_s=MAX_GAP_S,
    )
    rpy = rpy_from_rotation(moving.R_nb)
    rpy[:, [0, 2]] = np.unwrap(rpy[:, [0, 2]], axis=0)
    return rpy, moving.p_n, moving.v_n, bias_b


def _bias_at_rest(mission: Mission, readings: Readings, imu: Sensor, start: Alignment) -> Array:
    """Gyro bias of a vehicle that begins at rest, shape (3,), as far as it shows within its noise.

    Zero where the vehicle moves.
    """
    if not at_rest(mission, start.t, REST_S):
        return np.zeros(3)
    noise = ImuNoise.model_validate(imu.noise)
    resting = readings.t < start.t + REST_S
    mean = readings.gyro_b[resting].mean(axis=0)
    if mission.origin is not None:
        mean = mean - start.R_nb.T @ earth_rate_n(mission.origin.latitude_deg)
    prior = noise.gyro_bias_sigma_rad_s**2
    return np.asarray(mean * prior / (prior + noise.gyro_noise_density_rad_s_sqrt_hz**2 / REST_S))


def _attitude(
    mission: Mission, readings: Readings, imu: Sensor, fixes: Sensor, start: Alignment
) -> tuple[Array, Array]:
    """Roll, pitch and unwrapped yaw (n, 3) and the mean bias of the gyro (3,)."""
    noise = ImuNoise.model_validate(imu.noise)
    bias_b = np.zeros(3)
    if mission.first("attitude") is not None:
        tilt, _ = tilt_at(mission, readings.t)
    else:
        tilt, bias_b[:2] = levelled(readings, noise)
    sr, cr = np.sin(tilt[:, 0]), np.cos(tilt[:, 0])
    yaw_rate = (sr * readings.gyro_b[:, 1] + cr * readings.gyro_b[:, 2]) / np.cos(tilt[:, 1])
    turned = readings.integral(yaw_rate)
    headings = headings_true(mission)
    if headings is not None and len(headings) > 1:
        there = np.interp(headings.t, readings.t, turned)
        offset, trend = heading_less_turn(headings, there, noise)
        yaw, bias_b[2] = turned + np.interp(readings.t, headings.t, offset), -np.mean(trend)
    else:
        offset, bias_b[2] = _course_less_turn(fixes, readings, turned, noise, start.rpy[2])
        yaw = turned + offset
        if start.heading_known:  # it was stated: the course may be another
            yaw += start.rpy[2] - np.interp(start.t, readings.t, yaw)
    return np.column_stack([tilt, yaw]), bias_b


def _course_less_turn(
    fixes: Sensor, readings: Readings, turned: Array, noise: ImuNoise, yaw_start: float
) -> tuple[Array, float]:
    """What the gyro's turn lacks to the course over ground, (n,), and the mean bias about z.

    A vehicle that moves is taken to move forward.
    """
    series = fixes.series
    assert isinstance(series, GnssSeries)
    v_n = series.v_n
    if v_n is None:
        _, v_n = robust_trend(
            series.t, series.p_n, series.sigma, 0.0, MANOEUVRE_M_S2**2, FASTEST_M_S**2
        )
    speed = np.hypot(v_n[:, 0], v_n[:, 1])
    fast = speed > LEAST_COURSE_SPEED_M_S
    if np.sum(fast) < 2:
        return np.full(len(readings.t), yaw_start), 0.0
    course = np.arctan2(v_n[fast, 1], v_n[fast, 0])
    t = series.t[fast]
    difference = np.unwrap(course - np.interp(t, readings.t, turned))
    sigma = np.hypot(SIDESLIP_RAD, LEAST_COURSE_SPEED_M_S / speed[fast] * SIDESLIP_RAD)
    offset, trend = robust_trend(
        t,
        difference[:, None],
        sigma[:, None],
        noise.gyro_noise_density_rad_s_sqrt_hz**2,
        noise.gyro_bias_walk_rad_s2_sqrt_hz**2,
        noise.gyro_bias_sigma_rad_s**2,
    )
    return np.interp(readings.t, t, offset[:, 0]), -float(np.mean(trend))


def _onto_fixes(
    mission: Mission, readings: Readings, rpy: Array, fixes: Sensor
) -> tuple[Array, Array]:
    """Position and velocity (n, 3): accelerations integrated twice, drawn onto the fixes."""
    from scipy.interpolate import CubicHermiteSpline

    series = fixes.series
    assert isinstance(series, GnssSeries)
    R_nb = rotation_from_rpy(rpy)
    gravity_n = gravity_at(np.zeros(3), mission.origin)
    a_n = np.einsum("nij,nj->ni", R_nb, readings.accel_b) + gravity_n
    v_n = np.stack([readings.integral(axis) for axis in a_n.T], axis=1)
    steps = 0.5 * (v_n[1:] + v_n[:-1]) * np.diff(readings.t)[:, None]
    p_n = np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])

    def at_fixes(values: Array) -> Array:
        return np.stack([np.interp(series.t, readings.t, axis) for axis in values.T], axis=1)

    arm_n = rotation_from_rpy(at_fixes(rpy)) @ fixes.xyz_b
    level, trend = robust_trend(
        series.t,
        series.p_n - arm_n - at_fixes(p_n),
        series.sigma,
        0.0,
        ACCELERATION_ERROR_M_S2**2,
        FASTEST_M_S**2,
    )
    # before the first fix and after the last the difference goes on as it did there
    begin, end = min(readings.t[0], series.t[0]) - 1.0, max(readings.t[-1], series.t[-1]) + 1.0
    t = np.concatenate([[begin], series.t, [end]])
    first, last = level[0] + trend[0] * (t[0] - t[1]), level[-1] + trend[-1] * (t[-1] - t[-2])
    difference = CubicHermiteSpline(
        t, np.vstack([first, level, last]), np.vstack([trend[:1], trend, trend[-1:]])
    )
    return p_n + difference(readings.t), v_n + difference(readings.t, 1)
