"""Attitude and heading reference: roll, pitch and heading as one orientation.

Heading readings carry a slowly varying bias (magnetic surroundings). The orientation that is
measured is ``Rz(bias)' R_nb``: the estimators that know the bias as a state pass it in.
"""

from __future__ import annotations

import numpy as np

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array, rotation_from_rpy, wrap_angle
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.sensors.declination import declination_deg
from gtsam_nav.sensors.noise import HeadingNoise
from gtsam_nav.sensors.prediction import BodyState, Prediction
from gtsam_nav.sensors.silences import speaks_at
from gtsam_nav.series import AttitudeSeries, BoolArray, HeadingSeries

UNMEASURED_TILT_SIGMA_RAD = np.radians(10.0)
"""Roll and pitch of a mission that does not measure them: a vehicle that is stable in both."""


def predict(
    state: BodyState, R_measured: Array, heading_bias: float, sigma_rpy: Array
) -> Prediction:
    """Orientation against a state: ``Log(R_measured' Rz(bias)' R_nb)`` in body axes."""
    from scipy.spatial.transform import Rotation

    R_bias = rotation_from_rpy([0.0, 0.0, heading_bias])
    residual = Rotation.from_matrix(R_measured.T @ R_bias.T @ state.R_nb).as_rotvec()
    jacobian = np.zeros((3, 9))
    jacobian[:, :3] = _inverse_right_jacobian(residual)
    return Prediction(residual, jacobian, covariance_b(R_measured, sigma_rpy))


def covariance_b(R_nb: Array, sigma_rpy: Array) -> Array:
    """Of an orientation's error in body axes: roll and pitch, alike, are wrong about level axes,
    yaw is about the vertical."""
    return np.asarray(R_nb.T @ np.diag(np.asarray(sigma_rpy) ** 2) @ R_nb)


def _inverse_right_jacobian(phi: Array) -> Array:
    """Of SO(3): Forster et al. 2017, equation (9)."""
    from gtsam_nav.frames import skew

    angle = float(np.linalg.norm(phi))
    if angle < 1e-6:
        return np.eye(3) + 0.5 * skew(phi)
    S = skew(phi)
    factor = 1 / angle**2 - (1 + np.cos(angle)) / (2 * angle * np.sin(angle))
    return np.asarray(np.eye(3) + 0.5 * S + factor * S @ S)


def predict_heading(
    state: BodyState, heading: float, heading_bias: float, sigma: float
) -> Prediction:
    """Heading alone against a state: the yaw of ``Rz(bias)' R_nb`` less the reading, wrapped."""
    forward, right, down = state.R_nb[:2].T
    residual = wrap_angle([np.arctan2(forward[1], forward[0]) - heading_bias - heading])
    # a turn about y lifts the bow by -down, one about z swings it by right
    across = np.array([-forward[1], forward[0]]) / (forward @ forward)
    jacobian = np.zeros((1, 9))
    jacobian[0, 1], jacobian[0, 2] = -across @ down, across @ right
    return Prediction(residual, jacobian, np.array([[sigma**2]]))


def predict_tilt(state: BodyState, roll: float, pitch: float, sigma: float) -> Prediction:
    """Roll and pitch alone against a state, wrapped."""
    lift, right, down = state.R_nb[2]
    level2 = right**2 + down**2
    residual = wrap_angle([np.arctan2(right, down) - roll, np.arcsin(-lift) - pitch])
    jacobian = np.zeros((2, 9))
    jacobian[0, :3] = [1.0, -lift * right / level2, -lift * down / level2]
    jacobian[1, 1:3] = np.array([down, -right]) / np.sqrt(level2)
    return Prediction(residual, jacobian, sigma**2 * np.eye(2))


def headings_true(mission: Mission) -> HeadingSeries | None:
    """Headings of the body from true north, declination applied; None without a compass.

    Raises
    ------
    DataError
        Where magnetic headings come from an unknown place or date.
    """
    sensor = mission.first("heading")
    if sensor is None:
        return None
    series = sensor.series
    assert isinstance(series, HeadingSeries)
    declination = np.radians(_declination_deg(mission, sensor))
    if declination == 0.0:
        return series
    return HeadingSeries(
        t=series.t, row=series.row, heading=series.heading + declination, sigma=series.sigma
    )


def _declination_deg(mission: Mission, compass: Sensor) -> float:
    """As the card states it, or by the model."""
    noise = HeadingNoise.model_validate(compass.noise)
    if not noise.magnetic:
        return noise.declination_deg
    if mission.origin is None or mission.start_utc is None:
        raise DataError(
            f"the headings of '{compass.name}' are magnetic: true north needs the mission's origin"
            " and start_utc, or declination_deg"
        )
    return declination_deg(mission.origin, mission.start_utc)


def tilt_at(mission: Mission, t: Array) -> tuple[Array, Array]:
    """Unwrapped roll and pitch at given times, (n, 2) rad, and their sigma (n,), rad."""
    sensor = mission.first("attitude")
    if sensor is None:
        return np.zeros((len(t), 2)), np.full(len(t), UNMEASURED_TILT_SIGMA_RAD)
    series = sensor.series
    assert isinstance(series, AttitudeSeries)
    angles = np.unwrap(series.roll), series.pitch
    tilt = np.stack([np.interp(t, series.t, a) for a in angles], axis=1)
    sigma = np.interp(t, series.t, series.sigma)
    return tilt, np.where(speaks_at(sensor, mission, t), sigma, UNMEASURED_TILT_SIGMA_RAD)


def measures_tilt_at(mission: Mission, t: Array) -> BoolArray:
    """At which times (n,) an AHRS tells roll and pitch."""
    sensor = mission.first("attitude")
    return np.zeros(len(t), dtype=bool) if sensor is None else speaks_at(sensor, mission, t)


def level_attitudes(mission: Mission, t: Array) -> Array:
    """Attitudes (n, 3, 3) at given times against level axes of the same yaw."""
    tilt, _ = tilt_at(mission, t)
    return rotation_from_rpy(np.column_stack([tilt, np.zeros(len(t))]))


def in_level_axes(mission: Mission, t: Array, v_b: Array) -> Array:
    """Body velocities (n, 3) at given times in axes of the same yaw that are level."""
    return np.asarray(np.einsum("nij,nj->ni", level_attitudes(mission, t), v_b))
