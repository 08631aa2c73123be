"""Noise figures of the cards, and the chi-square gate."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.stats import chi2

from gtsam_nav.sensors.noise import NOISE_MODELS
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
