"""Noise figures of the sensors, as a card's ``noise`` map states them, with defaults by class.

The defaults describe the sensor class that marina-style vehicles carry (MEMS IMU, small DVL,
compass-aided AHRS, stand-alone GNSS); a card overrides what it knows better.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from pydantic import Field, model_validator

from gtsam_nav.frames import STANDARD_GRAVITY_M_S2
from gtsam_nav.settings import Settings

SQRT_HOUR_S = 60.0
_RAD = np.pi / 180.0

DATASHEET_UNITS: dict[str, dict[str, float]] = {
    "gyro_noise_density_rad_s_sqrt_hz": {
        "gyro_noise_density_deg_sqrt_h": _RAD / SQRT_HOUR_S,
        "gyro_noise_density_deg_s_sqrt_hz": _RAD,
    },
    "gyro_bias_walk_rad_s2_sqrt_hz": {
        "gyro_bias_walk_deg_h_sqrt_h": _RAD / SQRT_HOUR_S**3,
    },
    "gyro_bias_sigma_rad_s": {
        "gyro_bias_sigma_deg_h": _RAD / SQRT_HOUR_S**2,
        "gyro_bias_sigma_deg_s": _RAD,
    },
    "accel_noise_density_m_s2_sqrt_hz": {
        "accel_noise_density_ug_sqrt_hz": 1e-6 * STANDARD_GRAVITY_M_S2,
        "accel_noise_density_m_s_sqrt_h": 1.0 / SQRT_HOUR_S,
    },
    "accel_bias_walk_m_s3_sqrt_hz": {
        "accel_bias_walk_ug_sqrt_h": 1e-6 * STANDARD_GRAVITY_M_S2 / SQRT_HOUR_S,
    },
    "accel_bias_sigma_m_s2": {
        "accel_bias_sigma_ug": 1e-6 * STANDARD_GRAVITY_M_S2,
        "accel_bias_sigma_mg": 1e-3 * STANDARD_GRAVITY_M_S2,
    },
}
"""Names under which a datasheet's figures may stand, and what each unit is in SI."""


class ImuNoise(Settings):
    """Noise of gyroscope and accelerometer.

    ``*_noise_density_*`` are white-noise densities (angle and velocity random walk),
    ``*_bias_walk_*`` random-walk densities, ``*_bias_sigma_*`` the spread of the turn-on bias. Each
    may stand in a datasheet's unit instead, under a name of `DATASHEET_UNITS`.
    """

    gyro_noise_density_rad_s_sqrt_hz: float = Field(default=1e-3, gt=0)
    accel_noise_density_m_s2_sqrt_hz: float = Field(default=1e-2, gt=0)
    gyro_bias_walk_rad_s2_sqrt_hz: float = Field(default=1e-5, gt=0)
    accel_bias_walk_m_s3_sqrt_hz: float = Field(default=1e-4, gt=0)
    gyro_bias_sigma_rad_s: float = Field(default=0.02, gt=0)
    accel_bias_sigma_m_s2: float = Field(default=0.2, gt=0)

    @model_validator(mode="before")
    @classmethod
    def _from_datasheet_units(cls, given: Any) -> Any:
        if not isinstance(given, dict):
            return given
        figures = dict(given)
        for name, units in DATASHEET_UNITS.items():
            stated = [key for key in (name, *units) if key in given]
            if len(stated) > 1:
                raise ValueError(f"give one of {' and '.join(stated)}")
            for key in units.keys() & given.keys():
                value = figures.pop(key)
                if not isinstance(value, int | float):
                    raise ValueError(f"{key} is {value!r}; a number is needed")
                figures[name] = value * units[key]
        return figures


class DvlNoise(Settings):
    """Noise of a Doppler velocity log.

    ``sigma_m_s`` serves where the file states no sigma; ``water_sigma_m_s`` is that of the water's
    own motion, added for water lock; ``scale_sigma`` and ``misalignment_sigma_deg`` are the spread
    of the constant errors, ``max_speed_m_s`` the gate. An instrument that assumed a sound speed of
    ``assumed_sound_speed_m_s`` where it was ``sound_speed_m_s`` is off by their ratio, which is put
    right.
    """

    sigma_m_s: float = Field(default=0.05, gt=0)
    water_sigma_m_s: float = Field(default=0.5, gt=0)
    scale_sigma: float = Field(default=0.01, ge=0)
    misalignment_sigma_deg: float = Field(default=1.0, ge=0)
    max_speed_m_s: float = Field(default=5.0, gt=0)
    assumed_sound_speed_m_s: float | None = Field(default=None, gt=1000, lt=2000)
    sound_speed_m_s: float | None = Field(default=None, gt=1000, lt=2000)

    @model_validator(mode="after")
    def _both_sound_speeds(self) -> DvlNoise:
        if (self.assumed_sound_speed_m_s is None) != (self.sound_speed_m_s is None):
            raise ValueError("assumed_sound_speed_m_s and sound_speed_m_s go together")
        return self

    @property
    def velocity_factor(self) -> float:
        """By which the instrument's velocities are multiplied."""
        if self.sound_speed_m_s is None or self.assumed_sound_speed_m_s is None:
            return 1.0
        return self.sound_speed_m_s / self.assumed_sound_speed_m_s


