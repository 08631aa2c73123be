"""Each sensor as native GTSAM factors on NavState keyframes.

Each function states its residual, which a conformance test compares with ``sensors``' predictions.
Zero precision leaves a row unobserved. No factor calls back into Python: such a factor is handed a
copy of all values at each evaluation, which makes the solve quadratic in the mission's length.
"""

from __future__ import annotations

from typing import Any

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, G, M, X

from gtsam_nav.frames import Array, Origin, earth_rate_n, gravity_m_s2, rotation_from_rpy
from gtsam_nav.mission import ImuSeries, Sensor
from gtsam_nav.sensors.noise import ImuNoise

STANDARD_GRAVITY_M_S2 = 9.80665
PIN_PRECISION = 1e8
"""Precision that holds the meaningless components of a compass or GNSS-error frame."""

__all__ = ["B", "G", "M", "X"]  # symbols of IMU bias, GNSS error, compass frame and keyframe


def precisions(values: Any) -> Any:
    """Diagonal noise with the given precisions (inverse variances)."""
    return gtsam.noiseModel.Diagonal.Precisions(np.asarray(values, dtype=float))


def huber(k: float, noise: Any) -> Any:
    """The noise under a Huber kernel."""
    return gtsam.noiseModel.Robust.Create(gtsam.noiseModel.mEstimator.Huber.Create(k), noise)


def cauchy(k: float, noise: Any) -> Any:
    """The noise under a Cauchy kernel."""
    return gtsam.noiseModel.Robust.Create(gtsam.noiseModel.mEstimator.Cauchy.Create(k), noise)


def nav_state(R_nb: Array, p_n: Array, v_n: Array) -> Any:
    """A GTSAM NavState."""
    return gtsam.NavState(gtsam.Rot3(R_nb), p_n, v_n)


def start_prior(key: int, state: Any, R_nb: Array, sigma_rpy: Array, sigma_p: Array) -> Any:
    """Prior on attitude, position (its covariance along n) and a vague velocity."""
    cov = np.zeros((9, 9))
    cov[:3, :3] = np.diag(sigma_rpy**2)
    cov[3:6, 3:6] = R_nb.T @ np.diag(sigma_p**2) @ R_nb
    cov[6:, 6:] = np.eye(3)
    return gtsam.PriorFactorNavState(key, state, gtsam.noiseModel.Gaussian.Covariance(cov))


def velocity(key: int, v_b: Array, sigma: float, huber_k: float) -> Any:
    """Body velocity: ``R_nb' v_n - v_b``."""
    noise = precisions([0] * 6 + [1 / sigma**2] * 3)
    measured = np.r_[np.zeros(6), v_b]
    return gtsam.ExtendedPriorFactorNavState(key, gtsam.NavState(), measured, huber(huber_k, noise))


def increment(
    a: int, b: int, R_ab: Array, p_a: Array, rotation_precisions: Array, sigma_p: float, k: float
) -> Any:
    """Motion from keyframe a to b: ``R_ab' (R_a' (p_b - p_a) - p_ab)``, and rotation if known."""
    noise = precisions([*rotation_precisions, *[1 / sigma_p**2] * 3, 0, 0, 0])
    measured = nav_state(R_ab, p_a, np.zeros(3))
    return gtsam.BetweenFactorNavState(a, b, measured, huber(k, noise))


def turn(a: int, b: int, R_ab: Array, precision: float) -> Any:
    """Yaw from keyframe a to b, and nothing else."""
    noise = precisions([0, 0, precision, *[0] * 6])
    return gtsam.BetweenFactorNavState(a, b, nav_state(R_ab, np.zeros(3), np.zeros(3)), noise)


def depth(key: int, depth_m: float, lever_b: Array, sigma: float, huber_k: float) -> Any:
    """Depth: ``d + (R_nb lever_b)_d - depth``."""
    noise = huber(huber_k, precisions([0, 0, 1 / sigma**2]))
    return gtsam.GPSFactor2Arm(key, np.array([0.0, 0.0, depth_m]), lever_b, noise)


def gnss(key: int, p_n: Array, lever_b: Array, sigma: Array, huber_k: float) -> Any:
    """Antenna position: ``p_n + R_nb lever_b - measured``; an infinite sigma is unobserved."""
    noise = huber(huber_k, precisions(1 / np.asarray(sigma) ** 2))
    return gtsam.GPSFactor2Arm(key, p_n, lever_b, noise)


def gnss_with_error(error: int, key: int, p_n: Array, sigma: Array, huber_k: float) -> Any:
    """Body position by GNSS with a shared error: ``p_n - error_n - measured``."""
    noise = huber(huber_k, precisions([0, 0, 0, *(1 / np.asarray(sigma) ** 2), 0, 0, 0]))
    measured = nav_state(np.eye(3), p_n, np.zeros(3))
    return gtsam.BetweenFactorNavState(error, key, measured, noise)


def gnss_error_prior(key: int, precision: float) -> Any:
    """A shared GNSS error about zero: a frame of which only the position means anything."""
    noise = precisions([PIN_PRECISION] * 3 + [precision] * 3 + [PIN_PRECISION] * 3)
    return gtsam.PriorFactorNavState(key, gtsam.NavState(), noise)


