"""The mission as factors: everything but the sonar, keyframe by keyframe."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import gtsam
import numpy as np

from gtsam_nav.config import Config
from gtsam_nav.frames import Array, rotation_from_rpy, wrap_angle
from gtsam_nav.graph import factors
from gtsam_nav.graph.factors import B, G, M, X
from gtsam_nav.graph.gauss_markov import gauss_markov
from gtsam_nav.graph.scan_matching import PlanarPose
from gtsam_nav.mission import DepthSeries, GnssSeries, ImuSeries, IntArray, Mission, Sensor
from gtsam_nav.preprocess.alignment import Alignment
from gtsam_nav.preprocess.motion import VehicleMotion
from gtsam_nav.sensors.noise import (
    DvlNoise,
    GnssNoise,
    HeadingNoise,
    ImuNoise,
    OdometryNoise,
)
from gtsam_nav.sensors.orientation import headings_true, tilt_at

VAGUE_M, VAGUE_RAD = 1e3, np.pi
"""Spread of what the sensors' own factors know better of the start."""
RECEIVER_STRIDE = 10**7
"""Apart in the numbering of GNSS errors: more keyframes than any mission has."""
UNMEASURED_TURN_RAD2_S = np.radians(3.0) ** 2
"""Growth of the variance of a turn that neither gyro nor compass saw."""
MAX_IMU_GAP_S = 0.2
"""An interval with a longer silence of the IMU is bridged by the other sensors."""


@dataclass(frozen=True)
class SensorFactor:
    """A factor with the sensor it came from."""

    sensor: str
    factor: Any


@dataclass(frozen=True)
class Displacement:
    """The measured displacement into keyframe k, and its factor."""

    k: int
    R_ab: Array
    p_a: Array
    factor: Any


@dataclass
class Problem:
    """Factors and initial values of each keyframe.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Keyframe times.
    motion : VehicleMotion
    factors : list of lists
        ``factors[k]`` are those that keyframe k brings; they refer to no later keyframe.
    uses_imu : bool
        Whether rotations come from preintegrated IMU readings or from the AHRS.
    has_compass : bool
        Whether a compass frame stands beside each keyframe.
    displacements : list of Displacement
        Those that the velocity sensor's constant errors act on.
    calibration_sigma : ndarray, shape (2,)
        Spread of these errors: scale, and misalignment about the vertical in rad.
    """

    t: Array
    motion: VehicleMotion
    factors: list[list[SensorFactor]]
    uses_imu: bool
    has_compass: bool
    gyro_bias_i: Array = field(default_factory=lambda: np.zeros(3))
    n_fixes: int = 0
    gnss_errors: dict[int, list[int]] = field(default_factory=dict)
    displacements: list[Displacement] = field(default_factory=list)
    calibration_sigma: Array = field(default_factory=lambda: np.zeros(2))

    def new_values(self, k: int) -> list[tuple[int, Any]]:
        """Keys and first values of the states that keyframe k brings, but for its own."""
        values: list[tuple[int, Any]] = []
        if self.uses_imu:
            values.append((B(k), self.bias()))
        if self.has_compass:
            values.append((M(k), gtsam.NavState()))
            if k == 0:
                values.append((M(len(self.t)), gtsam.NavState()))
        values += [(key, gtsam.NavState()) for key in self.gnss_errors.get(k, [])]
        return values

    def bias(self) -> Any:
        """Initial IMU bias, as GTSAM holds it."""
        return gtsam.imuBias.ConstantBias(np.zeros(3), self.gyro_bias_i)

    def __post_init__(self) -> None:
        self.p_n, self.rpy = self.motion.at(self.t)
        self.R_nb = rotation_from_rpy(self.rpy)
        columns = [np.interp(self.t, self.motion.t, axis) for axis in self.motion.v_b.T]
        self.v_b = np.stack(columns, axis=1)

    def initial_state(self, k: int) -> Any:
        """Keyframe k as the vehicle's own motion has it."""
        return factors.nav_state(self.R_nb[k], self.p_n[k], self.R_nb[k] @ self.v_b[k])

    def increment(self, a: int, b: int) -> tuple[Array, Array]:
        """Rotation and displacement of keyframe b in keyframe a by the vehicle's own motion."""
        R_a = self.R_nb[a]
        return R_a.T @ self.R_nb[b], R_a.T @ (self.p_n[b] - self.p_n[a])

    def planar_increment(self, a: int, b: int) -> PlanarPose:
        """Keyframe b in keyframe a by the vehicle's own motion, with its uncertainty."""
        c, s = np.cos(self.rpy[a, 2]), np.sin(self.rpy[a, 2])
        dt = self.t[b] - self.t[a]
        position = float(self.motion.displacement_variance(self.t[a], self.t[b]))
        yaw = self.motion.yaw_variance_rad2_s * dt
        ne = np.array([[c, s], [-s, c]]) @ (self.p_n[b] - self.p_n[a])[:2]
        return PlanarPose(
            ne, float(self.rpy[b, 2] - self.rpy[a, 2]), np.diag([position, position, yaw])
        )

    def add(self, k: int, sensor: str, factor: Any) -> None:
        """Let keyframe k bring one more factor."""
        self.factors[k].append(SensorFactor(sensor, factor))


