"""The navigation sensors: true motion in, samples with their stated noise out."""

from __future__ import annotations

import numpy as np

from gtsam_nav.frames import (
    Array,
    rotation_from_rpy,
    wrap_angle,
)
from gtsam_nav.mission import Sensor
from gtsam_nav.series import (
    AttitudeSeries,
    DepthSeries,
    DvlSeries,
    GnssSeries,
    HeadingSeries,
    ImuSeries,
    LandmarkSeries,
    OdometrySeries,
    ReferenceSeries,
)
from gtsam_nav.simulation.inertia import ideal_imu
from gtsam_nav.simulation.motion import Kinematics, Motion, to_body
from gtsam_nav.simulation.processes import bursts, correlation_time_s, gauss_markov, random_walk
from gtsam_nav.simulation.settings import (
    AttitudeSimulation,
    DepthSimulation,
    DvlSimulation,
    GnssSimulation,
    HeadingSimulation,
    ImuSimulation,
    LandmarkSimulation,
    OdometrySimulation,
)
from gtsam_nav.simulation.world import World


def sample_times(rng: np.random.Generator, duration_s: float, rate_hz: float) -> Array:
    """Times of a sensor that samples at a fixed rate and was started at random."""
    return np.arange(rng.uniform(0, 1 / rate_hz), duration_s, 1 / rate_hz)


def point_velocity_b(truth: Kinematics, xyz_b: Array) -> Array:
    """Velocity of a point of the body along body axes, shape (n, 3), m/s."""
    return truth.v_b + np.cross(truth.omega_nb_b, xyz_b)


def imu(
    motion: Motion, world: World, duration_s: float, s: ImuSimulation, rng: np.random.Generator
) -> Sensor:
    """Inertial unit; it samples from time zero on."""
    t = np.arange(0.0, duration_s, 1 / s.rate_hz)
    gyro_b, accel_b = ideal_imu(motion.at(t), world.origin, flat=world.flat)

    def error(density: float, walk: float, bias: float) -> Array:
        white = rng.normal(scale=density * np.sqrt(s.rate_hz), size=(len(t), 3))
        turn_on = rng.normal(scale=bias, size=3)
        return white + turn_on + random_walk(rng, len(t), 1 / s.rate_hz, walk, 3)

    gyro_error = error(
        s.gyro_noise_density_rad_s_sqrt_hz, s.gyro_bias_walk_rad_s2_sqrt_hz, s.gyro_bias_sigma_rad_s
    )
    accel_error = error(
        s.accel_noise_density_m_s2_sqrt_hz, s.accel_bias_walk_m_s3_sqrt_hz, s.accel_bias_sigma_m_s2
    )
    return Sensor(
        name="imu",
        type="imu",
        series=ImuSeries(t=t, gyro_i=gyro_b + gyro_error, accel_i=accel_b + accel_error),
        noise=s.model_dump(exclude={"rate_hz"}),
    )


def dvl(motion: Motion, duration_s: float, s: DvlSimulation, rng: np.random.Generator) -> Sensor:
    """Doppler log with bursts without bottom lock, some of which hold water lock."""
    t = sample_times(rng, duration_s, s.rate_hz)
    n, truth = len(t), motion.at(t)
    xyz_b = np.array(s.xyz_m)
    scale = 1 + rng.normal(scale=s.scale_sigma)
    misalignment = np.radians(rng.normal(scale=s.misalignment_sigma_deg))
    lost, mark = bursts(rng, t, s.dropouts_per_min, s.dropout_mean_s)
    water_lock = lost & (mark < s.water_lock_share)
    noise = rng.normal(scale=s.sigma_m_s, size=(n, 3))
    water_n = np.zeros((n, 3))
    water_n[:, :2] = gauss_markov(rng, n, 1 / s.rate_hz, s.water_sigma_m_s, s.water_time_s, 2)

    v_b = point_velocity_b(truth, xyz_b)
    v_b[water_lock] -= to_body(truth.R_nb, water_n)[water_lock]
    rpy = np.radians(s.rpy_deg)
    true_R_bd = rotation_from_rpy(rpy + np.array([0.0, 0.0, misalignment]))
    v_d = scale * v_b @ true_R_bd + noise
    valid = ~lost | water_lock
    v_d[~valid] = 0.0
    return Sensor(
        name="dvl",
        type="dvl",
        series=DvlSeries(
            t=t, v_d=v_d, sigma=np.full(n, s.sigma_m_s), valid=valid, bottom_lock=~lost
        ),
        xyz_b=xyz_b,
        R_bs=rotation_from_rpy(rpy),
        noise={
            "sigma_m_s": s.sigma_m_s,
            "water_sigma_m_s": s.water_sigma_m_s,
            "scale_sigma": s.scale_sigma,
            "misalignment_sigma_deg": s.misalignment_sigma_deg,
        },
    )


