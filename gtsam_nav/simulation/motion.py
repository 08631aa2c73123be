"""The vehicle's true motion: a smooth function of time with exact derivatives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from gtsam_nav.frames import Array, rotation_from_rpy, wrap_angle
from gtsam_nav.settings import Settings
from gtsam_nav.simulation.world import World


class MotionSettings(Settings):
    """How the vehicle surveys.

    Attributes
    ----------
    speed_m_s : float
        Cruise speed; a closed course is repeated for as long as the mission lasts.
    rest_s, ramp_s : float
        Time at rest before the start, and the time to reach cruise speed (and to stop from it).
    depth_m, depth_swing_m, depth_period_s : float
        Mean depth, and its slow variation.
    roll_deg, pitch_deg, yaw_deg, heave_m : float
        Standard deviations of the motion in waves.
    wave_period_s : float
        Mean period of the waves.
    sheltered_rest : bool
        The place of rest is calm: the waves come with the speed.
    wander_accel_m_s2, wander_vertical_accel_m_s2, wander_yaw_accel_rad_s2 : float
        Densities of the white acceleration, per square root of Hz, by which the level velocity, the
        vertical one and the yaw rate wander, within `WANDER_RAD_S` and `WANDER_YAW_RAD_S`: what
        motion models take for granted. Zero is a vehicle on rails.
    """

    speed_m_s: float = Field(default=0.8, gt=0)
    rest_s: float = Field(default=10.0, ge=0)
    ramp_s: float = Field(default=8.0, gt=0)
    depth_m: float = Field(default=1.5, ge=0)
    depth_swing_m: float = Field(default=0.3, ge=0)
    depth_period_s: float = Field(default=150.0, gt=0)
    roll_deg: float = Field(default=1.2, ge=0)
    pitch_deg: float = Field(default=0.8, ge=0)
    yaw_deg: float = Field(default=0.4, ge=0)
    heave_m: float = Field(default=0.03, ge=0)
    wave_period_s: float = Field(default=4.5, gt=0)
    sheltered_rest: bool = False
    wander_accel_m_s2: float = Field(default=0.0, ge=0)
    wander_vertical_accel_m_s2: float = Field(default=0.0, ge=0)
    wander_yaw_accel_rad_s2: float = Field(default=0.0, ge=0)


WANDER_RAD_S, WANDER_YAW_RAD_S = (0.3, 30.0), (2.0, 30.0)
"""Frequencies between which a wandering vehicle's accelerations are white: slower ones would take
it off its course, faster ones no sensor follows."""
WANDER_TONES = 24


@dataclass(frozen=True)
class Kinematics:
    """The body's state at n times.

    Attributes
    ----------
    p_n, v_n, a_n : ndarray, shape (n, 3)
        Position, velocity and acceleration along NED: m, m/s, m/s^2.
    rpy : ndarray, shape (n, 3)
        Roll, pitch, yaw, rad.
    omega_nb_b : ndarray, shape (n, 3)
        Angular rate of the body against NED, along body axes, rad/s.
    """

    t: Array
    p_n: Array
    v_n: Array
    a_n: Array
    rpy: Array
    omega_nb_b: Array

    @property
    def R_nb(self) -> Array:  # noqa: N802
        """Rotations from body to NED, shape (n, 3, 3)."""
        return rotation_from_rpy(self.rpy)

    @property
    def v_b(self) -> Array:
        """Velocity along body axes, shape (n, 3), m/s."""
        return to_body(self.R_nb, self.v_n)


def to_body(R_nb: Array, vectors_n: Array) -> Array:
    """Vectors (n, 3) along NED, turned into body axes."""
    return np.asarray(np.einsum("nji,nj->ni", R_nb, vectors_n))


@dataclass(frozen=True)
class Waves:
    """Sinusoids for each of four quantities: arrays of shape (4, k)."""

    amplitude: Array
    omega: Array
    phase: Array

    def at(self, t: Array) -> tuple[Array, Array, Array]:
        """Value and first two time derivatives, each of shape (n, 4)."""
        angle = self.omega * t[:, None, None] + self.phase
        sine, cosine = np.sin(angle), np.cos(angle)
        return (
            (self.amplitude * sine).sum(2),
            (self.amplitude * self.omega * cosine).sum(2),
            -(self.amplitude * self.omega**2 * sine).sum(2),
        )


def draw_waves(settings: MotionSettings, rng: np.random.Generator) -> Waves:
    """Of roll, pitch, yaw and heave, with random phases and periods around the mean."""
    sigma = np.array(
        [*np.radians([settings.roll_deg, settings.pitch_deg, settings.yaw_deg]), settings.heave_m]
    )
    period = settings.wave_period_s * rng.uniform(0.7, 1.4, size=(4, 3))
    return Waves(
        # three sinusoids of amplitude a have the variance 3 a^2 / 2
        amplitude=np.repeat(sigma[:, None] * np.sqrt(2 / 3), 3, axis=1),
        omega=2 * np.pi / period,
        phase=rng.uniform(0, 2 * np.pi, size=(4, 3)),
    )


def draw_wander(settings: MotionSettings, rng: np.random.Generator) -> Waves:
    """Of north, east, down and yaw: bands of white acceleration, a sinusoid for each."""
    level, down = settings.wander_accel_m_s2, settings.wander_vertical_accel_m_s2
    density = np.array([level, level, down, settings.wander_yaw_accel_rad_s2])
    slowest, fastest = np.array([WANDER_RAD_S] * 3 + [WANDER_YAW_RAD_S]).T
    edges = np.geomspace(slowest, fastest, WANDER_TONES + 1, axis=1)
    width = np.diff(edges)
    omega = edges[:, :-1] + width * rng.uniform(size=(4, WANDER_TONES))
    # the variance of a white acceleration within a band is density^2 times its width over pi
    amplitude = density[:, None] * np.sqrt(2 * width / np.pi) / omega**2
    return Waves(amplitude, omega, rng.uniform(0, 2 * np.pi, size=(4, WANDER_TONES)))


class Motion:
    """The way along a world's course: `at` any time, the state with its derivatives."""

    def __init__(self, world: World, settings: MotionSettings, rng: np.random.Generator) -> None:
        from scipy.interpolate import make_interp_spline

        corners, closed = world.course.waypoints_n, world.course.closed
        if closed:
            corners = np.concatenate([corners, corners[:1]])
        chords = np.linalg.norm(np.diff(corners, axis=0), axis=1)
        way = np.concatenate([[0.0], np.cumsum(chords)])
        self.settings = settings
        self.course_m = float(way[-1])
        self.closed = closed
        self._path = make_interp_spline(way, corners, k=5, bc_type="periodic" if closed else None)
        self._waves = draw_waves(settings, rng)
        self._wander = draw_wander(settings, rng)

    def at(self, t: ArrayLike) -> Kinematics:
        """The state at times (n,), s."""
        times = np.asarray(t, dtype=float)
        way, way_rate, way_accel, way_jerk = self._progress(times)
        along = way % self.course_m if self.closed else np.minimum(way, self.course_m)
        place, tangent, bend = (self._path(along, nu) for nu in range(3))
        wave, wave_rate, wave_accel = self._waves.at(times)
        stray, stray_rate, stray_accel = self._strays(times)
        if self.settings.sheltered_rest:
            share = np.stack([way_rate, way_accel, way_jerk]) / self.settings.speed_m_s
            share = share[..., None]
            wave, wave_rate, wave_accel = _product(share, (wave, wave_rate, wave_accel))
            stray, stray_rate, stray_accel = _product(share, (stray, stray_rate, stray_accel))
        depth, depth_rate, depth_accel = self._depth(times)

        course = np.arctan2(tangent[:, 1], tangent[:, 0])
        turn = tangent[:, 0] * bend[:, 1] - tangent[:, 1] * bend[:, 0]
        course_rate = turn / (tangent**2).sum(1) * way_rate
        rpy = wave[:, :3].copy()
        rpy[:, 2] = wrap_angle(rpy[:, 2] + course + stray[:, 3])
        rpy_rate = wave_rate[:, :3].copy()
        rpy_rate[:, 2] += course_rate + stray_rate[:, 3]

        p_n = np.column_stack([place, depth + wave[:, 3]])
        v_n = np.column_stack([tangent * way_rate[:, None], depth_rate + wave_rate[:, 3]])
        acceleration = bend * way_rate[:, None] ** 2 + tangent * way_accel[:, None]
        a_n = np.column_stack([acceleration, depth_accel + wave_accel[:, 3]])
        return Kinematics(
            t=times,
            p_n=p_n + stray[:, :3],
            v_n=v_n + stray_rate[:, :3],
            a_n=a_n + stray_accel[:, :3],
            rpy=rpy,
            omega_nb_b=body_rates(rpy, rpy_rate),
        )

    def _strays(self, t: Array) -> tuple[Array, Array, Array]:
        """How far the wander takes north, east, down and yaw, with its first two derivatives."""
        if not np.any(self._wander.amplitude):
            still = np.zeros((len(t), 4))
            return still, still, still
        return self._wander.at(t)

    def _progress(self, t: Array) -> tuple[Array, Array, Array, Array]:
        """Way along the course (m) with its first three derivatives."""
        s = self.settings
        started = self._run(t - s.rest_s)
        if self.closed:
            return started
        # braking is a second run, begun when that much time is left, taken away from the first
        braked = self._run(t - s.rest_s - self.course_m / s.speed_m_s)
        way, rate, accel, jerk = (a - b for a, b in zip(started, braked, strict=True))
        return way, rate, accel, jerk

    def _run(self, t: Array) -> tuple[Array, Array, Array, Array]:
        """Way (m) with three derivatives of one who starts at t = 0 and cruises for ever."""
        s = self.settings
        x = np.clip(t / s.ramp_s, 0.0, 1.0)
        cruise = np.maximum(t - s.ramp_s, 0.0)
        way = s.speed_m_s * (s.ramp_s * x**4 * (x**2 - 3 * x + 2.5) + cruise)
        rate = s.speed_m_s * x**3 * (6 * x**2 - 15 * x + 10)
        accel = s.speed_m_s / s.ramp_s * 30 * x**2 * (1 - x) ** 2
        jerk = s.speed_m_s / s.ramp_s**2 * 60 * x * (1 - x) * (1 - 2 * x)
        return way, rate, accel, jerk

    def _depth(self, t: Array) -> tuple[Array, Array, Array]:
        """The planned depth (m) with its first two derivatives."""
        s = self.settings
        omega = 2 * np.pi / s.depth_period_s
        swing = s.depth_swing_m * np.sin(omega * t)
        rate = s.depth_swing_m * omega * np.cos(omega * t)
        return s.depth_m + swing, rate, -(omega**2) * swing


def _product(share: Array, values: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
    """Two functions' product with its first two derivatives, from those of each."""
    (a, a_rate, a_accel), (b, b_rate, b_accel) = share, values
    return a * b, a_rate * b + a * b_rate, a_accel * b + 2 * a_rate * b_rate + a * b_accel


def body_rates(rpy: Array, rpy_rate: Array) -> Array:
    """Angular rate along body axes from Euler angles and their rates, shape (n, 3), rad/s."""
    roll, pitch, _ = rpy.T
    roll_rate, pitch_rate, yaw_rate = rpy_rate.T
    cr, sr, cp, sp = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch)
    return np.column_stack(
        [
            roll_rate - yaw_rate * sp,
            pitch_rate * cr + yaw_rate * sr * cp,
            -pitch_rate * sr + yaw_rate * cr * cp,
        ]
    )