def build_problem(
    mission: Mission, start: Alignment, motion: VehicleMotion, t: Array, config: Config
) -> Problem:
    """All sensor factors of a mission on given keyframe times."""
    imu = _preintegrable_imu(mission, config.graph.imu_min_rate_hz)
    headings = headings_true(mission)
    problem = Problem(
        t=t,
        motion=motion,
        factors=[[] for _ in t],
        uses_imu=imu is not None,
        has_compass=headings is not None,
        calibration_sigma=_calibration_sigma(mission),
    )
    _add_start(problem, mission, start)
    _add_increments(problem, config, imu is None and headings is None)
    if imu is not None:
        _add_imu(problem, mission, imu, config)
    else:
        _add_velocities(problem, config)
    if headings is not None:
        _add_headings(problem, mission, config)
    else:
        for k in range(len(t)):
            _add_tilt(problem, mission, k, config)
    _add_depth(problem, mission, config)
    for number, receiver in enumerate(mission.of_type("gnss")):
        _add_gnss(problem, mission, receiver, number, config)
    return problem


def _preintegrable_imu(mission: Mission, min_rate_hz: float) -> Sensor | None:
    for imu in mission.of_type("imu"):
        if len(imu.series) > 1 and np.median(np.diff(imu.series.t)) <= 1.0 / min_rate_hz:
            return imu
    return None


def _add_start(problem: Problem, mission: Mission, start: Alignment) -> None:
    # what is a factor of its own must not count twice
    sigma_rpy, sigma_p = start.sigma_rpy.copy(), start.sigma_p.copy()
    has_gnss = mission.first("gnss") is not None
    if mission.first("attitude") is not None:
        sigma_rpy[:2] = VAGUE_RAD
    if mission.initial.heading is None and (problem.has_compass or has_gnss):
        sigma_rpy[2] = VAGUE_RAD
    if has_gnss and mission.initial.p_n is None:
        sigma_p[:] = VAGUE_M
    if mission.first("depth") is not None:
        sigma_p[2] = VAGUE_M
    prior = factors.start_prior(X(0), problem.initial_state(0), start.R_nb, sigma_rpy, sigma_p)
    problem.add(0, "start", prior)


def _add_increments(problem: Problem, config: Config, yaw_by_motion: bool) -> None:
    """Displacements by DVL or odometry; their yaw too where nothing better turns the vehicle."""
    motion = problem.motion
    variance = motion.displacement_variance(problem.t[:-1], problem.t[1:])
    for k in range(1, len(problem.t)):
        dt = problem.t[k] - problem.t[k - 1]
        R_ab, p_a = problem.increment(k - 1, k)
        sigma_p = float(np.sqrt(variance[k - 1]))
        rotation = np.zeros(3)
        if yaw_by_motion:
            rotation[2] = 1.0 / (motion.yaw_variance_rad2_s * dt)
        factor = factors.increment(
            X(k - 1), X(k), R_ab, p_a, rotation, sigma_p, config.graph.huber_k
        )
        problem.add(k, "velocity", factor)
        problem.displacements.append(Displacement(k, R_ab, p_a, factor))


