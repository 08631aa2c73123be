"""What is known without a sensor, as measurements: rest, the level, wheels that do not slip."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gtsam_nav.config import Config
from gtsam_nav.ekf.aid import Aid
from gtsam_nav.ekf.inertial_start import InertialStart
from gtsam_nav.ekf.strapdown import ACCEL_BIAS, GYRO_BIAS, SIZE, THETA, InertialState, Strapdown
from gtsam_nav.frames import Array, skew
from gtsam_nav.mission import Mission
from gtsam_nav.preprocess.rest import SPELL_S, Rest, Spells
from gtsam_nav.preprocess.stated_rest import stated_rests
from gtsam_nav.sensors import motion_constraints
from gtsam_nav.sensors.prediction import Prediction

NONHOLONOMIC = "nonholonomic"
NONHOLONOMIC_RATE_HZ = 5.0
"""A slip lasts: constraints at the IMU's own rate would claim to know better."""


def constraints_on(
    mission: Mission, strapdown: Strapdown, start: InertialStart, config: Config
) -> Iterator[Aid]:
    """Constraints that the mission or the configuration states, and those of a start at rest.

    A vehicle whose position and velocity nothing measures is taken to begin at rest where its IMU
    is quiet at first: no pure inertial navigation begins otherwise.
    """
    motion, gate = config.motion, config.ins_ekf.gate_probability
    imu = mission.first("imu")
    assert imu is not None

    if mission.constraints.nonholonomic:
        yield _nonholonomic(mission, motion.nonholonomic_sigma_m_s, gate)
    spells, _ = stated_rests(mission, motion)
    if spells is None and start.rest is not None and not _aided(mission):
        spells = start.rest.spells
    if spells is not None:
        yield _still(spells, motion.zero_velocity_sigma_m_s, gate, mission)
        yield _not_turning(spells, strapdown, gate)
    elif start.rest is not None:
        if mission.first("attitude") is None:
            yield _level(start.state, start.rest, strapdown)
        if start.gyrocompass:
            yield _not_turning(start.rest.spells, strapdown, gate)


def _aided(mission: Mission) -> bool:
    return any(mission.first(kind) for kind in ("gnss", "dvl", "odometry"))


def _nonholonomic(mission: Mission, sigma: float, gate: float) -> Aid:
    t = np.arange(*mission.span_s, 1.0 / NONHOLONOMIC_RATE_HZ)

    def straight(_k: int, state: InertialState, _shared: Array) -> Prediction:
        return motion_constraints.nonholonomic(state.body, sigma)

    return Aid(NONHOLONOMIC, "body velocity", 2, t, np.arange(len(t)), straight, gate)


def _still(spells: Spells, sigma: float, gate: float, mission: Mission) -> Aid:
    """Rest; only in the horizontal where a gauge measures the depth, for a quiet dive is quiet."""
    level_only = mission.first("depth") is not None

    def rest(_k: int, state: InertialState, _shared: Array) -> Prediction:
        if level_only:
            return motion_constraints.zero_horizontal_velocity(state.body, sigma)
        return motion_constraints.zero_velocity(state.body, sigma)

    size = 2 if level_only else 3
    row = np.arange(len(spells.t))
    return Aid("zero velocity", "body velocity", size, spells.t, row, rest, gate)


def _not_turning(spells: Spells, strapdown: Strapdown, gate: float) -> Aid:
    """The gyro's mean over a spell at rest is its bias and the Earth's rate."""
    noise = strapdown.noise.gyro_noise_density_rad_s_sqrt_hz / np.sqrt(SPELL_S)
    sigma = np.maximum(noise, spells.rate_b.std(axis=0) if len(spells.t) > 1 else np.zeros(3))
    earth_n = np.zeros(3) if strapdown.level is None else strapdown.level.earth_rate_n

    def rate(k: int, state: InertialState, _shared: Array) -> Prediction:
        earth_b = state.body.R_nb.T @ earth_n
        jacobian = np.zeros((3, SIZE))
        jacobian[:, THETA], jacobian[:, GYRO_BIAS] = skew(earth_b), np.eye(3)
        return Prediction(
            state.gyro_bias_b + earth_b - spells.rate_b[k], jacobian, np.diag(sigma**2)
        )

    return Aid("zero rate", "gyro bias", 3, spells.t, np.arange(len(spells.t)), rate, gate)


def _level(start: InertialState, rest: Rest, strapdown: Strapdown) -> Aid:
    """The specific force of a vehicle at rest is gravity's reaction and the bias."""
    gravity_n = strapdown.gravity_n(start.p_n)

    def force(_k: int, state: InertialState, _shared: Array) -> Prediction:
        pull_b = state.body.R_nb.T @ gravity_n
        jacobian = np.zeros((3, SIZE))
        jacobian[:, THETA], jacobian[:, ACCEL_BIAS] = -skew(pull_b), np.eye(3)
        return Prediction(
            state.accel_bias_b - pull_b - rest.force_b, jacobian, np.diag(rest.sigma_force**2)
        )

    t = np.maximum(start.t, rest.spells.t[:1] - SPELL_S)
    return Aid("level", "tilt", 3, t, np.zeros(1, dtype=np.int64), force, None)