def gnss_error_link(a: int, b: int, precision: float) -> Any:
    """Keeps two shared GNSS errors together."""
    noise = precisions([0] * 3 + [precision] * 3 + [0] * 3)
    return gtsam.BetweenFactorNavState(a, b, gtsam.NavState(), noise)


def orientation(compass: int, key: int, R_measured: Array, sigma_rpy: Array, huber_k: float) -> Any:
    """AHRS: ``Log(R_measured' Rz(bias)' R_nb)``, the bias being the yaw of a compass frame."""
    noise = huber(huber_k, precisions([*(1 / np.asarray(sigma_rpy) ** 2), *[0] * 6]))
    measured = nav_state(R_measured, np.zeros(3), np.zeros(3))
    return gtsam.BetweenFactorNavState(compass, key, measured, noise)


def tilt(key: int, rpy: Array, sigma: float, huber_k: float) -> Any:
    """Roll and pitch as the direction of down in body axes; yaw stays free."""
    down = gtsam.Unit3(np.array([0.0, 0.0, 1.0]))
    measured = gtsam.Unit3(rotation_from_rpy(rpy)[2])
    noise = huber(huber_k, gtsam.noiseModel.Isotropic.Sigma(2, sigma))
    return gtsam.AttitudeFactorNavState(key, down, noise, measured)


def compass_prior(key: int, sigma: float) -> Any:
    """A compass frame: all but its yaw pinned to the navigation frame."""
    pins = [PIN_PRECISION, PIN_PRECISION, 1 / sigma**2 if sigma > 0 else PIN_PRECISION]
    return gtsam.PriorFactorNavState(key, gtsam.NavState(), precisions(pins + [PIN_PRECISION] * 6))


def compass_link(a: int, b: int, yaw_precision: float) -> Any:
    """Keeps the yaws of two compass frames together."""
    noise = precisions([0, 0, yaw_precision, *[0] * 6])
    return gtsam.BetweenFactorNavState(a, b, gtsam.NavState(), noise)


def compass_pin(key: int) -> Any:
    """Pins all but the yaw of a compass frame, which `compass_link` then governs."""
    noise = precisions([PIN_PRECISION, PIN_PRECISION, 0.0] + [PIN_PRECISION] * 6)
    return gtsam.PriorFactorNavState(key, gtsam.NavState(), noise)


def planar_match(a: int, b: int, q: Array, cov: Array, cauchy_k: float) -> Any:
    """Scan match: x, y and yaw of b in a; depth, roll, pitch and velocity stay free."""
    R_ab = rotation_from_rpy([0.0, 0.0, q[2]])
    # the native residual is R_ab' (predicted - measured): turn the information into its axes
    turn = np.eye(3)
    turn[:2, :2] = R_ab[:2, :2]
    information = turn.T @ np.linalg.inv(cov) @ turn
    root = np.zeros((3, 9))
    root[:, [3, 4, 2]] = np.linalg.cholesky(information).T
    measured = nav_state(R_ab, np.array([q[0], q[1], 0.0]), np.zeros(3))
    noise = gtsam.noiseModel.Gaussian.SqrtInformation(np.vstack([root, np.zeros((6, 9))]), False)
    return gtsam.BetweenFactorNavState(a, b, measured, cauchy(cauchy_k, noise))


def imu_parameters(imu: Sensor, origin: Origin | None) -> Any:
    """Preintegration parameters: mounting, noise, gravity; Earth rate where the place is known."""
    noise = ImuNoise.model_validate(imu.noise)
    gravity = (
        STANDARD_GRAVITY_M_S2
        if origin is None
        else gravity_m_s2(origin.latitude_deg, origin.height_m)
    )
    parameters = gtsam.PreintegrationParams.MakeSharedD(gravity)
    parameters.setGyroscopeCovariance(noise.gyro_noise_density_rad_s_sqrt_hz**2 * np.eye(3))
    parameters.setAccelerometerCovariance(noise.accel_noise_density_m_s2_sqrt_hz**2 * np.eye(3))
    parameters.setIntegrationCovariance(1e-10 * np.eye(3))
    parameters.setBodyPSensor(gtsam.Pose3(gtsam.Rot3(imu.R_bs), imu.xyz_b))
    if origin is not None:
        parameters.setOmegaCoriolis(earth_rate_n(origin.latitude_deg))
    return parameters


def preintegrate(imu: ImuSeries, parameters: Any, bias: Any, from_s: float, to_s: float) -> Any:
    """Preintegrated readings between two times; each reading holds until the next."""
    pim = gtsam.PreintegratedImuMeasurements(parameters, bias)
    first = max(int(np.searchsorted(imu.t, from_s, side="right")) - 1, 0)
    last = int(np.searchsorted(imu.t, to_s, side="left"))
    edges = np.clip(np.append(imu.t[first:last], to_s), from_s, to_s)
    edges[0] = from_s
    for accel, gyro, dt in zip(
        imu.accel_i[first:last], imu.gyro_i[first:last], np.diff(edges), strict=True
    ):
        if dt > 0:
            pim.integrateMeasurement(accel, gyro, dt)
    return pim