def wall_disturbance(world: World, p_n: Array, s: HeadingSimulation) -> Array:
    """How far the steel in the walls turns a compass at positions (n, 3), shape (n,), rad."""
    reinforcement = np.array([w.reinforcement for w in world.walls])
    nearness = np.exp(-world.wall_distances(p_n[:, :2]) / s.wall_decay_m)
    return np.asarray(np.radians(s.wall_peak_deg) * nearness @ reinforcement)


def heading(
    motion: Motion, world: World, duration_s: float, s: HeadingSimulation, rng: np.random.Generator
) -> Sensor:
    """AHRS heading: white noise, a constant bias, and what slowly disturbs it."""
    t = sample_times(rng, duration_s, s.rate_hz)
    n, truth = len(t), motion.at(t)
    bias = np.radians(rng.normal(scale=s.bias_sigma_deg))
    white = rng.normal(scale=np.radians(s.sigma_deg), size=n)
    drift_sigma = np.radians(s.drift_sigma_deg)
    drift = gauss_markov(rng, n, 1 / s.rate_hz, drift_sigma, s.drift_time_s, 1)[:, 0]
    walls = wall_disturbance(world, truth.p_n, s)
    measured = truth.rpy[:, 2] + bias + white + drift + walls
    sigma_deg, time_s = _stated_disturbance(walls, s)
    return Sensor(
        name="heading",
        type="heading",
        series=HeadingSeries(
            t=t, heading=wrap_angle(measured), sigma=np.full(n, np.radians(s.sigma_deg))
        ),
        noise={
            "sigma_deg": s.sigma_deg,
            "bias_sigma_deg": s.bias_sigma_deg,
            "disturbance_sigma_deg": sigma_deg,
            "disturbance_time_s": time_s,
            # walls change smoothly along the way
            "disturbance_smooth": s.wall_peak_deg > 0,
        },
    )


def _stated_disturbance(walls: Array, s: HeadingSimulation) -> tuple[float, float]:
    """Spread (deg) and correlation time (s) that a survey of the disturbance would report."""
    if s.wall_peak_deg == 0:
        return s.drift_sigma_deg, s.drift_time_s
    wall_deg = float(np.degrees(np.sqrt(np.mean(walls**2))))
    return (
        round(float(np.hypot(wall_deg, s.drift_sigma_deg)), 2),
        round(correlation_time_s(walls, 1 / s.rate_hz), 1),
    )


def attitude(
    motion: Motion, duration_s: float, s: AttitudeSimulation, rng: np.random.Generator
) -> Sensor:
    """AHRS roll and pitch."""
    t = sample_times(rng, duration_s, s.rate_hz)
    sigma = np.radians(s.sigma_deg)
    roll, pitch = (motion.at(t).rpy[:, :2] + rng.normal(scale=sigma, size=(len(t), 2))).T
    return Sensor(
        name="attitude",
        type="attitude",
        series=AttitudeSeries(t=t, roll=roll, pitch=pitch, sigma=np.full(len(t), sigma)),
        noise={"sigma_deg": s.sigma_deg, "bias_sigma_deg": 0.0, "disturbance_sigma_deg": 0.0},
    )


def depth(
    motion: Motion, duration_s: float, s: DepthSimulation, rng: np.random.Generator
) -> Sensor:
    """Pressure gauge at the body's origin."""
    t = sample_times(rng, duration_s, s.rate_hz)
    measured = motion.at(t).p_n[:, 2] + rng.normal(scale=s.sigma_m, size=len(t))
    return Sensor(
        name="depth",
        type="depth",
        series=DepthSeries(t=t, depth_m=measured, sigma=np.full(len(t), s.sigma_m)),
        noise={"sigma_m": s.sigma_m},
    )


def gnss(motion: Motion, duration_s: float, s: GnssSimulation, rng: np.random.Generator) -> Sensor:
    """Fixes of the antenna; ``sigma`` states white and drifting error together."""
    t = sample_times(rng, duration_s, s.rate_hz)
    n, truth = len(t), motion.at(t)
    xyz_b = np.array(s.xyz_m)
    axes = np.array([1.0, 1.0, 2.0])
    white = rng.normal(scale=s.sigma_white_m, size=(n, 3))
    drift = gauss_markov(rng, n, 1 / s.rate_hz, s.sigma_drift_m, s.drift_time_s, 3)
    jump = rng.normal(scale=s.outlier_sigma_m, size=(n, 3))
    jump[rng.uniform(size=n) >= s.outlier_share] = 0.0
    sigma = float(np.hypot(s.sigma_white_m, s.sigma_drift_m)) * axes
    noise = {
        "sigma_horizontal_m": float(sigma[0]),
        "sigma_vertical_m": float(sigma[2]),
        "correlated_share": s.sigma_drift_m**2 / (s.sigma_white_m**2 + s.sigma_drift_m**2),
        "correlation_time_s": s.drift_time_s,
    }
    v_n = None
    if s.sigma_velocity_m_s is not None:
        v_b = point_velocity_b(truth, xyz_b)
        v_n = np.einsum("nij,nj->ni", truth.R_nb, v_b)
        v_n += rng.normal(scale=s.sigma_velocity_m_s, size=(n, 3))
        noise["sigma_velocity_m_s"] = s.sigma_velocity_m_s
    return Sensor(
        name="gnss",
        type="gnss",
        series=GnssSeries(
            t=t,
            p_n=truth.p_n + truth.R_nb @ xyz_b + axes * (white + drift + jump),
            sigma=np.tile(sigma, (n, 1)),
            v_n=v_n,
        ),
        xyz_b=xyz_b,
        noise=noise,
    )


