"""Sigmas that the fixes' scatter contradicts."""

from __future__ import annotations

import numpy as np
import pytest

from gtsam_nav.audit.sigmas import sigma_findings
from gtsam_nav.mission import Sensor
from gtsam_nav.series import GnssSeries


def receiver(noise_m: float, stated: float, n: int = 200, rate_hz: float = 1.0) -> Sensor:
    t = np.arange(n) / rate_hz
    p_n = 25.0 * np.column_stack([np.sin(t / 10), np.cos(t / 10), 0 * t])
    p_n += noise_m * np.random.default_rng(0).normal(size=p_n.shape)
    return Sensor("rtk", "gnss", GnssSeries(t=t, p_n=p_n, sigma=np.full(p_n.shape, stated)))


def test_millimetres_are_told_by_the_scatter() -> None:
    (found,) = sigma_findings(receiver(0.02, 20.0))
    assert found.check == "gnss sigma"
    assert "state sigmas of 20 m, and scatter by 0.02" in found.message
    assert found.fix == "scale: {sigma_n: 0.001, sigma_e: 0.001, sigma_d: 0.001}"


@pytest.mark.parametrize(
    ("noise_m", "stated", "n", "rate_hz"),
    [
        (0.02, 0.02, 200, 1.0),
        (0.003, 2.0, 200, 10.0),
        (15.0, 15.0, 200, 1.0),
        (0.02, 20.0, 10, 1.0),
    ],
    ids=["in metres", "smoothed by the receiver", "as bad as it says", "too few"],
)
def test_others_are_believed(noise_m: float, stated: float, n: int, rate_hz: float) -> None:
    assert not list(sigma_findings(receiver(noise_m, stated, n, rate_hz)))
