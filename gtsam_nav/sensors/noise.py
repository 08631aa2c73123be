"""Noise figures of the sensors, as a card's ``noise`` map states them, with defaults by class.

The defaults describe the sensor class that marina-style vehicles carry (MEMS IMU, small DVL,
compass-aided AHRS, stand-alone GNSS); a card overrides what it knows better.
"""

from __future__ import annotations

from pydantic import Field

from gtsam_nav.settings import Settings


class ImuNoise(Settings):
    """Noise of gyroscope and accelerometer.

    ``*_noise_density_*`` are white-noise densities, ``*_bias_walk_*`` random-walk densities,
    ``*_bias_sigma_*`` the spread of the turn-on bias.
    """

    gyro_noise_density_rad_s_sqrt_hz: float = Field(default=1e-3, gt=0)
    accel_noise_density_m_s2_sqrt_hz: float = Field(default=1e-2, gt=0)
    gyro_bias_walk_rad_s2_sqrt_hz: float = Field(default=1e-5, gt=0)
    accel_bias_walk_m_s3_sqrt_hz: float = Field(default=1e-4, gt=0)
    gyro_bias_sigma_rad_s: float = Field(default=0.02, gt=0)
    accel_bias_sigma_m_s2: float = Field(default=0.2, gt=0)


class DvlNoise(Settings):
    """Noise of a Doppler velocity log.

    ``sigma_m_s`` serves where the file states no sigma; ``water_sigma_m_s`` is that of the water's
    own motion, added for water lock; ``scale_sigma`` and ``misalignment_sigma_deg`` are the spread
    of the constant errors, ``max_speed_m_s`` the gate.
    """

    sigma_m_s: float = Field(default=0.05, gt=0)
    water_sigma_m_s: float = Field(default=0.5, gt=0)
    scale_sigma: float = Field(default=0.01, ge=0)
    misalignment_sigma_deg: float = Field(default=1.0, ge=0)
    max_speed_m_s: float = Field(default=5.0, gt=0)


class OdometryNoise(Settings):
    """Noise of body-frame speed and yaw rate where the file states none.

    ``scale_sigma`` and ``misalignment_sigma_deg`` are the spread of the constant errors, and
    ``curvature_sigma_deg_m`` that of a turn that goes unnoticed (wheels of unequal size).
    """

    sigma_v_m_s: float = Field(default=0.1, gt=0)
    sigma_yaw_rate_rad_s: float = Field(default=0.05, gt=0)
    scale_sigma: float = Field(default=0.03, ge=0)
    curvature_sigma_deg_m: float = Field(default=1.0, ge=0)
    misalignment_sigma_deg: float = Field(default=0.5, ge=0)


class HeadingNoise(Settings):
    """Noise of a compass or AHRS heading.

    The error is white noise (``sigma_deg``, where the file states none) plus a slowly varying bias:
    a constant of spread ``bias_sigma_deg`` and a disturbance of spread ``disturbance_sigma_deg``
    that forgets itself over ``disturbance_time_s`` (magnetic surroundings). ``declination_deg`` is
    added to the readings (magnetic to true north).
    """

    sigma_deg: float = Field(default=0.5, gt=0)
    bias_sigma_deg: float = Field(default=5.0, ge=0)
    disturbance_sigma_deg: float = Field(default=4.0, ge=0)
    disturbance_time_s: float = Field(default=120.0, gt=0)
    declination_deg: float = 0.0


class AttitudeNoise(Settings):
    """Noise of roll and pitch where the file states none."""

    sigma_deg: float = Field(default=0.5, gt=0)


class DepthNoise(Settings):
    """Noise of a depth sensor where the file states none."""

    sigma_m: float = Field(default=0.1, gt=0)


class GnssNoise(Settings):
    """Noise of a GNSS receiver where the file states none.

    Successive fixes of a stand-alone receiver share most of their error: ``correlated_share`` is
    the share of the variance that does, forgetting itself over ``correlation_time_s``. Velocities
    are those of ``velocity_lag_s`` before their stamp: a receiver smooths them.
    """

    sigma_horizontal_m: float = Field(default=1.5, gt=0)
    sigma_vertical_m: float = Field(default=3.0, gt=0)
    sigma_velocity_m_s: float = Field(default=0.2, gt=0)
    correlated_share: float = Field(default=0.0, ge=0, lt=1)
    correlation_time_s: float = Field(default=300.0, gt=0)
    velocity_lag_s: float = 0.0


class LandmarkNoise(Settings):
    """Noise of landmark observations where the file states none.

    Successive sightings may share part of their error, whatever they are of (late stamps, the
    camera's mounting, slip between them): ``correlated_share`` is the share of the variance that
    they do, forgetting itself over ``correlation_time_s``. ``range_scale_sigma`` is the spread of
    the constant share by which ranges are too long (a wrong sound speed): above zero it is
    estimated.
    """

    sigma_range_m: float = Field(default=0.5, gt=0)
    sigma_bearing_deg: float = Field(default=2.0, gt=0)
    correlated_share: float = Field(default=0.0, ge=0, lt=1)
    correlation_time_s: float = Field(default=3.0, gt=0)
    range_scale_sigma: float = Field(default=0.0, ge=0)


class SonarNoise(Settings):
    """Noise of a scanning sonar's echoes: range, and half the beam as bearing sigma."""

    sigma_range_m: float = Field(default=0.1, gt=0)
    sigma_bearing_deg: float = Field(default=1.8, gt=0)


NOISE_MODELS: dict[str, type[Settings]] = {
    "imu": ImuNoise,
    "dvl": DvlNoise,
    "odometry": OdometryNoise,
    "heading": HeadingNoise,
    "attitude": AttitudeNoise,
    "depth": DepthNoise,
    "gnss": GnssNoise,
    "landmarks": LandmarkNoise,
    "beams": SonarNoise,
    "scans": SonarNoise,
}
"""Sensor type to noise model; types that are absent have no noise figures."""
