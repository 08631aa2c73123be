"""What the simulated sensors do wrong: every figure, with its unit."""

from __future__ import annotations

from pydantic import Field

from gtsam_nav.preprocess.settings import MotionSettings as ExpectedMotion
from gtsam_nav.settings import Settings
from gtsam_nav.simulation.lidar import LidarSimulation
from gtsam_nav.simulation.motion import MotionSettings
from gtsam_nav.simulation.sonar import SonarSimulation

Triple = tuple[float, float, float]


class ImuSimulation(Settings):
    """A MEMS inertial unit at the body's origin; densities and spreads as in `ImuNoise`."""

    rate_hz: float = Field(default=100.0, gt=0)
    gyro_noise_density_rad_s_sqrt_hz: float = Field(default=1e-3, gt=0)
    accel_noise_density_m_s2_sqrt_hz: float = Field(default=2e-3, gt=0)
    gyro_bias_walk_rad_s2_sqrt_hz: float = Field(default=1e-4, gt=0)
    accel_bias_walk_m_s3_sqrt_hz: float = Field(default=1e-4, gt=0)
    gyro_bias_sigma_rad_s: float = Field(default=0.01, gt=0)
    accel_bias_sigma_m_s2: float = Field(default=0.05, gt=0)


class DvlSimulation(Settings):
    """A Doppler log.

    Attributes
    ----------
    sigma_m_s : float
        White noise of each axis.
    scale_sigma, misalignment_sigma_deg : float
        Spread of the constant scale error and of the error of the mounting's yaw.
    dropouts_per_min, dropout_mean_s : float
        How often bottom lock is lost, and for how long.
    water_lock_share : float
        Share of those bursts in which the log measures the water instead.
    water_sigma_m_s, water_time_s : float
        The water's own motion: spread and correlation time of each horizontal axis.
    """

    rate_hz: float = Field(default=5.0, gt=0)
    xyz_m: Triple = (-0.2, 0.0, 0.15)
    rpy_deg: Triple = (0.0, 0.0, 45.0)
    sigma_m_s: float = Field(default=0.03, gt=0)
    scale_sigma: float = Field(default=0.005, ge=0)
    misalignment_sigma_deg: float = Field(default=0.2, ge=0)
    dropouts_per_min: float = Field(default=1.5, ge=0)
    dropout_mean_s: float = Field(default=2.0, gt=0)
    water_lock_share: float = Field(default=0.3, ge=0, le=1)
    water_sigma_m_s: float = Field(default=0.1, gt=0)
    water_time_s: float = Field(default=100.0, gt=0)


class HeadingSimulation(Settings):
    """The heading of an AHRS.

    Attributes
    ----------
    sigma_deg : float
        White noise.
    bias_sigma_deg : float
        Spread of the constant error.
    wall_peak_deg, wall_decay_m : float
        What a fully reinforced wall does at no distance, and how fast that falls off.
    drift_sigma_deg, drift_time_s : float
        A Gauss-Markov error that knows no walls: spread and correlation time.
    """

    rate_hz: float = Field(default=10.0, gt=0)
    sigma_deg: float = Field(default=0.3, gt=0)
    bias_sigma_deg: float = Field(default=0.5, ge=0)
    wall_peak_deg: float = Field(default=20.0, ge=0)
    wall_decay_m: float = Field(default=5.0, gt=0)
    drift_sigma_deg: float = Field(default=0.0, ge=0)
    drift_time_s: float = Field(default=60.0, gt=0)


class AttitudeSimulation(Settings):
    """Roll and pitch of an AHRS: white noise."""

    rate_hz: float = Field(default=10.0, gt=0)
    sigma_deg: float = Field(default=0.2, gt=0)


class DepthSimulation(Settings):
    """A pressure gauge: white noise."""

    rate_hz: float = Field(default=2.0, gt=0)
    sigma_m: float = Field(default=0.05, gt=0)