def _calibration_sigma(mission: Mission) -> Array:
    """Spread of scale and misalignment of whichever sensor measures the velocity."""
    dvl, odometry = mission.first("dvl"), mission.first("odometry")
    noise: DvlNoise | OdometryNoise
    if dvl is not None:
        noise = DvlNoise.model_validate(dvl.noise)
    else:
        noise = OdometryNoise.model_validate(odometry.noise if odometry else {})
    return np.array([noise.scale_sigma, np.radians(noise.misalignment_sigma_deg)])


def _add_velocities(problem: Problem, config: Config) -> None:
    """Velocity of each keyframe, which without an IMU touches nothing else."""
    motion = problem.motion
    for k, t in enumerate(problem.t):
        sigma = float(np.interp(t, motion.t, motion.sigma_v))
        factor = factors.velocity(X(k), problem.v_b[k], sigma, config.graph.huber_k)
        problem.add(k, "velocity", factor)


def _add_imu(problem: Problem, mission: Mission, imu: Sensor, config: Config) -> None:
    """Preintegrated readings between keyframes, and the random walk of their bias."""
    series = imu.series
    assert isinstance(series, ImuSeries)
    noise = ImuNoise.model_validate(imu.noise)
    problem.gyro_bias_i = imu.R_bs.T @ problem.motion.gyro_bias_b
    parameters = factors.imu_parameters(imu, mission.origin)
    bias = problem.bias()
    spread = np.r_[[noise.accel_bias_sigma_m_s2] * 3, [noise.gyro_bias_sigma_rad_s] * 3]
    prior = gtsam.PriorFactorConstantBias(
        B(0), gtsam.imuBias.ConstantBias(), gtsam.noiseModel.Diagonal.Sigmas(spread)
    )
    problem.add(0, "imu", prior)
    walk = np.r_[
        [noise.accel_bias_walk_m_s3_sqrt_hz] * 3, [noise.gyro_bias_walk_rad_s2_sqrt_hz] * 3
    ]
    for k in range(1, len(problem.t)):
        from_s, to_s = float(problem.t[k - 1]), float(problem.t[k])
        steady = gtsam.noiseModel.Diagonal.Sigmas(walk * np.sqrt(to_s - from_s))
        link = gtsam.BetweenFactorConstantBias(B(k - 1), B(k), gtsam.imuBias.ConstantBias(), steady)
        problem.add(k, "imu", link)
        if _covered(series, from_s, to_s):
            pim = factors.preintegrate(series, parameters, bias, from_s, to_s)
            problem.add(k, "imu", gtsam.ImuFactor2(X(k - 1), X(k), B(k - 1), pim))
        else:
            _bridge_imu_gap(problem, k, config.graph.huber_k)


def _covered(imu: ImuSeries, from_s: float, to_s: float) -> bool:
    inside = imu.t[np.searchsorted(imu.t, from_s) : np.searchsorted(imu.t, to_s)]
    marks = np.concatenate([[from_s], inside, [to_s]])
    return bool(np.max(np.diff(marks)) <= MAX_IMU_GAP_S)


def _bridge_imu_gap(problem: Problem, k: int, huber_k: float) -> None:
    """Without inertial readings the velocity comes from the motion's own smoothed one."""
    sigma = float(np.interp(problem.t[k], problem.motion.t, problem.motion.sigma_v))
    factor = factors.velocity(X(k), problem.v_b[k], sigma, huber_k)
    problem.add(k, "velocity", factor)
    _add_unmeasured_turn(problem, k)


