"""Each sensor as native GTSAM factors on NavState keyframes.

Each function states its residual, which a conformance test compares with ``sensors``' predictions.
Zero precision leaves a row unobserved. No factor calls back into Python: such a factor is handed a
copy of all values at each evaluation, which makes the solve quadratic in the mission's length.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import cache, lru_cache
from typing import Any

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, G, L, M, S, X

from gtsam_nav.frames import Array, rotation_from_rpy, skew
from gtsam_nav.graph.robust import KernelName, Robustness
from gtsam_nav.registration.result import RelativePose
from gtsam_nav.sensors.orientation import covariance_b

KEPT_NOISES = 100
"""Of a kind: most factors share theirs with others."""

Several = tuple[Any, ...]

# symbols of IMU bias, GNSS error, landmark, compass frame, range scale and keyframe
__all__ = ["B", "G", "L", "M", "S", "X"]


def precisions(values: Any) -> Any:
    """Diagonal noise with the given precisions (inverse variances)."""
    return gtsam.noiseModel.Diagonal.Precisions(np.asarray(values, dtype=float))


def m_estimator(robustness: Robustness) -> Any:
    """GTSAM's m-estimator of that kernel; None for least squares."""
    return _m_estimator(robustness.kernel, robustness.scale)


@cache
def _m_estimator(kernel: KernelName, scale: float) -> Any:
    estimators = gtsam.noiseModel.mEstimator
    match kernel:
        case "none":
            return None
        case "huber":
            return estimators.Huber.Create(scale)
        case "cauchy":
            return estimators.Cauchy.Create(scale)
        case "geman_mcclure":
            return estimators.GemanMcClure.Create(scale)
        case "dcs":
            # its scale is that of the squared residual
            return estimators.DCS.Create(scale**2)
        case "tukey":
            return estimators.Tukey.Create(scale)
        case "tls":
            return estimators.TruncatedLeastSquares.Create(scale)


def weight(robustness: Robustness, whitened: float) -> float:
    """What a kernel leaves of the information of a residual of this whitened norm."""
    kernel = m_estimator(robustness)
    return 1.0 if kernel is None else float(kernel.weight(whitened))


def robust(factor: Any, robustness: Robustness) -> Any:
    """The factor under a kernel."""
    if robustness.kernel == "none":
        return factor
    if isinstance(factor, LinearFactor):
        return factor.weighed(robustness)
    noise = gtsam.noiseModel.Robust.Create(m_estimator(robustness), factor.noiseModel())
    return factor.cloneWithNewNoiseModel(noise)


def nav_state(R_nb: Array, p_n: Array, v_n: Array) -> Any:
    """A GTSAM NavState."""
    return gtsam.NavState(gtsam.Rot3(R_nb), p_n, v_n)


def parts(states: Iterable[Any]) -> tuple[Array, Array, Array]:
    """Attitudes (n, 3, 3), positions and velocities (n, 3) of NavStates: three cost as much as one
    where each is asked alone."""
    whole = np.array([state.matrix() for state in states]).reshape(-1, 5, 5)
    return whole[:, :3, :3], whole[:, :3, 3], whole[:, :3, 4]


def moved(before: Any, R_ab: Array, p_a: Array, v_b: Array) -> Any:
    """The NavState at a pose in another one's axes, with a velocity along its own."""
    pose = before.pose().compose(gtsam.Pose3(gtsam.Rot3(R_ab), p_a))
    return gtsam.NavState(pose, pose.rotation().matrix() @ v_b)


_UPRIGHT, _STILL = gtsam.Rot3(), np.zeros(3)
_ORIGIN = gtsam.NavState()
_DOWN = gtsam.Unit3(np.array([0.0, 0.0, 1.0]))


def displaced(p_n: Array) -> Any:
    """A NavState that is nothing but a place."""
    return gtsam.NavState(_UPRIGHT, p_n, _STILL)


