"""Fixes of a poorer solution than the others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.preprocess.first_fixes import USELESS_SIGMA_M
from gtsam_nav.preprocess.poorer_fixes import with_poorer_fixes
from gtsam_nav.sensors.fix_errors import white_sigma
from gtsam_nav.sensors.noise import GnssNoise
from gtsam_nav.series import GnssSeries

N = 60


def receiver(sigma: Array, share: float = 0.0) -> Mission:
    columns = np.column_stack([sigma, sigma, 2 * sigma])
    series = GnssSeries(
        t=np.arange(float(len(sigma))), p_n=np.zeros((len(sigma), 3)), sigma=columns
    )
    sensor = Sensor("gnss", "gnss", series, noise={"correlated_share": share})
    return Mission("rtk", {"gnss": sensor})


def series_of(mission: Mission) -> GnssSeries:
    series = mission.sensors["gnss"].series
    assert isinstance(series, GnssSeries)
    return series


def test_float_beside_fixed_shares_an_error_of_its_size() -> None:
    sigma = np.r_[np.full(20, 0.5), np.full(N - 20, 0.02)]
    found = with_poorer_fixes(receiver(sigma))
    series = series_of(found)
    assert series.offset_sigma is not None
    np.testing.assert_array_equal(series.offset_sigma, np.where(sigma > 0.1, 0.5, 0.0))
    np.testing.assert_allclose(white_sigma(series, GnssNoise())[:, 0], sigma)
    (said,) = found.warnings
    assert "20 fixes of 'gnss' state sigmas of 0.5 m or so, others 0.02 m" in said


def test_each_poorer_solution_shares_an_error_of_its_own_size() -> None:
    sigma = np.r_[np.full(12, 0.02), np.full(12, 0.5), np.full(36, 5.0)]
    series = series_of(with_poorer_fixes(receiver(sigma)))
    assert series.offset_sigma is not None
    np.testing.assert_array_equal(series.offset_sigma, np.where(sigma > 0.1, sigma, 0.0))


@pytest.mark.parametrize(
    ("sigma", "share"),
    [
        (np.full(N, 0.4), 0.0),
        (np.linspace(1.0, 10.0, N), 0.0),
        (np.r_[np.full(5, 9.0), np.full(N - 5, 0.4)], 0.0),
        (np.r_[np.full(20, USELESS_SIGMA_M), np.full(N - 20, 0.4)], 0.0),
        (np.r_[np.full(20, 0.5), np.full(N - 20, 0.02)], 0.3),
    ],
    ids=["of one quality", "of many geometries", "but few", "not located", "where a card says it"],
)
def test_others_stay(sigma: Array, share: float) -> None:
    mission = receiver(sigma, share)
    assert with_poorer_fixes(mission) is mission


def test_what_a_jump_has_shown_stays() -> None:
    sigma = np.r_[np.full(20, 0.5), np.full(N - 20, 0.02)]
    mission = receiver(sigma)
    jumped = replace(series_of(mission), offset_sigma=np.where(sigma > 0.1, 0.3, 0.0))
    mission = mission.with_sensor(replace(mission.sensors["gnss"], series=jumped))
    assert with_poorer_fixes(mission) is mission
