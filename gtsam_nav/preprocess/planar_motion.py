"""Planar dead reckoning: displacement and turn between any two times, with their noise.

Speeds come from a DVL or from odometry, turns from the compass; where there is none, or while it is
silent, from the odometry's yaw rate, else the gyro. Nothing is smoothed: what it says of a time
rests on what was measured until then.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission
from gtsam_nav.preprocess.settings import MotionSettings
from gtsam_nav.preprocess.turn_sources import TurnSource, spliced
from gtsam_nav.sensors.dvl import body_velocities, water_spells
from gtsam_nav.sensors.noise import DvlNoise, HeadingNoise, ImuNoise, OdometryNoise
from gtsam_nav.sensors.odometry import curvature_sigma
from gtsam_nav.sensors.orientation import headings_true, in_level_axes
from gtsam_nav.sensors.rates import angular_rate_b, mean_gyro_bias_b
from gtsam_nav.sensors.silences import longest_step_s, since_heard
from gtsam_nav.series import BoolArray, HeadingSeries, ImuSeries, OdometrySeries


@dataclass(frozen=True)
class Increments:
    """Motion over the k spans between given times.

    Attributes
    ----------
    displacement_b : ndarray, shape (k, 2)
        Forward and to starboard, in the axes of the span's start, m.
    turn : ndarray, shape (k,)
        Clockwise, rad.
    variance : ndarray, shape (k, 3)
        Of the three.
    bent_m : ndarray, shape (k,)
        Over what way odometry told the turn, and so its curvature counts, m.
    """

    displacement_b: Array
    turn: Array
    variance: Array
    bent_m: Array


@dataclass(frozen=True)
class PlanarMotion:
    """Dead-reckoned motion at the readings' times.

    Attributes
    ----------
    t : ndarray, shape (n,)
    p : ndarray, shape (n, 2)
        Position in the axes of the first reading's course, m.
    course : ndarray, shape (n,)
        Unwrapped, rad.
    variance : ndarray, shape (n, 3)
        Of all steps so far, added up, but for a current's: forward, to starboard, course.
    course_is_heading : bool
        Whether ``course`` is a compass's heading, or starts at zero.
    scale_sigma : float
        Spread of the constant error of the speeds, as a share of them.
    curvature_sigma : float
        Spread of the constant error of the turns, rad a metre; zero where odometry tells none.
    bent_m : ndarray, shape (n,)
        Over what way it has turned each course: that ahead since the compass was last
        heard, m.
    misalignment_sigma : float
        Spread of the constant error of the speeds' direction, rad.
    disturbance_sigma, disturbance_time_s : float
        Of the compass's Gauss-Markov error, whose walk ``variance`` holds; zero without a compass.
    white_sigma : float
        Of the compass's noise that each ``course`` has, rad.
    current_sigma : float
        Of the water's motion, m/s, that the speeds miss in the ``water_spells``, shape (k, 2).
    """

    t: Array
    p: Array
    course: Array
    variance: Array
    course_is_heading: bool
    scale_sigma: float
    curvature_sigma: float
    bent_m: Array
    misalignment_sigma: float = 0.0
    disturbance_sigma: float = 0.0
    disturbance_time_s: float = 1.0
    white_sigma: float = 0.0
    current_sigma: float = 0.0
    water_spells: Array = field(default_factory=lambda: np.empty((0, 2)))

    def increments(self, t: Array) -> Increments:
        """Motion between successive times of ``t``, shape (k + 1,), rising.

        A current is one velocity over each span; that successive spans share it is not told.
        """
        p, course, variance = self._by_noise(t)
        c, s = np.cos(course[:-1]), np.sin(course[:-1])
        north, east = np.diff(p, axis=0).T
        variance = np.diff(variance, axis=0)
        variance[:, :2] += self._by_current(np.diff(self._tracked_s(t)))[:, None]
        return Increments(
            np.column_stack([c * north + s * east, c * east - s * north]),
            np.diff(course),
            variance,
            np.diff(np.interp(t, self.t, self.bent_m)),
        )

    def at(self, t: Array) -> tuple[Array, Array, Array]:
        """Position (k, 2), unwrapped course (k,) and variances (k, 3) since the first reading."""
        p, course, variance = self._by_noise(t)
        variance[:, :2] += self._by_current(self._tracked_s(t))[:, None]
        return p, course, variance

    def _by_noise(self, t: Array) -> tuple[Array, Array, Array]:
        """As `at`, without the current."""
        p, variance = (
            np.stack([np.interp(t, self.t, column) for column in columns.T], axis=1)
            for columns in (self.p, self.variance)
        )
        return p, np.interp(t, self.t, self.course), variance

    def _tracked_s(self, t: Array) -> Array:
        """For how long the water was tracked in each spell by times (k,), shape (spells, k)."""
        first, last = self.water_spells.T[:, :, None]
        return np.asarray(np.clip(t, first, last) - first)

    def _by_current(self, tracked_s: Array) -> Array:
        """Variance of the way (k,) that a current makes over so long a part of each spell."""
        return np.asarray(self.current_sigma**2 * np.square(tracked_s).sum(axis=0))


@dataclass(frozen=True)
class Speeds:
    """What measures the speed.

    Attributes
    ----------
    t : ndarray, shape (n,)
    v_level : ndarray, shape (n, 2)
        Ahead and to starboard in level axes, m/s.
    sigma : ndarray, shape (n,)
        Of their white noise.
    scale_sigma, misalignment_sigma : float
        Of the constant errors of their scale, as a share, and of their direction, rad.
    by_pings : bool
        Whether each has an error of its own, which counts for as long as it tells the speed. That
        of wheels or thrusters comes with the motion, however often it is told.
    current_sigma : float
        Of the water's motion, m/s, that they miss in the ``water_spells``, shape (k, 2).
    """

    t: Array
    v_level: Array
    sigma: Array
    scale_sigma: float
    misalignment_sigma: float
    by_pings: bool = False
    current_sigma: float = 0.0
    water_spells: Array = field(default_factory=lambda: np.empty((0, 2)))


def planar_motion(
    mission: Mission, settings: MotionSettings, *, readings_suffice: bool = False
) -> PlanarMotion | None:
    """Dead-reckon a mission in the plane; None where nothing measures its speed.

    The readings' errors are white; where wheels or a gyro are silent, with the density of their
    usual rate. Between two pings the speed walks as ``settings`` say, by ``q L^3 / 12`` over a step
    of L; wheels and a gyro follow the vehicle at their usual rate, and miss only what exceeds it,
    as pings do with ``readings_suffice``. While only the water is tracked, its motion is one
    velocity.

    Raises
    ------
    DataError
        Where nothing measures the turns.
    """
    readings = _speeds(mission, settings)
    if readings is None:
        return None
    start, stop = mission.span_s
    t, v_level, sigma_v = _held_to(readings.t, readings.v_level, readings.sigma, start, stop)
    course, course_variance, is_heading = _course(mission, t, settings)
    c, s, dt = np.cos(course), np.sin(course), np.diff(t)
    ahead, aside = v_level.T
    v = np.column_stack([c * ahead - s * aside, s * ahead + c * aside])
    steps = 0.5 * (v[1:] + v[:-1]) * dt[:, None]
    density = sigma_v**2 * (_told_s(dt) if readings.by_pings else np.median(dt))
    unseen = _silence(dt) if readings_suffice or not readings.by_pings else dt
    walk = _walk(density, dt) + settings.sigma_accel_m_s2**2 * unseen**3 / 12
    moved = _summed(walk)
    variance = np.column_stack([moved, moved, course_variance])
    compass = _compass_errors(mission) if is_heading else (0.0, 1.0, 0.0)
    driven_m = np.append(0.0, np.cumsum(0.5 * (ahead[1:] + ahead[:-1]) * dt))
    bent_m = since_heard(driven_m, _hears_compass(mission, t)) if is_heading else driven_m
    return PlanarMotion(
        t,
        _summed(steps),
        course,
        variance,
        is_heading,
        readings.scale_sigma,
        curvature_sigma(mission) if np.any(bent_m) else 0.0,
        bent_m,
        readings.misalignment_sigma,
        *compass,
        current_sigma=readings.current_sigma,
        water_spells=readings.water_spells,
    )


def _walk(density: Array, dt: Array) -> Array:
    """Variance that white noise adds up to in each step."""
    return np.asarray(0.5 * (density[1:] + density[:-1]) * dt)


def _told_s(dt: Array) -> Array:
    """For how long each reading tells the speed: half of the step on either side."""
    return np.asarray(0.5 * (np.append(0.0, dt) + np.append(dt, 0.0)))


def _silence(dt: Array) -> Array:
    """By how much each step exceeds the usual one, s."""
    return np.asarray(np.maximum(dt - np.median(dt), 0.0))


def _summed(steps: Array) -> Array:
    return np.concatenate([np.zeros_like(steps[:1]), np.cumsum(steps, axis=0)])


def _held_to(
    t: Array, v_b: Array, sigma: Array, start: float, stop: float
) -> tuple[Array, Array, Array]:
    """Readings whose first and last are held to the ends of a mission."""
    first, last = [start] if start < t[0] else [], [stop] if stop > t[-1] else []
    wide = ((len(first), len(last)), (0, 0))
    return (
        np.concatenate([first, t, last]),
        np.pad(v_b, wide, mode="edge"),
        np.pad(sigma, wide[0], mode="edge"),
    )


def _speeds(mission: Mission, settings: MotionSettings) -> Speeds | None:
    """Of the first sensor that has them."""
    for dvl in mission.of_type("dvl"):
        omega_b = angular_rate_b(mission, dvl.series.t, mean_gyro_bias_b(mission))
        found = body_velocities(dvl, omega_b, settings.water_lock_after_s)
        if len(found):
            noise = DvlNoise.model_validate(dvl.noise)
            spells = water_spells([dvl], settings.water_lock_after_s)
            return Speeds(
                found.t,
                in_level_axes(mission, found.t, found.v_b)[:, :2],
                found.sigma,
                noise.scale_sigma,
                float(np.radians(noise.misalignment_sigma_deg)),
                by_pings=True,
                current_sigma=noise.water_sigma_m_s,
                water_spells=spells,
            )
    odometry = mission.first("odometry")
    if odometry is None:
        return None
    series = odometry.series
    assert isinstance(series, OdometrySeries)
    of_wheels = OdometryNoise.model_validate(odometry.noise)
    misalignment = float(np.radians(of_wheels.misalignment_sigma_deg))
    v_b = np.column_stack([series.v_b, np.zeros(len(series))])
    v_level = in_level_axes(mission, series.t, v_b)[:, :2]
    return Speeds(series.t, v_level, series.sigma_v, of_wheels.scale_sigma, misalignment)


def _course(mission: Mission, t: Array, settings: MotionSettings) -> tuple[Array, Array, bool]:
    """Unwrapped course, summed variance, and whether it is a heading.

    A compass's error is a disturbance that comes and goes (`HeadingNoise`): as a random walk of the
    same strength. Its white noise does not add up.
    """
    headings, rates = headings_true(mission), _by_rates(mission, settings, t)
    if headings is not None and len(headings) > 1:
        disturbance, time_s, _ = _compass_errors(mission)
        course, walk = _by_compass(headings, rates, t)
        return course, 2 * disturbance**2 / time_s * (t - t[0]) + walk, True
    if rates is None:
        raise DataError(
            f"mission '{mission.name}': a DVL alone tells no turns; a compass, an IMU or odometry"
            f" does. The mission has: {', '.join(sorted(mission.sensors))}"
        )
    return np.interp(t, rates.t, rates.turned), rates.walk_at(t), False


def _hears_compass(mission: Mission, t: Array) -> BoolArray:
    """Whether a compass tells the course at times (n,)."""
    compass = mission.first("heading")
    assert compass is not None
    stamps = compass.series.t
    return TurnSource(stamps, stamps, longest_step_s(stamps)).tells(t)


def _by_compass(headings: HeadingSeries, rates: RateTurns | None, t: Array) -> tuple[Array, Array]:
    """Headings at times (n,), and what the variance of those grows by that it does not tell.

    While a compass is silent the rates turn its last reading on; its next one counts from then on.
    """
    compass = TurnSource(headings.t, np.unwrap(headings.heading), longest_step_s(headings.t))
    if rates is None:
        return np.interp(t, compass.t, compass.turned), np.zeros(len(t))
    turns = spliced(compass, rates)
    off = np.unwrap(compass.turned - np.interp(compass.t, turns.t, turns.turned))
    last = np.maximum(np.searchsorted(compass.t, t, "right") - 1, 0)
    told = compass.tells(0.5 * (t[1:] + t[:-1]))
    walk = _summed(np.where(told, 0.0, np.diff(rates.walk_at(t))))
    return np.interp(t, turns.t, turns.turned) + off[last], walk


@dataclass(frozen=True)
class RateTurns(TurnSource):
    """Turns by yaw rates, and the variance (n,) that their noise and gaps have added up to."""

    walk: Array

    def walk_at(self, t: Array) -> Array:
        """That variance at times (k,), rad^2."""
        return np.interp(t, self.t, self.walk)


def _by_rates(mission: Mission, settings: MotionSettings, t: Array) -> RateTurns | None:
    """Over the span of some times; None where nothing measures a rate."""
    rates = _yaw_rates(mission)
    if rates is None:
        return None
    longest_s = longest_step_s(rates[0])
    t_rate, rate, sigma = _held_to(rates[0], rates[1][:, None], rates[2], t[0], t[-1])
    dt = np.diff(t_rate)
    turned = _summed(0.5 * (rate[1:, 0] + rate[:-1, 0]) * dt)
    unseen = _silence(dt)
    walk = _walk(sigma**2 * np.median(dt), dt) + settings.sigma_yaw_accel_rad_s2**2 * unseen**3 / 12
    return RateTurns(t_rate, turned, longest_s, _summed(walk))


def _compass_errors(mission: Mission) -> tuple[float, float, float]:
    """Spread (rad) and correlation time (s) of the compass's slow error, and spread of its
    noise."""
    compass = mission.first("heading")
    assert compass is not None
    assert isinstance(compass.series, HeadingSeries)
    noise = HeadingNoise.model_validate(compass.noise)
    slow = float(np.radians(noise.disturbance_sigma_deg))
    return slow, noise.disturbance_time_s, float(np.median(compass.series.sigma))


def _yaw_rates(mission: Mission) -> tuple[Array, Array, Array] | None:
    """Times, rates and sigmas of whatever measures the yaw rate."""
    odometry, imu = mission.first("odometry"), mission.first("imu")
    if odometry is not None:
        assert isinstance(odometry.series, OdometrySeries)
        return odometry.series.t, odometry.series.yaw_rate, odometry.series.sigma_yaw_rate
    if imu is None:
        return None
    assert isinstance(imu.series, ImuSeries)
    t = imu.series.t
    rate = (imu.series.gyro_i @ imu.R_bs.T - mean_gyro_bias_b(mission))[:, 2]
    step_s = float(np.median(np.diff(t))) if len(t) > 1 else 1.0
    white = ImuNoise.model_validate(imu.noise).gyro_noise_density_rad_s_sqrt_hz
    return t, rate, np.full(len(t), white / np.sqrt(step_s))