def insert(values: Any, key: int, state: Any) -> None:
    """A NavState or IMU bias into GTSAM's values.

    By the argument's name: without it, all 43 kinds of values before these are tried in turn.
    """
    if isinstance(state, gtsam.NavState):
        values.insert(key, nav_state=state)
    else:
        values.insert(key, constant_bias=state)


def start_prior(
    key: int, state: Any, R_nb: Array, sigma_rpy: Array, sigma_p: Array, sigma_v: float
) -> Any:
    """Prior on attitude, position (both covariances along n) and velocity."""
    cov = np.zeros((9, 9))
    cov[:3, :3] = covariance_b(R_nb, sigma_rpy)
    cov[3:6, 3:6] = R_nb.T @ np.diag(sigma_p**2) @ R_nb
    cov[6:, 6:] = sigma_v**2 * np.eye(3)
    return gtsam.PriorFactorNavState(key, state, gtsam.noiseModel.Gaussian.Covariance(cov))


@lru_cache(maxsize=KEPT_NOISES)
def _velocity_noise(forward: float, across: float) -> Any:
    """By sigmas; an infinite one is unobserved."""
    return precisions([*[0] * 6, 1 / forward**2, 1 / across**2, 1 / across**2])


def velocity(key: int, v_b: Array, sigma: float) -> Any:
    """Body velocity: ``R_nb' v_n - v_b``."""
    measured = np.zeros(9)
    measured[6:] = v_b
    noise = _velocity_noise(sigma, sigma)
    return gtsam.ExtendedPriorFactorNavState(key, _ORIGIN, measured, noise)


def position_prior(key: int, p_n: Array, sigma: Array) -> Any:
    """Position of the body: ``p_n - measured``."""
    return gtsam.GPSFactor2(key, p_n, precisions(1 / np.asarray(sigma) ** 2))


def nonholonomic(key: int, sigma: float) -> Any:
    """Neither sideways nor up: the last two components of ``R_nb' v_n``."""
    noise = _velocity_noise(math.inf, sigma)
    return gtsam.ExtendedPriorFactorNavState(key, _ORIGIN, np.zeros(9), noise)


def no_turn(a: int, b: int, sigma: float) -> Any:
    """The same attitude at both keyframes."""
    noise = precisions([1 / sigma**2] * 3 + [0] * 6)
    return gtsam.BetweenFactorNavState(a, b, gtsam.NavState(), noise)


def no_gain(a: int, b: int, sigma: Array) -> Any:
    """The same velocity at both keyframes; sigma is along the axes of the first one's body."""
    noise = precisions([*[0] * 6, *(1 / np.asarray(sigma) ** 2)])
    return gtsam.BetweenFactorNavState(a, b, gtsam.NavState(), noise)


def increment(
    a: int,
    b: int,
    R_ab: Array,
    p_a: Array,
    rotation_precisions: Array,
    sigma_p: Array,
    bends: bool,
) -> Any:
    """Motion from keyframe a to b, its sigmas along the axes at b, and rotation if known.

    ``R_ab' (R_a' (p_b - p_a) - p_ab)``; where it bends, less ``e x R_ab' p_ab / 2``, with
    ``e = Log(R_ab' R_a' R_b)``, what the estimate turns further than the measured motion did: the
    way goes with it. A gyro's bias makes such an error evenly, and white noise does so in the mean.
    """
    root = np.zeros((9, 9))
    root[:3, :3] = np.diag(np.sqrt(rotation_precisions))
    root[3:6, 3:6] = np.diag(1.0 / sigma_p)
    if bends:
        root[3:6, :3] = 0.5 / sigma_p[:, None] * skew(R_ab.T @ p_a)
    noise = gtsam.noiseModel.Gaussian.SqrtInformation(root, False)
    measured = nav_state(R_ab, p_a, np.zeros(3))
    return gtsam.BetweenFactorNavState(a, b, measured, noise)


def turn(a: int, b: int, R_ab: Array, precision: float) -> Any:
    """Yaw from keyframe a to b, and nothing else."""
    return _rotation(a, b, R_ab, [0, 0, precision])