class GnssSimulation(Settings):
    """A GNSS receiver with its antenna on a mast above the water.

    Attributes
    ----------
    sigma_white_m, sigma_drift_m, drift_time_s : float
        White and Gauss-Markov error of each horizontal axis; the vertical has twice as much.
    sigma_velocity_m_s : float or None
        White error of each axis of the velocities; None is a receiver that gives none.
    outlier_share, outlier_sigma_m : float
        Share of fixes with a further error, and its spread.
    """

    rate_hz: float = Field(default=1.0, gt=0)
    xyz_m: Triple = (-0.4, 0.0, -2.3)
    sigma_white_m: float = Field(default=0.2, gt=0)
    sigma_drift_m: float = Field(default=0.15, ge=0)
    drift_time_s: float = Field(default=60.0, gt=0)
    sigma_velocity_m_s: float | None = Field(default=None, gt=0)
    outlier_share: float = Field(default=0.005, ge=0, le=1)
    outlier_sigma_m: float = Field(default=6.0, ge=0)


class OdometrySimulation(Settings):
    """A thruster model: white noise, and a constant scale error of the speeds."""

    rate_hz: float = Field(default=10.0, gt=0)
    sigma_v_m_s: float = Field(default=0.08, gt=0)
    sigma_yaw_rate_rad_s: float = Field(default=0.02, gt=0)
    scale_sigma: float = Field(default=0.03, ge=0)


class LandmarkSimulation(Settings):
    """Range and bearing to the landmarks in view.

    Attributes
    ----------
    max_range_m : float
        Nothing further away is seen; the default is how far a camera sees in a harbour's water.
    sigma_range_m, sigma_range_share : float
        The error of a range: a constant part, and one that grows with the range.
    sigma_bearing_deg : float
        The error of a bearing, and of an elevation.
    detection_share : float
        Share of the landmarks in view that a look tells apart.
    elevation : bool
        Measure the angle above the vehicle's plane too.
    only_at_rest : bool
        Look around only while the vehicle stands.
    """

    rate_hz: float = Field(default=1.0, gt=0)
    max_range_m: float = Field(default=8.0, gt=0)
    sigma_range_m: float = Field(default=0.3, gt=0)
    sigma_range_share: float = Field(default=0.0, ge=0)
    sigma_bearing_deg: float = Field(default=2.0, gt=0)
    detection_share: float = Field(default=0.8, ge=0, le=1)
    elevation: bool = False
    only_at_rest: bool = False


class StartSimulation(Settings):
    """What the mission states of its start: the truth with errors of these spreads."""

    sigma_position_m: float = Field(gt=0)
    sigma_heading_deg: float = Field(gt=0)


class SimulationSettings(Settings):
    """Everything about a simulated mission but its world; a sensor that is None is not aboard."""

    reference_rate_hz: float = Field(default=100.0, gt=0)
    motion: MotionSettings = MotionSettings()
    start: StartSimulation | None = None
    imu: ImuSimulation | None = ImuSimulation()
    dvl: DvlSimulation | None = DvlSimulation()
    heading: HeadingSimulation | None = HeadingSimulation()
    attitude: AttitudeSimulation | None = AttitudeSimulation()
    depth: DepthSimulation | None = DepthSimulation()
    gnss: GnssSimulation | None = GnssSimulation()
    odometry: OdometrySimulation | None = OdometrySimulation()
    landmarks: LandmarkSimulation | None = LandmarkSimulation()
    sonar: SonarSimulation | None = SonarSimulation()
    lidar: LidarSimulation | None = None

    @classmethod
    def matched(cls) -> SimulationSettings:
        """Errors of just the kinds that the noise models know, for tests of consistency.

        The vehicle moves as the default motion model expects it to.
        """
        expected = ExpectedMotion()
        return cls(
            motion=MotionSettings(
                ramp_s=30.0,
                heave_m=0.0,
                yaw_deg=0.0,
                wander_accel_m_s2=expected.sigma_accel_m_s2,
                wander_vertical_accel_m_s2=expected.sigma_vertical_accel_m_s2,
                wander_yaw_accel_rad_s2=expected.sigma_yaw_accel_rad_s2,
            ),
            dvl=DvlSimulation(scale_sigma=0.0, misalignment_sigma_deg=0.0),
            heading=HeadingSimulation(wall_peak_deg=0.0, drift_sigma_deg=2.0),
            gnss=GnssSimulation(outlier_share=0.0),
            odometry=OdometrySimulation(scale_sigma=0.0),
            sonar=SonarSimulation(clutter_per_beam=0.0, second_echo=0.0),
        )
