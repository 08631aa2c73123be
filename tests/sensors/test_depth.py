"""What a depth gauge tells between its readings, and before and after them."""

from __future__ import annotations

import numpy as np
import pytest

from gtsam_nav.frames import Array, rotation_from_rpy
from gtsam_nav.mission import Sensor
from gtsam_nav.sensors.depth import DIVING_M_S, depths_at, origin_depths
from gtsam_nav.series import DepthSeries

SIGMA_M = 0.05


def gauge(t: Array, xyz_b: Array | None = None) -> Sensor:
    """A gauge that sinks by a decimetre a second."""
    series = DepthSeries(t=t, depth_m=0.1 * t, sigma=np.full(len(t), SIGMA_M))
    return Sensor("depth", "depth", series, xyz_b=np.zeros(3) if xyz_b is None else xyz_b)


def test_between_readings_it_goes_straight_and_is_as_sure() -> None:
    depth_m, sigma = depths_at(gauge(np.arange(10.0, 20.0)), np.array([10.0, 12.25, 19.0]))
    np.testing.assert_allclose(depth_m, [1.0, 1.225, 1.9])
    np.testing.assert_allclose(sigma, SIGMA_M)


@pytest.mark.parametrize(("at_s", "dived_s"), [(0.0, 10.0), (30.0, 9.0), (60.0, 10.0)])
def test_while_it_is_silent_the_vehicle_may_dive(at_s: float, dived_s: float) -> None:
    """Before its first reading, in a gap, and after its last: the nearest is 10 s away."""
    t = np.concatenate([np.arange(10.0, 21.0), np.arange(40.0, 51.0)])
    _, sigma = depths_at(gauge(t), np.array([at_s]))
    assert sigma[0] == pytest.approx(np.hypot(SIGMA_M, DIVING_M_S * dived_s))


def test_near_the_edge_of_a_gap_it_is_as_sure_as_ever() -> None:
    t = np.concatenate([np.arange(10.0, 21.0), np.arange(40.0, 51.0)])
    _, sigma = depths_at(gauge(t), np.array([20.9, 39.1]))
    np.testing.assert_allclose(sigma, SIGMA_M)


def test_a_single_reading_tells_its_own_moment() -> None:
    depth_m, sigma = depths_at(gauge(np.array([10.0])), np.array([10.0, 13.0]))
    np.testing.assert_allclose(depth_m, 1.0)
    np.testing.assert_allclose(sigma, [SIGMA_M, np.hypot(SIGMA_M, 3.0 * DIVING_M_S)])


def test_the_origin_lies_above_a_gauge_that_is_mounted_below_it() -> None:
    arm_b = np.array([2.0, 0.5, -0.4])
    rpy = np.array([[0.2, -0.3, 0.0], [-0.1, 0.4, 1.0]])
    R_nb, t = rotation_from_rpy(rpy), np.array([11.0, 12.0])
    depth_m, _ = origin_depths(gauge(np.arange(10.0, 20.0), arm_b), t, R_nb)
    np.testing.assert_allclose(depth_m, 0.1 * t - (R_nb @ arm_b)[:, 2])