def tilting(a: int, b: int, R_ab: Array, precision: float) -> Any:
    """Roll and pitch from keyframe a to b, and nothing else."""
    return _rotation(a, b, R_ab, [precision, precision, 0])


def _rotation(a: int, b: int, R_ab: Array, about_axes: list[float]) -> Any:
    noise = precisions([*about_axes, *[0] * 6])
    return gtsam.BetweenFactorNavState(a, b, nav_state(R_ab, np.zeros(3), np.zeros(3)), noise)


@lru_cache(maxsize=KEPT_NOISES)
def _depth_noise(sigma: float) -> Any:
    return precisions([0, 0, 1 / sigma**2])


def depth(key: int, depth_m: float, lever_b: Array, sigma: float) -> Any:
    """Depth: ``d + (R_nb lever_b)_d - depth``."""
    place_n = np.array([0.0, 0.0, depth_m])
    return gtsam.GPSFactor2Arm(key, place_n, lever_b, _depth_noise(sigma))


def gnss(key: int, p_n: Array, lever_b: Array, sigma: Array) -> Any:
    """Antenna position: ``p_n + R_nb lever_b - measured``; an infinite sigma is unobserved."""
    return gtsam.GPSFactor2Arm(key, p_n, lever_b, precisions(1 / np.asarray(sigma) ** 2))


def gnss_with_error(
    error: int, key: int, p_n: Array, arm_b: Array, R_nb: Array, sigma: Array
) -> Any:
    """Antenna position by GNSS with a shared error: ``p_n + R_nb arm_b - error_n - measured``.

    The arm turns to first order about the present attitude ``R_nb``. An infinite sigma (of n, e, d)
    is unobserved. The residual's axes stay: in axes that turned with the body, each residual would
    seem to tell the yaw by its own noise.
    """
    root = np.zeros((9, 9))
    root[3:6, 3:6] = R_nb / np.asarray(sigma)[:, None]
    root[3:6, :3] = -root[3:6, 3:6] @ skew(arm_b)
    noise = gtsam.noiseModel.Gaussian.SqrtInformation(root, False)
    measured = nav_state(R_nb, p_n - R_nb @ arm_b, np.zeros(3))
    return gtsam.BetweenFactorNavState(error, key, measured, noise)


def gnss_velocity(key: int, state: Any, v_n: Array, turning_b: Array, sigma: Array) -> Any:
    """Antenna velocity: ``v_n + R_nb (omega x lever) - measured``, about the present state.

    ``turning_b`` is the product; an infinite sigma (of n, e, d) is unobserved.
    """
    across = np.asarray(sigma)[:, None]
    R_nb = state.attitude().matrix()
    jacobian = np.zeros((3, 9))
    jacobian[:, :3], jacobian[:, 6:] = -R_nb @ skew(turning_b) / across, R_nb / across
    residual = (state.velocity() + R_nb @ turning_b - v_n) / sigma
    return LinearFactor((key,), (state,), (jacobian,), residual)


def _against_compass(compass: int | None, key: int, R_measured: Array, noise: Any) -> Any:
    """``Log(R_measured' Rz(bias)' R_nb)``, the bias being the yaw of a compass frame, if any."""
    measured = nav_state(R_measured, np.zeros(3), np.zeros(3))
    if compass is None:
        return gtsam.PriorFactorNavState(key, measured, noise)
    return gtsam.BetweenFactorNavState(compass, key, measured, noise)


def orientation(compass: int | None, key: int, R_measured: Array, sigma_rpy: Array) -> Any:
    """AHRS: the whole orientation against the measured one and the compass's bias."""
    root = np.zeros((9, 9))
    root[:3, :3] = np.linalg.cholesky(np.linalg.inv(covariance_b(R_measured, sigma_rpy))).T
    noise = gtsam.noiseModel.Gaussian.SqrtInformation(root, False)
    return _against_compass(compass, key, R_measured, noise)