class OdometryNoise(Settings):
    """Noise of body-frame speed and yaw rate where the file states none.

    ``scale_sigma`` and ``misalignment_sigma_deg`` are the spread of the constant errors, and
    ``curvature_sigma_deg_m`` that of a turn that goes unnoticed (wheels of unequal size). The
    inertial filter counts slip too: an error of the velocity whose spread is the share
    ``slip_sigma`` of the usual speed, and which forgets itself over ``slip_time_s``.
    """

    sigma_v_m_s: float = Field(default=0.1, gt=0)
    sigma_yaw_rate_rad_s: float = Field(default=0.05, gt=0)
    scale_sigma: float = Field(default=0.03, ge=0)
    curvature_sigma_deg_m: float = Field(default=1.0, ge=0)
    misalignment_sigma_deg: float = Field(default=0.5, ge=0)
    slip_sigma: float = Field(default=0.1, ge=0)
    slip_time_s: float = Field(default=1.0, gt=0)


class HeadingNoise(Settings):
    """Noise of a compass or AHRS heading.

    The error is white noise (``sigma_deg``, where the file states none) plus a slowly varying bias:
    a constant of spread ``bias_sigma_deg`` and a disturbance of spread ``disturbance_sigma_deg``
    that forgets itself over ``disturbance_time_s`` (magnetic surroundings). It is a Gauss-Markov
    process, or with ``disturbance_smooth`` one that changes evenly over shorter times, which the
    scan filters count. ``declination_deg`` is added to the readings (magnetic to true north); with
    ``magnetic`` that of the mission's place and date is, by the World Magnetic Model.
    """

    sigma_deg: float = Field(default=0.5, gt=0)
    bias_sigma_deg: float = Field(default=5.0, ge=0)
    disturbance_sigma_deg: float = Field(default=4.0, ge=0)
    disturbance_time_s: float = Field(default=120.0, gt=0)
    disturbance_smooth: bool = False
    declination_deg: float = 0.0
    magnetic: bool = False

    @model_validator(mode="after")
    def _one_declination(self) -> HeadingNoise:
        if self.magnetic and self.declination_deg != 0.0:
            raise ValueError("give declination_deg or magnetic, not both")
        return self


class AttitudeNoise(Settings):
    """Noise of roll and pitch.

    The error is white noise (``sigma_deg``, where the file states none) plus a constant of spread
    ``bias_sigma_deg`` (how the instrument was levelled) and a disturbance of spread
    ``disturbance_sigma_deg`` that forgets itself over ``disturbance_time_s``: an AHRS takes
    accelerations for gravity. Only the inertial filter counts both.
    """

    sigma_deg: float = Field(default=0.5, gt=0)
    bias_sigma_deg: float = Field(default=1.0, ge=0)
    disturbance_sigma_deg: float = Field(default=1.0, ge=0)
    disturbance_time_s: float = Field(default=20.0, gt=0)


class DepthNoise(Settings):
    """Noise of a depth sensor where the file states none."""

    sigma_m: float = Field(default=0.1, gt=0)


class GnssNoise(Settings):
    """Noise of a GNSS receiver where the file states none.

    Successive fixes of a stand-alone receiver share most of their error: ``correlated_share`` is
    the share of the variance that does, forgetting itself over ``correlation_time_s``. Velocities
    are those of ``velocity_lag_s`` before their stamp: a receiver smooths them. Where the lag is
    known no better than ``velocity_lag_sigma_s``, the graph estimates it.
    """

    sigma_horizontal_m: float = Field(default=1.5, gt=0)
    sigma_vertical_m: float = Field(default=3.0, gt=0)
    sigma_velocity_m_s: float = Field(default=0.2, gt=0)
    correlated_share: float = Field(default=0.0, ge=0, lt=1)
    correlation_time_s: float = Field(default=300.0, gt=0)
    velocity_lag_s: float = 0.0
    velocity_lag_sigma_s: float = Field(default=0.0, ge=0)


class LandmarkNoise(Settings):
    """Noise of landmark observations where the file states none.

    Successive sightings may share part of their error, whatever they are of (late stamps, the
    camera's mounting, slip between them): ``correlated_share`` is the share of the variance that
    they do, forgetting itself over ``correlation_time_s``. Ranges are too long by the share
    ``range_scale``, and by a constant one of spread ``range_scale_sigma`` about it (a wrong sound
    speed), which is estimated where that is above zero. With ``range_along_axis`` they are depths:
    along the sensor's x axis, not along the ray.
    """

    sigma_range_m: float = Field(default=0.5, gt=0)
    sigma_bearing_deg: float = Field(default=2.0, gt=0)
    correlated_share: float = Field(default=0.0, ge=0, lt=1)
    correlation_time_s: float = Field(default=3.0, gt=0)
    range_scale: float = Field(default=0.0, gt=-1)
    range_scale_sigma: float = Field(default=0.0, ge=0)
    range_along_axis: bool = False


class SonarNoise(Settings):
    """Noise of a scanning sonar's echoes: range, and half the beam as bearing sigma.

    ``match_floor_m`` and ``match_floor_deg`` are what a match of two scans is off by in itself,
    beyond the echoes' noise and the motion within the scans (walls that lean, wide beams); where
    they are not known, the scan filters take ``pic.floor_xy_m`` and ``pic.floor_yaw_deg``. The ways
    between matched scans share an error of scale, of spread ``scale_sigma``: the sound speed is
    not quite known, and the walls' sampling, which moves along, holds a match back.
    """

    sigma_range_m: float = Field(default=0.1, gt=0)
    sigma_bearing_deg: float = Field(default=1.8, gt=0)
    scale_sigma: float = Field(default=0.0, ge=0)
    match_floor_m: float | None = Field(default=None, ge=0)
    match_floor_deg: float | None = Field(default=None, ge=0)


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


def figure_names(sensor_type: str) -> list[str]:
    """Names that a card's ``noise`` map may hold, each with those for a datasheet's units."""
    names = NOISE_MODELS[sensor_type].model_fields
    return [given for name in names for given in (name, *DATASHEET_UNITS.get(name, ()))]
