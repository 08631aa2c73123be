"""Clouds as an odometry takes them."""

from __future__ import annotations

import numpy as np
import pytest

from gtsam_nav.odometry.sweeps import Sweep


@pytest.mark.parametrize("spoilt", ["points", "times"])
def test_what_is_not_finite_never_reaches_kiss(spoilt: str) -> None:
    """It would end the process."""
    points, times = np.ones((100, 3)), np.linspace(0.0, 0.1, 100)
    (points if spoilt == "points" else times)[7] = np.nan
    with pytest.raises(ValueError, match="not finite"):
        Sweep(0.0, points, times)