def odometry(
    motion: Motion, duration_s: float, s: OdometrySimulation, rng: np.random.Generator
) -> Sensor:
    """Speeds and yaw rate that a model of the thrusters predicts."""
    t = sample_times(rng, duration_s, s.rate_hz)
    n, truth = len(t), motion.at(t)
    scale = 1 + rng.normal(scale=s.scale_sigma)
    return Sensor(
        name="odometry",
        type="odometry",
        series=OdometrySeries(
            t=t,
            v_b=scale * truth.v_b[:, :2] + rng.normal(scale=s.sigma_v_m_s, size=(n, 2)),
            yaw_rate=truth.omega_nb_b[:, 2] + rng.normal(scale=s.sigma_yaw_rate_rad_s, size=n),
            sigma_v=np.full(n, s.sigma_v_m_s),
            sigma_yaw_rate=np.full(n, s.sigma_yaw_rate_rad_s),
        ),
        noise={
            "sigma_v_m_s": s.sigma_v_m_s,
            "sigma_yaw_rate_rad_s": s.sigma_yaw_rate_rad_s,
            "scale_sigma": s.scale_sigma,
            "misalignment_sigma_deg": 0.0,
            "curvature_sigma_deg_m": 0.0,
            "slip_sigma": 0.0,
        },
    )


def landmarks(
    motion: Motion, world: World, duration_s: float, s: LandmarkSimulation, rng: np.random.Generator
) -> Sensor:
    """Range and bearing to the landmarks in view."""
    t = sample_times(rng, duration_s, s.rate_hz)
    truth = motion.at(t)
    offset_n = world.landmarks_n - truth.p_n[:, None]
    range_m = np.linalg.norm(offset_n, axis=2)
    offset_b = np.einsum("nji,nkj->nki", truth.R_nb, offset_n)
    bearing = np.arctan2(offset_b[..., 1], offset_b[..., 0])
    sigma_bearing = np.radians(s.sigma_bearing_deg)
    measured_m = np.abs(range_m + rng.normal(scale=_range_sigma(range_m, s)))
    bearing_noise = rng.normal(scale=sigma_bearing, size=range_m.shape)
    seen = (range_m < s.max_range_m) & (rng.uniform(size=range_m.shape) < s.detection_share)
    if s.only_at_rest:
        seen &= np.linalg.norm(truth.v_n, axis=1)[:, None] < 1e-3
    elevation = None
    if s.elevation:
        exact = np.arctan2(-offset_b[..., 2], np.hypot(offset_b[..., 0], offset_b[..., 1]))
        elevation = (exact + rng.normal(scale=sigma_bearing, size=range_m.shape))[seen]
    sample, landmark = np.nonzero(seen)
    sigma_range = _range_sigma(measured_m[seen], s)
    return Sensor(
        name="landmarks",
        type="landmarks",
        series=LandmarkSeries(
            t=t[sample],
            id=world.landmark_id[landmark],
            range_m=measured_m[seen],
            bearing=wrap_angle(bearing + bearing_noise)[seen],
            elevation=elevation,
            sigma_range=sigma_range,
            sigma_bearing=np.full(len(sample), sigma_bearing),
        ),
        noise={
            "sigma_range_m": float(np.median(sigma_range)) if len(sample) else s.sigma_range_m,
            "sigma_bearing_deg": s.sigma_bearing_deg,
        },
    )


def _range_sigma(range_m: Array, s: LandmarkSimulation) -> Array:
    """Standard deviation of the range's error at ranges of any shape, m."""
    return np.hypot(s.sigma_range_m, s.sigma_range_share * range_m)


def reference(motion: Motion, duration_s: float, rate_hz: float) -> Sensor:
    """The truth of the body's origin, attitude included."""
    truth = motion.at(np.arange(0.0, duration_s, 1 / rate_hz))
    return Sensor(
        name="reference",
        type="reference",
        series=ReferenceSeries(t=truth.t, p_n=truth.p_n, rpy=truth.rpy),
    )
