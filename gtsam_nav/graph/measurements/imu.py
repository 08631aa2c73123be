"""Inertial readings, preintegrated between keyframes, and the random walk of their biases."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import gtsam
import numpy as np

from gtsam_nav.config import Config
from gtsam_nav.frames import Array
from gtsam_nav.graph import factors
from gtsam_nav.graph.coasting import CoastingStep
from gtsam_nav.graph.factors import B, X
from gtsam_nav.graph.measurements.orientation import (
    add_tilt,
    add_unmeasured_turn,
    turn_growth_rad2_s,
)
from gtsam_nav.graph.measurements.velocity import add_velocity
from gtsam_nav.graph.preintegration import InertialStep, Readings, imu_parameters
from gtsam_nav.graph.problem import Problem
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.preprocess.alignment import Alignment
from gtsam_nav.preprocess.motion import VehicleMotion, measures_velocity, vehicle_motion
from gtsam_nav.preprocess.strapdown import gravity_at
from gtsam_nav.sensors.noise import ImuNoise
from gtsam_nav.sensors.orientation import UNMEASURED_TILT_SIGMA_RAD, measures_tilt_at
from gtsam_nav.sensors.silences import silent_spells
from gtsam_nav.series import BoolArray, ImuSeries

MAX_IMU_GAP_S = 0.2
"""An interval with a longer silence of the IMU is bridged."""
HABIT_S = 1.0
"""How long a manoeuvre that a silent IMU misses lasts."""


def preintegrable(mission: Mission, min_rate_hz: float) -> Sensor | None:
    """The first IMU that samples fast enough, or at all where nothing else tells the velocity."""
    # stamps are rounded
    longest_s = 1.01 / min_rate_hz if measures_velocity(mission) else np.inf
    for imu in mission.of_type("imu"):
        if len(imu.series) > 1 and np.median(np.diff(imu.series.t)) <= longest_s:
            return imu
    return None


def own_motion(mission: Mission, start: Alignment, config: Config) -> VehicleMotion:
    """Dead-reckoned beside the IMU that is preintegrated, if any."""
    fast_imu = preintegrable(mission, config.graph.imu_min_rate_hz)
    return vehicle_motion(mission, start, config.motion, fast_imu)


def silences(imu: ImuSeries, from_s: float, to_s: float) -> Array:
    """First and last moment of each silence of an IMU within a span, shape (k, 2)."""
    return silent_spells(imu.t, from_s, to_s, MAX_IMU_GAP_S)


def add(problem: Problem, mission: Mission, config: Config) -> None:
    """Preintegrated readings; where the IMU fell silent the other sensors, or constant velocity."""
    imu = preintegrable(mission, config.graph.imu_min_rate_hz)
    if imu is None:
        return
    series = imu.series
    assert isinstance(series, ImuSeries)
    problem.bias = gtsam.imuBias.ConstantBias(np.zeros(3), imu.R_bs.T @ problem.motion.gyro_bias_b)
    _add_biases(problem, imu)
    samples = _samples(imu)
    gravity_n = gravity_at(problem.p_n, mission.origin)
    parameters = imu_parameters(imu, mission.origin)
    walking = None
    if config.graph.imu_preintegration == "combined":
        walking = imu_parameters(imu, mission.origin, combined=True)
    covered = _covered(series, problem.t, MAX_IMU_GAP_S)
    carries_tilt = _covered(series, problem.t, HABIT_S)
    has_tilt = measures_tilt_at(mission, problem.t)
    growth = turn_growth_rad2_s(mission, problem.t, config.motion)
    turning2 = _turning_density2(imu)
    for k in range(1, len(problem.t)):
        before_s, t_s = problem.t[k - 1 : k + 1].tolist()
        if covered[k - 1]:
            g_n = gravity_n[k - 1]
            problem.steps[k] = InertialStep(
                k,
                problem.bias,
                parameters(g_n),
                partial(samples.between, before_s, t_s),
                t_s - before_s,
                walking=walking and walking(g_n),
            )
        elif problem.measures_velocity:
            add_velocity(problem, k, config)
            add_unmeasured_turn(problem, k, growth)
            if not has_tilt[k]:
                _add_tilting(problem, k, turning2)
            if not has_tilt[k] and not carries_tilt[k - 1]:
                tilt = problem.rpy[k, :2]
                add_tilt(problem, mission, k, tilt, UNMEASURED_TILT_SIGMA_RAD, config)
        else:
            problem.steps[k] = _coasting(problem, k, gravity_n[k - 1], imu)
    instead = "the other sensors carry on" if problem.measures_velocity else "constant velocity"
    for a, b in silences(series, problem.t[0], problem.t[-1]):
        problem.warnings.append(
            f"the IMU '{imu.name}' is silent from {a:.1f} s to {b:.1f} s: {instead}"
        )


def _add_biases(problem: Problem, imu: Sensor) -> None:
    noise = ImuNoise.model_validate(imu.noise)
    spread = np.r_[[noise.accel_bias_sigma_m_s2] * 3, [noise.gyro_bias_sigma_rad_s] * 3]
    zero = gtsam.imuBias.ConstantBias()
    prior = gtsam.PriorFactorConstantBias(B(0), zero, gtsam.noiseModel.Diagonal.Sigmas(spread))
    problem.add(0, "imu", prior)
    problem.add_variable(0, B(0), problem.bias)
    walk = np.r_[
        [noise.accel_bias_walk_m_s3_sqrt_hz] * 3, [noise.gyro_bias_walk_rad_s2_sqrt_hz] * 3
    ]
    for k in range(1, len(problem.t)):
        steady = gtsam.noiseModel.Diagonal.Sigmas(walk * np.sqrt(problem.t[k] - problem.t[k - 1]))
        problem.add(k, "imu", gtsam.BetweenFactorConstantBias(B(k - 1), B(k), zero, steady))
        problem.add_variable(k, B(k), problem.bias)


@dataclass(frozen=True)
class _Samples:
    """Times (n,), specific forces (n, 3) and rates (n, 3) of an IMU, in its axes."""

    t: Array
    accel: Array
    gyro: Array

    def between(self, from_s: float, to_s: float) -> Readings:
        """What they say of a stretch of time: linear between samples, the first and last held."""
        inside = slice(np.searchsorted(self.t, from_s, "right"), np.searchsorted(self.t, to_s))
        ends = np.array([from_s, to_s])
        t = np.concatenate([ends[:1], self.t[inside], ends[1:]])
        before = np.clip(np.searchsorted(self.t, ends, "right") - 1, 0, len(self.t) - 2)
        span_s = self.t[before + 1] - self.t[before]
        share = np.clip((ends - self.t[before]) / span_s, 0.0, 1.0)[:, None]

        def means(samples: Array) -> Array:
            first, last = (1 - share) * samples[before] + share * samples[before + 1]
            at = np.vstack([first, samples[inside], last])
            return np.asarray(0.5 * (at[1:] + at[:-1]))

        return Readings(means(self.accel), means(self.gyro), np.diff(t))


def _samples(imu: Sensor) -> _Samples:
    """GTSAM knows the lever arm's centripetal force; its Euler force is taken off here."""
    series = imu.series
    assert isinstance(series, ImuSeries)
    accel_i = series.accel_i
    if np.any(imu.xyz_b):
        arm_i = imu.R_bs.T @ imu.xyz_b
        accel_i = accel_i - np.cross(np.gradient(series.gyro_i, series.t, axis=0), arm_i)
    return _Samples(series.t, accel_i, series.gyro_i)


