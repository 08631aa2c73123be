"""The errors that fixes share."""

from __future__ import annotations

import numpy as np
import pytest

from gtsam_nav.frames import Array
from gtsam_nav.sensors.fix_errors import alike_fixes, white_sigma
from gtsam_nav.sensors.noise import GnssNoise
from gtsam_nav.series import GnssSeries

MIXED = np.array([0.5, 0.48, 0.02, 0.5, 0.021, 0.02])


def fixes(sigma: Array, offset: Array | None = None) -> GnssSeries:
    n = len(sigma)
    return GnssSeries(
        t=np.arange(float(n)),
        p_n=np.zeros((n, 3)),
        sigma=np.column_stack([sigma, sigma, 2 * sigma]),
        offset_sigma=offset,
    )


def test_fixes_of_different_quality_share_different_errors() -> None:
    noise = GnssNoise(correlated_share=0.8)
    good, bad = alike_fixes(fixes(MIXED), noise)
    np.testing.assert_array_equal(good.which, MIXED < 0.1)
    np.testing.assert_array_equal(bad.which, MIXED > 0.1)
    assert good.shared_sigma == pytest.approx(np.sqrt(0.8) * np.array([0.02, 0.02, 0.04]))
    assert bad.shared_sigma == pytest.approx(np.sqrt(0.8) * np.array([0.5, 0.5, 1.0]))


@pytest.mark.parametrize(
    "sigma",
    [np.linspace(1.0, 9.0, 40), np.r_[1.0, np.tile([1.95, 2.05], 20)]],
    ids=["of a changing geometry", "about a boundary"],
)
def test_fixes_whose_sigmas_leave_no_gap_share_one_error(sigma: Array) -> None:
    (alike,) = alike_fixes(fixes(sigma), GnssNoise(correlated_share=0.9))
    assert np.all(alike.which)


@pytest.mark.parametrize("share", [0.0, 0.5])
def test_shared_and_own_part_are_the_stated_variance(share: float) -> None:
    noise = GnssNoise(correlated_share=share)
    series = fixes(np.full(4, 0.4))
    (alike,) = alike_fixes(series, noise)
    assert alike.share == (share > 0)
    total = white_sigma(series, noise) ** 2 + alike.shared_sigma**2
    np.testing.assert_allclose(total, series.sigma**2)


def test_without_a_stated_share_only_those_beside_a_jump_share_one() -> None:
    offset = np.array([1.0, 1.0, 0.0, 0.0, 2.0, 2.0])
    series = fixes(np.hypot(MIXED, offset), offset)
    right, first, last = alike_fixes(series, GnssNoise())
    np.testing.assert_array_equal(right.which, offset == 0)
    assert not right.share
    np.testing.assert_array_equal(first.which, offset == 1)
    np.testing.assert_array_equal(first.shared_sigma, np.ones(3))
    np.testing.assert_array_equal(last.shared_sigma, np.full(3, 2.0))
    # the test's own vertical sigmas are twice the level ones, offset and all
    np.testing.assert_allclose(white_sigma(series, GnssNoise())[:, 0], MIXED)
