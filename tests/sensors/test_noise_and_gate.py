"""Noise figures of the cards, and the chi-square gate."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.stats import chi2

from gtsam_nav.sensors.noise import (
    DATASHEET_UNITS,
    NOISE_MODELS,
    DvlNoise,
    HeadingNoise,
    ImuNoise,
    figure_names,
)
from gtsam_nav.sensors.prediction import Prediction, chi2_limit
from gtsam_nav.series import SERIES_TYPES


@pytest.mark.parametrize("dof", range(1, 8))
@pytest.mark.parametrize("probability", [0.01, 0.5, 0.95, 0.9999, 1 - 1e-9])
def test_the_gate_is_the_quantile_of_chi_square(probability: float, dof: int) -> None:
    assert chi2_limit(probability, dof) == pytest.approx(chi2.ppf(probability, dof), rel=1e-10)


def test_the_whitened_cost_is_a_mahalanobis_distance() -> None:
    rng = np.random.default_rng(0)
    root, residual = rng.normal(size=(3, 3)), rng.normal(size=3)
    prediction = Prediction(root @ residual, np.zeros((3, 9)), root @ root.T)
    assert prediction.whitened_cost == pytest.approx(residual @ residual)


def test_noise_models_are_of_known_sensors() -> None:
    assert set(NOISE_MODELS) <= set(SERIES_TYPES)
    assert "reference" not in NOISE_MODELS


@pytest.mark.parametrize("sensor_type", NOISE_MODELS)
def test_noise_figures_are_checked(sensor_type: str) -> None:
    model = NOISE_MODELS[sensor_type]
    with pytest.raises(ValidationError, match="no_such_figure"):
        model.model_validate({"no_such_figure": 1.0})
    sigma = next(name for name in model.model_fields if "sigma" in name or "density" in name)
    with pytest.raises(ValidationError, match=sigma):
        model.model_validate({sigma: -1.0})
    assert getattr(model.model_validate({sigma: 0.123}), sigma) == 0.123


@pytest.mark.parametrize(
    ("stated", "name", "value"),
    [
        ({"gyro_noise_density_deg_sqrt_h": 0.3}, "gyro_noise_density_rad_s_sqrt_hz", 8.7266e-5),
        (
            {"gyro_noise_density_deg_s_sqrt_hz": 0.005},
            "gyro_noise_density_rad_s_sqrt_hz",
            8.7266e-5,
        ),
        ({"gyro_bias_sigma_deg_h": 10.0}, "gyro_bias_sigma_rad_s", 4.8481e-5),
        ({"gyro_bias_sigma_deg_s": 0.2}, "gyro_bias_sigma_rad_s", 3.4907e-3),
        ({"gyro_bias_walk_deg_h_sqrt_h": 3.0}, "gyro_bias_walk_rad_s2_sqrt_hz", 2.4241e-7),
        ({"accel_noise_density_ug_sqrt_hz": 100.0}, "accel_noise_density_m_s2_sqrt_hz", 9.80665e-4),
        ({"accel_noise_density_m_s_sqrt_h": 0.06}, "accel_noise_density_m_s2_sqrt_hz", 1e-3),
        ({"accel_bias_walk_ug_sqrt_h": 60.0}, "accel_bias_walk_m_s3_sqrt_hz", 9.80665e-6),
        ({"accel_bias_sigma_mg": 2.0}, "accel_bias_sigma_m_s2", 0.0196133),
        ({"accel_bias_sigma_ug": 50.0}, "accel_bias_sigma_m_s2", 4.903325e-4),
    ],
)
def test_datasheet_units_are_converted(stated: dict[str, float], name: str, value: float) -> None:
    """0.3 deg/sqrt(h) is 0.005 deg/s/sqrt(Hz), and so on."""
    noise = ImuNoise.model_validate(stated)
    assert getattr(noise, name) == pytest.approx(value, rel=1e-4)
    assert noise.model_copy(update={name: getattr(ImuNoise(), name)}) == ImuNoise()


def test_every_datasheet_unit_is_of_a_figure() -> None:
    assert set(DATASHEET_UNITS) == set(ImuNoise.model_fields)


@pytest.mark.parametrize(
    ("stated", "message"),
    [
        (
            {"gyro_bias_sigma_deg_h": 10.0, "gyro_bias_sigma_rad_s": 1e-4},
            "one of gyro_bias_sigma_rad_s and gyro_bias_sigma_deg_h",
        ),
        ({"gyro_bias_sigma_deg_h": "ten"}, "gyro_bias_sigma_deg_h is 'ten'"),
        ({"gyro_bias_sigma_deg_h": -1.0}, "gyro_bias_sigma_rad_s"),
    ],
)
def test_bad_datasheet_figures_are_refused(stated: dict[str, object], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        ImuNoise.model_validate(stated)


def test_a_declination_is_stated_or_modelled() -> None:
    with pytest.raises(ValidationError, match="declination_deg or magnetic"):
        HeadingNoise(magnetic=True, declination_deg=2.0)


def test_sound_speeds_go_together() -> None:
    assert DvlNoise(assumed_sound_speed_m_s=1500.0, sound_speed_m_s=1485.0).velocity_factor == 0.99
    with pytest.raises(ValidationError, match="go together"):
        DvlNoise(sound_speed_m_s=1485.0)


MAY_BE_ZERO = {
    *("scale_sigma", "misalignment_sigma_deg", "curvature_sigma_deg_m", "bias_sigma_deg"),
    *("disturbance_sigma_deg", "correlated_share", "range_scale_sigma", "velocity_lag_sigma_s"),
    "slip_sigma",
}
"""Errors that a sensor need not have; all others are noise, or a time to divide by."""
ANY_SIGN = {"declination_deg", "velocity_lag_s", "range_scale"}
SOUND_SPEEDS = {"assumed_sound_speed_m_s", "sound_speed_m_s"}

figures = pytest.mark.parametrize(
    ("sensor_type", "name"),
    [
        (sensor_type, name)
        for sensor_type, model in NOISE_MODELS.items()
        for name, field in model.model_fields.items()
        if field.annotation is float
    ],
)


def takes(sensor_type: str, **figures: float) -> bool:
    try:
        NOISE_MODELS[sensor_type].model_validate(figures)
    except ValidationError:
        return False
    return True


@figures
def test_noise_is_positive_and_errors_may_be_absent(sensor_type: str, name: str) -> None:
    assert takes(sensor_type, **{name: 1e-9})
    assert takes(sensor_type, **{name: 0.0}) == (name in MAY_BE_ZERO | ANY_SIGN)
    assert takes(sensor_type, **{name: -1e-9}) == (name in ANY_SIGN)


@pytest.mark.parametrize("sensor_type", ["gnss", "landmarks"])
def test_not_all_of_a_variance_can_be_shared(sensor_type: str) -> None:
    assert takes(sensor_type, correlated_share=0.999)
    assert not takes(sensor_type, correlated_share=1.0)


def test_sound_speeds_are_those_of_water() -> None:
    for name in SOUND_SPEEDS:
        others = dict.fromkeys(SOUND_SPEEDS - {name}, 1500.0)
        assert [takes("dvl", **others, **{name: v}) for v in (1000, 1000.1, 1999.9, 2000)] == [
            *(False, True),
            *(True, False),
        ]


def test_a_declination_or_a_model_alone_is_taken() -> None:
    assert HeadingNoise(declination_deg=2.0).declination_deg == 2.0
    assert HeadingNoise(magnetic=True).declination_deg == 0.0
    assert DvlNoise().velocity_factor == 1.0


def test_names_of_figures_are_those_of_the_model_and_of_datasheets() -> None:
    assert figure_names("depth") == ["sigma_m"]
    names = figure_names("imu")
    assert names[:3] == [
        "gyro_noise_density_rad_s_sqrt_hz",
        "gyro_noise_density_deg_sqrt_h",
        "gyro_noise_density_deg_s_sqrt_hz",
    ]
    assert len(names) == 6 + 10


SONAR_DEFAULTS = {
    "sigma_range_m": 0.1,
    "sigma_bearing_deg": 1.8,
    "scale_sigma": 0.0,
    "match_floor_m": None,
    "match_floor_deg": None,
}
DEFAULTS: dict[str, dict[str, float | bool | None]] = {
    "imu": {
        "gyro_noise_density_rad_s_sqrt_hz": 1e-3,
        "accel_noise_density_m_s2_sqrt_hz": 1e-2,
        "gyro_bias_walk_rad_s2_sqrt_hz": 1e-5,
        "accel_bias_walk_m_s3_sqrt_hz": 1e-4,
        "gyro_bias_sigma_rad_s": 0.02,
        "accel_bias_sigma_m_s2": 0.2,
    },
    "dvl": {
        "sigma_m_s": 0.05,
        "water_sigma_m_s": 0.5,
        "scale_sigma": 0.01,
        "misalignment_sigma_deg": 1.0,
        "max_speed_m_s": 5.0,
        "assumed_sound_speed_m_s": None,
        "sound_speed_m_s": None,
    },
    "odometry": {
        "sigma_v_m_s": 0.1,
        "sigma_yaw_rate_rad_s": 0.05,
        "scale_sigma": 0.03,
        "curvature_sigma_deg_m": 1.0,
        "misalignment_sigma_deg": 0.5,
        "slip_sigma": 0.1,
        "slip_time_s": 1.0,
    },
    "heading": {
        "sigma_deg": 0.5,
        "bias_sigma_deg": 5.0,
        "disturbance_sigma_deg": 4.0,
        "disturbance_time_s": 120.0,
        "disturbance_smooth": False,
        "declination_deg": 0.0,
        "magnetic": False,
    },
    "attitude": {
        "sigma_deg": 0.5,
        "bias_sigma_deg": 1.0,
        "disturbance_sigma_deg": 1.0,
        "disturbance_time_s": 20.0,
    },
    "depth": {"sigma_m": 0.1},
    "gnss": {
        "sigma_horizontal_m": 1.5,
        "sigma_vertical_m": 3.0,
        "sigma_velocity_m_s": 0.2,
        "correlated_share": 0.0,
        "correlation_time_s": 300.0,
        "velocity_lag_s": 0.0,
        "velocity_lag_sigma_s": 0.0,
    },
    "landmarks": {
        "sigma_range_m": 0.5,
        "sigma_bearing_deg": 2.0,
        "correlated_share": 0.0,
        "correlation_time_s": 3.0,
        "range_scale": 0.0,
        "range_scale_sigma": 0.0,
        "range_along_axis": False,
    },
    "beams": SONAR_DEFAULTS,
    "scans": SONAR_DEFAULTS,
}
"""What a card that says nothing says: whoever changes one of these changes missions of others."""


@pytest.mark.parametrize("sensor_type", NOISE_MODELS)
def test_what_a_card_leaves_out_is_as_it_was(sensor_type: str) -> None:
    model = NOISE_MODELS[sensor_type]
    assert model().model_dump() == DEFAULTS[sensor_type]
    assert model.model_validate(model().model_dump()) == model()