def _add_headings(problem: Problem, mission: Mission, config: Config) -> None:
    """AHRS orientation at each keyframe, its slow heading bias a compass frame of its own.

    The bias is a constant plus a Gauss-Markov disturbance.
    """
    sensor = mission.first("heading")
    assert sensor is not None
    noise = HeadingNoise.model_validate(sensor.noise)
    R_measured, sigma_yaw = _averaged_orientations(problem, mission)
    _, sigma_tilt = tilt_at(mission, problem.t)
    constant = M(len(problem.t))
    problem.add(0, "heading", factors.compass_prior(constant, np.radians(noise.bias_sigma_deg)))
    spread = float(np.radians(max(noise.disturbance_sigma_deg, 1e-3)))
    disturbance = gauss_markov(problem.t, spread, noise.disturbance_time_s)
    for k in range(len(problem.t)):
        problem.add(k, "heading", factors.compass_pin(M(k)))
        problem.add(k, "heading", factors.compass_link(constant, M(k), disturbance.tie[k]))
        if k:
            link = factors.compass_link(M(k - 1), M(k), disturbance.link[k - 1])
            problem.add(k, "heading", link)
        if np.isfinite(sigma_yaw[k]):
            sigmas = np.array([sigma_tilt[k], sigma_tilt[k], sigma_yaw[k]])
            factor = factors.orientation(M(k), X(k), R_measured[k], sigmas, config.graph.huber_k)
            problem.add(k, "heading", factor)
        else:
            _add_tilt(problem, mission, k, config)
            _add_unmeasured_turn(problem, k)


def _add_unmeasured_turn(problem: Problem, k: int) -> None:
    """Ties the yaw of a keyframe without a reading loosely to its neighbours'."""
    for a, b in ((k - 1, k), (k, k + 1)):
        if a >= 0 and b < len(problem.t):
            R_ab, _ = problem.increment(a, b)
            precision = 1.0 / (UNMEASURED_TURN_RAD2_S * (problem.t[b] - problem.t[a]))
            problem.add(b, "heading", factors.turn(X(a), X(b), R_ab, precision))


def _averaged_orientations(problem: Problem, mission: Mission) -> tuple[Array, Array]:
    """AHRS orientation at each keyframe from the readings nearest to it.

    The readings are carried to the keyframe by the vehicle's own turn; half before, half after,
    so that a gyro's bias cancels. Keyframes without a reading get an infinite sigma.
    """
    headings = headings_true(mission)
    assert headings is not None
    _, rpy = problem.motion.at(problem.t)
    edges = 0.5 * (problem.t[1:] + problem.t[:-1])
    owner = np.searchsorted(edges, headings.t, side="right")
    turned = problem.motion.at(headings.t)[1][:, 2] - rpy[owner, 2]
    difference = wrap_angle(headings.heading - turned - rpy[owner, 2])
    count = np.bincount(owner, minlength=len(problem.t))
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = np.bincount(owner, difference, minlength=len(problem.t)) / count
        sigma = np.sqrt(np.bincount(owner, headings.sigma**2, minlength=len(problem.t))) / count
    yaw = rpy[:, 2] + np.where(count > 0, mean, 0.0)
    R_measured = rotation_from_rpy(np.column_stack([rpy[:, :2], yaw]))
    return R_measured, np.where(count > 0, sigma, np.inf)


def _add_tilt(problem: Problem, mission: Mission, k: int, config: Config) -> None:
    """Roll and pitch of a keyframe without a heading."""
    tilt, sigma = tilt_at(mission, problem.t[k : k + 1])
    rpy = np.array([*tilt[0], 0.0])
    problem.add(k, "attitude", factors.tilt(X(k), rpy, float(sigma[0]), config.graph.huber_k))


