"""Places by ranges to surveyed beacons, where only an IMU measures the motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gtsam_nav.frames import Array
from gtsam_nav.mission import Constraints, InitialState, LandmarkMap, Mission, Sensor
from gtsam_nav.preprocess.fixes_by_ranges import (
    fixes_by_ranges,
    ranges_tell_places,
    said_of_side,
)
from gtsam_nav.sensors.settings import LandmarkSettings
from gtsam_nav.series import DepthSeries, GnssSeries, ImuSeries, LandmarkSeries, OdometrySeries

SETTINGS = LandmarkSettings()
DEPTH_M, BOTTOM_M, SIGMA_M = 20.0, 45.0, 0.3
CORNERS = np.array([[-40.0, -60.0], [120.0, -40.0], [100.0, 90.0], [-50.0, 80.0]])
AT_N = np.array([300.0, -200.0, 0.0])
"""Where the mission is: far from the frame's zero."""


def path(t: Array) -> Array:
    """A circle at 1.2 m/s."""
    angle = t / 25.0
    around = 30.0 * np.column_stack([np.sin(angle), 1 - np.cos(angle)])
    return np.column_stack([around, np.full(len(t), DEPTH_M)]) + AT_N


def mission(
    bottom_m: float = BOTTOM_M, seed: int = 0, corners: Array = CORNERS, shift_m: float = 40.0
) -> Mission:
    """One range every two seconds, to one beacon after the other; some are far too long."""
    rng = np.random.default_rng(seed)
    unlike = np.array([0.0, 1.0, -1.0, 0.5])[: len(corners)]
    beacons = np.column_stack([corners, bottom_m + unlike]) + AT_N
    t = np.arange(1.5, 300.0, 2.0)
    beacon = np.arange(len(t)) % len(beacons)
    range_m = np.linalg.norm(path(t) - beacons[beacon], axis=1) + rng.normal(0, SIGMA_M, len(t))
    range_m[::19] += shift_m
    ranges = LandmarkSeries(t=t, id=beacon, range_m=range_m, sigma_range=np.full(len(t), SIGMA_M))
    still = np.zeros((4, 3))
    imu = ImuSeries(t=np.array([0.0, 100.0, 200.0, 300.0]), gyro_i=still, accel_i=still)
    return Mission(
        "beacons",
        sensors={
            "imu": Sensor("imu", "imu", imu),
            "ranges": Sensor("ranges", "landmarks", ranges),
        },
        landmark_map=LandmarkMap(np.arange(len(beacons)), beacons, np.full(len(beacons), 0.1)),
    )


def off_m(fixes: Sensor | None) -> Array:
    """Errors (k, 3) of the places."""
    assert fixes is not None
    assert isinstance(fixes.series, GnssSeries)
    return fixes.series.p_n - path(fixes.series.t)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("bottom_m", [BOTTOM_M, 0.0])
def test_the_path_lies_on_the_side_that_is_in_the_water(seed: int, bottom_m: float) -> None:
    off = off_m(fixes_by_ranges(mission(bottom_m, seed), SETTINGS))
    assert np.all(np.sqrt(np.mean(off**2, axis=0)) < [0.8, 0.8, 1.5])
    assert np.all(np.abs(off) < 8.0)


def test_a_stated_depth_says_more() -> None:
    constant = replace(mission(), constraints=Constraints(constant_depth=True))
    t = np.arange(0.0, 300.0, 1.0)
    gauge = DepthSeries(t=t, depth_m=np.full(len(t), DEPTH_M - 2.0), sigma=np.full(len(t), 0.05))
    lever_b = np.array([0.0, 0.0, -2.0])
    gauged = mission().with_sensor(Sensor("gauge", "depth", gauge, xyz_b=lever_b))
    assert list(said_of_side(constant))
    assert not list(said_of_side(gauged))
    for told in (constant, gauged):
        assert np.abs(off_m(fixes_by_ranges(told, SETTINGS))[:, 2]).max() < 0.3


def test_a_start_below_the_beacons_is_believed() -> None:
    begin = path(np.zeros(1))[0]
    deep = begin + np.array([0.0, 0.0, 2 * (BOTTOM_M - DEPTH_M)])
    stated = replace(mission(), initial=InitialState(p_n=deep, sigma_p=1.0))
    fixes = fixes_by_ranges(stated, SETTINGS)
    mirrored = off_m(fixes)[:, 2] - 2 * (BOTTOM_M - DEPTH_M)
    assert np.sqrt(np.mean(mirrored**2)) < 2.0
    assert not list(said_of_side(stated))


def test_too_few_beacons_and_those_in_a_line_tell_no_place() -> None:
    line = np.column_stack([np.arange(4) * 30.0, np.arange(4) * 20.0])
    assert fixes_by_ranges(mission(corners=CORNERS[:2]), SETTINGS) is None
    assert fixes_by_ranges(mission(corners=line), SETTINGS) is None


def test_ranges_that_do_not_fit_each_other_tell_no_place() -> None:
    told = mission()
    ranges = told.sensors["ranges"]
    assert isinstance(ranges.series, LandmarkSeries)
    assert ranges.series.range_m is not None
    wild = np.random.default_rng(1).uniform(5.0, 500.0, len(ranges.series))
    other = replace(ranges, series=replace(ranges.series, range_m=wild))
    assert fixes_by_ranges(told.with_sensor(other), SETTINGS) is None


def test_what_measures_the_way_itself_needs_none() -> None:
    some = np.full(300, 0.1)
    wheels = OdometrySeries(
        t=np.arange(300.0), v_b=np.ones((300, 2)), yaw_rate=some, sigma_v=some, sigma_yaw_rate=some
    )
    assert ranges_tell_places(mission(), SETTINGS)
    assert not ranges_tell_places(
        mission().with_sensor(Sensor("wheels", "odometry", wheels)), SETTINGS
    )
    assert not ranges_tell_places(mission(), SETTINGS.model_copy(update={"use_map": False}))
    assert not ranges_tell_places(mission().without("imu"), SETTINGS)
