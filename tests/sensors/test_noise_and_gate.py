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
