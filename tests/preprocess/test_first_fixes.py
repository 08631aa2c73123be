"""How fixes begin: the first that the others bear out, and their mean velocity."""

from __future__ import annotations

import numpy as np
import pytest

from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.preprocess.first_fixes import (
    ANY_SPEED_M_S,
    first_fixes,
    located,
    locating_receiver,
)
from gtsam_nav.series import GnssSeries

V_N = np.array([3.0, -4.0, 0.0])


def fixes(
    n: int = 20, sigma: float = 1.0, rate_hz: float = 1.0, off: Array | None = None
) -> GnssSeries:
    t = 5.0 + np.arange(n) / rate_hz
    p_n = np.outer(t, V_N) + np.random.default_rng(0).normal(scale=sigma, size=(n, 3))
    if off is not None:
        p_n[: len(off)] += off
    return GnssSeries(t=t, p_n=p_n, sigma=np.full((n, 3), sigma))


@pytest.mark.parametrize("rate_hz", [1.0, 4.0])
def test_good_fixes_begin_with_the_first(rate_hz: float) -> None:
    found = first_fixes(fixes(rate_hz=rate_hz))
    assert found.first == 0
    assert np.linalg.norm((found.v_n - V_N)[:2]) < 3 * found.sigma_v
    assert found.sigma_v < 5.0


@pytest.mark.parametrize("n_off", [1, 2, 3])
def test_outliers_at_the_start_are_passed_over(n_off: int) -> None:
    rng = np.random.default_rng(n_off)
    angle = rng.uniform(0, 2 * np.pi, n_off)
    off = rng.uniform(20, 100, n_off)[:, None] * np.column_stack(
        [np.cos(angle), np.sin(angle), np.zeros(n_off)]
    )
    found = first_fixes(fixes(off=off))
    assert found.first == n_off
    assert np.linalg.norm((found.v_n - V_N)[:2]) < 3 * found.sigma_v


def test_of_too_few_nothing_can_be_told() -> None:
    for n in (1, 2):
        found = first_fixes(fixes(n))
        assert (found.first, found.sigma_v) == (0, ANY_SPEED_M_S)


def test_what_states_no_position_is_not_located() -> None:
    series = fixes(3)
    sigma = series.sigma.copy()
    sigma[1] = 1e6
    np.testing.assert_array_equal(
        located(GnssSeries(t=series.t, p_n=series.p_n, sigma=sigma)), [True, False, True]
    )


def test_a_receiver_of_velocities_alone_locates_nothing() -> None:
    series, names = fixes(3), ("doppler", "gps")
    useless = GnssSeries(t=series.t, p_n=series.p_n, sigma=np.full((3, 3), 2e4), v_n=series.p_n)
    late = np.where(np.arange(3)[:, None] < 1, 2e4, np.ones((3, 3)))
    some = GnssSeries(t=series.t, p_n=series.p_n, sigma=late)
    doppler, gps = (Sensor(n, "gnss", s) for n, s in zip(names, (useless, some), strict=True))
    assert locating_receiver(Mission("m", {"doppler": doppler})) is None
    found = locating_receiver(Mission("m", {"doppler": doppler, "gps": gps}))
    assert found is not None
    assert found.name == "gps"
    np.testing.assert_array_equal(found.series.t, series.t[1:])