def heading(compass: int | None, key: int, heading_rad: float, R_nb: Array, sigma: float) -> Any:
    """Heading alone: yaw less bias and reading, where roll and pitch are those of ``R_nb``."""
    turn = heading_rad - np.arctan2(R_nb[1, 0], R_nb[0, 0])
    c, s = np.cos(turn), np.sin(turn)
    R_measured = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ R_nb
    root = np.zeros((9, 9))
    # how yaw follows from small turns of the body
    root[0, 1:3] = R_nb[2, 1:] / (R_nb[2, 1:] @ R_nb[2, 1:] * sigma)
    noise = gtsam.noiseModel.Gaussian.SqrtInformation(root, False)
    return _against_compass(compass, key, R_measured, noise)


class LinearFactor(gtsam.LinearContainerFactor):
    """A factor on up to three states, linear about their present values.

    Parameters
    ----------
    keys, states : tuples
        The states and their values, NavStates all.
    jacobians : tuple of ndarrays, shape (m, 9)
        Of the whitened residual, in their tangents.
    residual : ndarray, shape (m,)
        Whitened, at these values.
    """

    def __init__(self, keys: Several, states: Several, jacobians: Several, residual: Array) -> None:
        self._parts, self._residual = (keys, states, jacobians), residual
        values = gtsam.Values()
        for key, state in zip(keys, states, strict=True):
            insert(values, key, state)
        unit = gtsam.noiseModel.Unit.Create(len(residual))
        blocks = (part for of_one in zip(keys, jacobians, strict=True) for part in of_one)
        linear: Any = gtsam.JacobianFactor  # its stubs count the blocks
        super().__init__(linear(*blocks, -residual, unit), values)

    def whitenedError(self, values: Any) -> Array:  # noqa: N802
        """The whitened residual at other values, as native factors tell theirs."""
        _, b = self.linearize(values).jacobian()
        return np.asarray(-b)

    def weighed(self, robustness: Robustness) -> LinearFactor:
        """The same with the weight that a kernel gives it where it was made."""
        keys, states, jacobians = self._parts
        root = float(np.sqrt(weight(robustness, float(np.linalg.norm(self._residual)))))
        return LinearFactor(keys, states, tuple(root * J for J in jacobians), root * self._residual)


@lru_cache(maxsize=KEPT_NOISES)
def _tilt_noise(sigma: float) -> Any:
    return gtsam.noiseModel.Isotropic.Sigma(2, sigma)


def tilt(key: int, rpy: Array, sigma: float) -> Any:
    """Roll and pitch as the direction of down in body axes; yaw stays free."""
    roll, pitch = float(rpy[0]), float(rpy[1])
    level = math.cos(pitch)
    down_b = (-math.sin(pitch), math.sin(roll) * level, math.cos(roll) * level)
    measured = gtsam.Unit3(np.array(down_b))
    return gtsam.AttitudeFactorNavState(key, _DOWN, _tilt_noise(sigma), measured)


def planar_match(a: int, b: int, q: Array, cov: Array) -> Any:
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
    return gtsam.BetweenFactorNavState(a, b, measured, noise)


def relative_pose(a: int, b: int, pose: RelativePose) -> Any:
    """Pose of b in a: ``Log(R_ab' R_a' R_b)`` and ``R_ab' (R_a' (p_b - p_a) - p_ab)``."""
    root = np.zeros((9, 9))
    root[:6, :6] = np.linalg.cholesky(np.linalg.inv(pose.cov)).T
    noise = gtsam.noiseModel.Gaussian.SqrtInformation(root, False)
    measured = nav_state(pose.R_ab, pose.p_a, np.zeros(3))
    return gtsam.BetweenFactorNavState(a, b, measured, noise)


def stated_pose(a: int, b: int, R_ab: Array, p_a: Array, root: Array) -> Any:
    """The same by a square root (6, 6) of its information, turn first, which may lack rows."""
    whole = np.zeros((9, 9))
    whole[:6, :6] = root
    noise = gtsam.noiseModel.Gaussian.SqrtInformation(whole, False)
    return gtsam.BetweenFactorNavState(a, b, nav_state(R_ab, p_a, np.zeros(3)), noise)