def _add_depth(problem: Problem, mission: Mission, config: Config) -> None:
    sensor = mission.first("depth")
    if sensor is None:
        return
    series = sensor.series
    assert isinstance(series, DepthSeries)
    for k, t in enumerate(problem.t):
        depth_m = float(np.interp(t, series.t, series.depth_m))
        sigma = float(np.interp(t, series.t, series.sigma))
        factor = factors.depth(X(k), depth_m, sensor.xyz_b, sigma, config.graph.huber_k)
        problem.add(k, sensor.name, factor)


def _add_gnss(
    problem: Problem, mission: Mission, gnss: Sensor, number: int, config: Config
) -> None:
    """Each fix at the keyframe nearest in time, carried there by the vehicle's own motion.

    Where the card says that fixes share an error, that error is a state of its own: a Gauss-Markov
    sequence over the keyframes with fixes. The lever arm is then turned by the motion's attitude.
    """
    fixes = _fixes_at_keyframes(problem, gnss)
    noise = GnssNoise.model_validate(gnss.noise)
    sigma = np.sqrt(fixes.sigma**2 * (1 - noise.correlated_share) + fixes.carried_variance[:, None])
    if mission.first("depth") is not None and not config.gnss.use_height:
        sigma[:, 2] = np.inf
    if noise.correlated_share > 0:
        _add_shared_gnss_error(problem, gnss.name, number, fixes, noise)
    for k, p_n, arm_n, s in zip(
        fixes.keyframe.tolist(), fixes.p_n, fixes.arm_n, sigma, strict=True
    ):
        if noise.correlated_share > 0:
            factor = factors.gnss_with_error(
                _error_key(number, k), X(k), p_n - arm_n, s, config.gnss.huber_k
            )
        else:
            factor = factors.gnss(X(k), p_n, gnss.xyz_b, s, config.gnss.huber_k)
        problem.add(k, gnss.name, factor)
    problem.n_fixes += len(fixes.keyframe)


@dataclass(frozen=True)
class _Fixes:
    """Fixes moved in time to the nearest keyframe: antenna positions and the arm to them."""

    keyframe: IntArray
    p_n: Array
    arm_n: Array
    sigma: Array
    carried_variance: Array


def _fixes_at_keyframes(problem: Problem, gnss: Sensor) -> _Fixes:
    series = gnss.series
    assert isinstance(series, GnssSeries)
    series = series.select((series.t >= problem.t[0]) & (series.t <= problem.t[-1]))
    nearest = np.searchsorted(0.5 * (problem.t[1:] + problem.t[:-1]), series.t, side="right")
    p_fix, rpy_fix = problem.motion.at(series.t)
    p_key, rpy_key = problem.motion.at(problem.t[nearest])
    arm_n = rotation_from_rpy(rpy_key) @ gnss.xyz_b
    arm_moved = rotation_from_rpy(rpy_fix) @ gnss.xyz_b - arm_n
    return _Fixes(
        keyframe=nearest,
        p_n=series.p_n - (p_fix - p_key) - arm_moved,
        arm_n=arm_n,
        sigma=series.sigma,
        carried_variance=problem.motion.displacement_variance(series.t, problem.t[nearest]),
    )


def _error_key(receiver: int, k: int) -> int:
    """Key of a receiver's shared error at keyframe k."""
    return int(G(receiver * RECEIVER_STRIDE + k))


def _add_shared_gnss_error(
    problem: Problem, name: str, number: int, fixes: _Fixes, noise: GnssNoise
) -> None:
    keyframes = np.unique(fixes.keyframe)
    sigma = float(np.median(fixes.sigma[:, :2])) * np.sqrt(noise.correlated_share)
    shared = gauss_markov(problem.t[keyframes], sigma, noise.correlation_time_s)
    for i, k in enumerate(keyframes.tolist()):
        key = _error_key(number, k)
        problem.add(k, name, factors.gnss_error_prior(key, float(shared.tie[i])))
        if i:
            previous = _error_key(number, int(keyframes[i - 1]))
            link = factors.gnss_error_link(previous, key, float(shared.link[i - 1]))
            problem.add(k, name, link)
        problem.gnss_errors.setdefault(k, []).append(key)
