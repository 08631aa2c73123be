"""The watch on stated noise: outliers do not sway it, a sensor that is worse than it says does."""

from __future__ import annotations

import numpy as np
import pytest

from gtsam_nav.ekf.noise_watch import BELIEVED_FACTOR, WINDOW_S, NoiseWatch
from gtsam_nav.frames import Array


def factors(nis: Array, watch: NoiseWatch | None = None, rate_hz: float = 5.0) -> Array:
    watch = watch or NoiseWatch()
    return np.array([watch.variance_factor(k / rate_hz, float(x), 3) for k, x in enumerate(nis)])


@pytest.mark.parametrize("seed", range(3))
def test_outliers_are_left_to_the_gate(seed: int) -> None:
    rng = np.random.default_rng(seed)
    nis = rng.chisquare(3, 300)
    nis[rng.random(300) < 0.25] = 1e4
    assert np.all(factors(nis) == 1.0)


def test_a_sensor_that_is_five_times_as_bad_is_found_so_and_forgiven_when_it_is_good_again() -> (
    None
):
    rng = np.random.default_rng(0)
    good, bad = rng.chisquare(3, 100), 25.0 * rng.chisquare(3, 200)
    watch = NoiseWatch()
    found = factors(np.concatenate([good, bad, good]), watch)
    within = int(WINDOW_S * 5.0) + 1
    assert np.all(found[:100] == 1.0)
    assert np.median(found[100 + within : 300]) == pytest.approx(25.0, rel=0.2)
    assert np.all(found[100 + within : 300] > BELIEVED_FACTOR)
    assert np.all(found[300 + within :] == 1.0)
    assert "odometry" in str(watch.warning("odometry"))


def test_a_good_sensor_is_not_spoken_of() -> None:
    watch = NoiseWatch()
    factors(np.random.default_rng(1).chisquare(3, 300), watch)
    assert watch.warning("dvl") is None
