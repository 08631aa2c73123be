"""The vehicle's motion by its own sensors alone, smoothed: what places echoes inside a scan.

Attitude comes from the AHRS, carried between its readings by the gyro where there is one; velocity
from the DVL (or odometry), smoothed because its white noise would otherwise walk the position by
decimetres within one scan. Nothing absolute enters: a mission's graph corrects this motion.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array, quaternion_from_rpy, rotation_from_rpy
from gtsam_nav.mission import Mission, Rejection, Sensor
from gtsam_nav.preprocess.alignment import Alignment
from gtsam_nav.preprocess.first_fixes import locating_receiver
from gtsam_nav.preprocess.levelling import tilt_by
from gtsam_nav.preprocess.measured_turns import measured_turns
from gtsam_nav.preprocess.settings import MotionSettings
from gtsam_nav.sensors.dvl import BodyVelocities, body_velocities
from gtsam_nav.sensors.odometry import velocity_sensor
from gtsam_nav.sensors.orientation import tilt_at
from gtsam_nav.sensors.prediction import chi2_limit
from gtsam_nav.sensors.rates import angular_rate_b
from gtsam_nav.series import BoolArray, GnssSeries, OdometrySeries
from gtsam_nav.trajectory import Trajectory, record_times

SPREAD_SIGMAS = 5.0
"""Fixes tell a heading once they spread this many of their sigmas."""
FIRST_FIXES_S = 60.0
"""Fixes of so long a time tell together where a motion begins."""
SPIKE_PROBABILITY = 0.99999
"""Velocity readings less likely than one minus this are spikes."""


@dataclass(frozen=True)
class VehicleMotion:
    """Dead-reckoned motion at increasing times.

    Attributes
    ----------
    t : ndarray, shape (n,)
    p_n : ndarray, shape (n, 3)
        Position, m, from the alignment on.
    rpy : ndarray, shape (n, 3)
        Unwrapped roll, pitch and unwrapped yaw, rad.
    v_b : ndarray, shape (n, 3)
        Smoothed body velocity, m/s.
    sigma_v : ndarray, shape (n,)
        Of each component of ``v_b``, m/s.
    position_variance : ndarray, shape (n,)
        Variance of the displacement since the start, each axis, m^2: what the velocity's white
        noise and its gaps add up to.
    position_variance_m2_s : float
        Its growth where readings come at their usual rate.
    yaw_variance_rad2_s : float
        Growth of the variance of a turn.
    gyro_bias_b : ndarray, shape (3,)
        Mean gyro bias in body axes by comparison with the AHRS, rad/s; zero without either.
    rejections : tuple of Rejection
    compass_sigma : float or None
        White noise of the yaw where a compass alone tells the turns, rad; None elsewhere.
    """

    t: Array
    p_n: Array
    rpy: Array
    v_b: Array
    sigma_v: Array
    position_variance: Array
    position_variance_m2_s: float
    yaw_variance_rad2_s: float
    gyro_bias_b: Array
    rejections: tuple[Rejection, ...]
    compass_sigma: float | None = None

    @property
    def trajectory(self) -> Trajectory:
        """As a trajectory without uncertainty."""
        R_nb = rotation_from_rpy(self.rpy)
        return Trajectory(
            t=self.t,
            p_n=self.p_n,
            q_nb_wxyz=quaternion_from_rpy(self.rpy),
            v_n=np.einsum("nij,nj->ni", R_nb, self.v_b),
        )

    def displacement_variance(self, from_s: Array, to_s: Array) -> Array:
        """Variance of the displacement between given times, each axis, m^2."""
        a, b = (np.interp(t, self.t, self.position_variance) for t in (from_s, to_s))
        return np.asarray(np.abs(b - a))

    def at(self, t: Array) -> tuple[Array, Array]:
        """Position (k, 3) and roll, pitch, yaw (k, 3), unwrapped, at given times."""
        i = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, max(len(self.t) - 2, 0))
        j = np.minimum(i + 1, len(self.t) - 1)
        span = np.maximum(self.t[j] - self.t[i], 1e-12)
        f = np.clip((t - self.t[i]) / span, 0.0, 1.0)[:, None]
        p_n = (1 - f) * self.p_n[i] + f * self.p_n[j]
        return p_n, (1 - f) * self.rpy[i] + f * self.rpy[j]


def measures_velocity(mission: Mission) -> bool:
    """Whether a mission has readings of the vehicle's speed: a DVL's valid ones, or odometry."""
    return velocity_sensor(mission) is not None


def vehicle_motion(
    mission: Mission, start: Alignment, settings: MotionSettings, fast_imu: Sensor | None = None
) -> VehicleMotion:
    """Dead-reckon a mission's motion.

    Parameters
    ----------
    mission : Mission
    start : Alignment
    settings : MotionSettings
    fast_imu : Sensor, optional
        IMU that misses no turns: it tells roll and pitch where no AHRS does (without it such a
        vehicle is level), and what disturbs a compass does not bend the way.

    Raises
    ------
    DataError
        Where nothing measures the velocity.
    """
    t = motion_grid(mission, start, settings)
    turns = measured_turns(mission, t, start, settings, fast_imu)
    v_b, sigma_v, position_variance, usual_growth, rejections = _velocities(
        mission, t, settings, turns.gyro_bias_b
    )
    if fast_imu is not None and mission.first("attitude") is None:
        tilt = tilt_by(fast_imu, t)
    else:
        tilt, _ = tilt_at(mission, t)
    rpy = np.column_stack([tilt, turns.yaw])
    v_n = np.einsum("nij,nj->ni", rotation_from_rpy(rpy), v_b)
    steps = 0.5 * (v_n[1:] + v_n[:-1]) * np.diff(t)[:, None]
    p_n = start.p_n + np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
    return VehicleMotion(
        t=t,
        p_n=p_n,
        rpy=rpy,
        v_b=v_b,
        sigma_v=sigma_v,
        position_variance=position_variance,
        position_variance_m2_s=usual_growth,
        yaw_variance_rad2_s=turns.variance_rad2_s,
        gyro_bias_b=turns.gyro_bias_b,
        rejections=rejections,
        compass_sigma=turns.compass_sigma,
    )


def motion_grid(mission: Mission, start: Alignment, settings: MotionSettings) -> Array:
    """The uniform times of a mission's motion, its last sample's included."""
    return record_times(start.t, mission.span_s[1], settings.rate_hz)


def turn_onto_fixes(mission: Mission, motion: VehicleMotion) -> float | None:
    """How far a motion must turn to follow the mission's fixes, rad; None where they do not say.

    The least-squares rotation between both tracks; the fixes must spread over well more than
    their own noise.
    """
    gnss = locating_receiver(mission)
    if gnss is None:
        return None
    series = gnss.series
    assert isinstance(series, GnssSeries)
    inside = (series.t >= motion.t[0]) & (series.t <= motion.t[-1])
    if np.sum(inside) < 2:
        return None
    fixes = series.p_n[inside, 0] + 1j * series.p_n[inside, 1]
    own_n, _ = motion.at(series.t[inside])
    own = own_n[:, 0] + 1j * own_n[:, 1]
    fixes, own = fixes - fixes.mean(), own - own.mean()
    if np.std(fixes) < SPREAD_SIGMAS * float(np.median(series.sigma[inside, :2])):
        return None
    return float(np.angle(np.sum(np.conj(own) * fixes)))


def offset_from_fixes(mission: Mission, motion: VehicleMotion) -> Array:
    """Where the first minute's fixes put a motion, less where it is, shape (3,), m, level.

    The median of all: the first one may be an outlier, and so may half of the others.
    """
    gnss = locating_receiver(mission)
    if gnss is None:
        return np.zeros(3)
    series = gnss.series
    assert isinstance(series, GnssSeries)
    first = series.select(
        (series.t >= motion.t[0]) & (series.t <= max(series.t[0], motion.t[0]) + FIRST_FIXES_S)
    )
    p_n, rpy = motion.at(first.t)
    off = first.p_n - p_n - rotation_from_rpy(rpy) @ gnss.xyz_b
    return np.array([*np.median(off[:, :2], axis=0), 0.0]) if len(first) else np.zeros(3)


def _velocities(
    mission: Mission, t: Array, settings: MotionSettings, gyro_bias_b: Array
) -> tuple[Array, Array, Array, float, tuple[Rejection, ...]]:
    """Smoothed body velocity on the grid, its sigma, and the random walk that its noise makes."""
    z, rejections = _velocity_readings(mission, settings, gyro_bias_b)
    densities = np.array(
        [settings.sigma_accel_m_s2, settings.sigma_accel_m_s2, settings.sigma_vertical_accel_m_s2]
    )
    gate = chi2_limit(SPIKE_PROBABILITY, 1)
    smoothed = _smooth_each_axis(z, t, densities**2, gate)
    v_b = np.stack([level for level, _, _ in smoothed], axis=1)
    sigma_v = np.sqrt(smoothed[0][1])
    used = np.all([used for _, _, used in smoothed], axis=0)
    spikes = tuple(
        Rejection(float(z.t[k]), z.sensor, int(z.row[k]), "velocity spike")
        for k in np.flatnonzero(~used)
    )
    # white readings every dt integrate to a random walk of variance sigma^2 dt per second
    usual_gap = float(np.median(np.diff(z.t)))
    usual_growth = float(np.median(z.sigma**2)) * usual_gap
    sigma_accel = settings.sigma_accel_m_s2
    position_variance = _walked(t, z.t[used], usual_gap, usual_growth, sigma_accel)
    return v_b, sigma_v, position_variance, usual_growth, (*rejections, *spikes)


def _walked(
    t: Array, t_readings: Array, usual_gap: float, usual_growth: float, sigma_accel: float
) -> Array:
    """Variance of the position since the start: usual growth, and more where readings lack.

    Over a gap of length L a velocity that walks with density q and is known at both ends leaves
    the displacement uncertain by ``q L^3 / 12``; known at one end only, by ``q L^3 / 3``.
    """
    q = sigma_accel**2
    marks = np.concatenate([[min(t[0], t_readings[0])], t_readings, [max(t[-1], t_readings[-1])]])
    gap = np.diff(marks)
    excess = np.where(gap > 3 * usual_gap, q * gap**3 / 12, 0.0)
    excess[[0, -1]] = q * gap[[0, -1]] ** 3 / 3
    total = np.concatenate([[0.0], np.cumsum(usual_growth * gap + excess)])
    return np.asarray(np.interp(t, marks, total))


def _smooth_each_axis(
    z: BodyVelocities, t: Array, densities: Array, gate: float
) -> list[tuple[Array, Array, BoolArray]]:
    """Level and its variance on the grid, and which readings were used, of each axis.

    Wheels, unlike sound, make no spikes, and change their speed at once: their readings are taken
    as they are.
    """
    if z.by_wheels:
        everything, variance = np.ones(len(z.t), dtype=bool), np.interp(t, z.t, z.sigma**2)
        return [(np.interp(t, z.t, axis), variance, everything) for axis in z.v_b.T]
    from gtsam_nav.preprocess._trend import smooth_trend
    from gtsam_nav.preprocess.manoeuvres import in_manoeuvres

    # between readings, the grid's own times are readings that say nothing
    silent = t[t > z.t[0]]
    times = np.concatenate([z.t, silent])
    order = np.argsort(times, kind="stable")
    times, is_reading = times[order], order < len(z.t)
    variance = np.append(z.sigma**2, np.full(len(silent), np.inf))[order]
    out = []
    for axis in range(3):
        readings = np.append(z.v_b[:, axis], np.zeros(len(silent)))[order]
        level, _, level_variance, passed = smooth_trend(
            times, readings, variance, densities[axis], 0.0, 0.0, gate
        )
        used = passed[is_reading]
        believed = in_manoeuvres(z.t, z.v_b[:, axis], z.sigma, ~used)
        if np.any(believed):
            used |= believed
            known = np.append(np.where(used, z.sigma**2, np.inf), np.full(len(silent), np.inf))
            level, _, level_variance, _ = smooth_trend(
                times, readings, known[order], densities[axis], 0.0, 0.0, np.inf
            )
        before_s = np.maximum(z.t[0] - t, 0.0)
        variance_on_grid = np.interp(t, times, level_variance) + densities[axis] * before_s
        out.append((np.interp(t, times, level), variance_on_grid, used))
    return out


def _velocity_readings(
    mission: Mission, settings: MotionSettings, gyro_bias_b: Array
) -> tuple[BodyVelocities, tuple[Rejection, ...]]:
    """Readings of the first DVL that has two, else of the odometry; and those left out.

    A gyro's bias would lend its lever arm a constant velocity sideways: a wrong course.
    """
    rejections: tuple[Rejection, ...] = ()
    for dvl in mission.of_type("dvl"):
        omega_b = angular_rate_b(mission, dvl.series.t, gyro_bias_b)
        readings = body_velocities(dvl, omega_b, settings.water_lock_after_s)
        rejections += readings.rejections
        if len(readings) >= 2:
            return readings, rejections
    for odometry in mission.of_type("odometry"):
        series = odometry.series
        assert isinstance(series, OdometrySeries)
        if len(series) >= 2:
            v_b = np.column_stack([series.v_b, np.zeros(len(series))])
            readings = BodyVelocities(
                odometry.name, series.t, v_b, series.sigma_v, series.row, by_wheels=True
            )
            return readings, rejections
    raise DataError(
        f"mission '{mission.name}': the velocity needs a DVL with valid samples or odometry;"
        f" the mission has: {mission.aboard}"
    )