def _covered(imu: ImuSeries, t_key: Array, longest_s: float) -> BoolArray:
    """Which intervals between keyframes hold no longer silence."""
    covered = np.ones(len(t_key) - 1, dtype=bool)
    for a, b in silent_spells(imu.t, t_key[0], t_key[-1], longest_s):
        covered[(t_key[:-1] < b) & (t_key[1:] > a)] = False
    return covered


def _add_tilting(problem: Problem, k: int, density2: float) -> None:
    """Roll and pitch change by no more than noise of this squared density, rad^2/s."""
    span_s = float(problem.t[k] - problem.t[k - 1])
    R_ab, _ = problem.increments
    tilting = factors.tilting(X(k - 1), X(k), R_ab[k - 1], 1.0 / (density2 * span_s))
    problem.add(k, "attitude", tilting)


def _coasting(problem: Problem, k: int, gravity_n: Array, imu: Sensor) -> CoastingStep:
    """Constant velocity and attitude, as uncertain as this vehicle's habits make them."""
    series = imu.series
    assert isinstance(series, ImuSeries)
    parameters = gtsam.PreintegrationParams(gravity_n)
    noise = ImuNoise.model_validate(imu.noise)
    for readings, density, set_covariance in (
        (
            series.accel_i,
            noise.accel_noise_density_m_s2_sqrt_hz,
            parameters.setAccelerometerCovariance,
        ),
        (series.gyro_i, noise.gyro_noise_density_rad_s_sqrt_hz, parameters.setGyroscopeCovariance),
    ):
        set_covariance(_habit_density2(series.t, readings, density) * np.eye(3))
    parameters.setIntegrationCovariance(1e-10 * np.eye(3))
    span_s = float(problem.t[k] - problem.t[k - 1])
    return CoastingStep(k, parameters, -problem.R_nb[k - 1].T @ gravity_n, span_s)


def _turning_density2(imu: Sensor) -> float:
    """That of the turns which a silent IMU misses, rad^2/s."""
    series = imu.series
    assert isinstance(series, ImuSeries)
    noise = ImuNoise.model_validate(imu.noise)
    return _habit_density2(series.t, series.gyro_i, noise.gyro_noise_density_rad_s_sqrt_hz)


def _habit_density2(t: Array, readings: Array, density: float) -> float:
    """Squared density of the noise that stands for what silent readings of this density miss."""
    # a vehicle at rest has no habits: no surer than the readings would be
    return max(2 * HABIT_S * _habit(t, readings), density**2)


def _habit(t: Array, readings: Array) -> float:
    """Variance of the readings of a mission over a second, the largest of the axes."""
    _, which, count = np.unique((t / HABIT_S).astype(int), return_inverse=True, return_counts=True)
    means = [np.bincount(which, axis) / count for axis in readings.T]
    return float(max(np.var(axis) for axis in means))
