"""Ranges of landmarks that are depths, or too long."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import gtsam_nav as gn
from gtsam_nav.errors import DataError
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.preprocess.slant_ranges import BESIDE_OR_BEHIND, with_slant_ranges
from gtsam_nav.series import LandmarkSeries


def mission(elevation: float | None = None, **noise: float | bool) -> Mission:
    """Three sightings of a camera: ahead, to the right, behind."""
    bearing = np.radians([0.0, 60.0, 120.0])
    series = LandmarkSeries(
        t=np.arange(3.0),
        row=np.array([4, 5, 6]),
        id=np.array([1, 2, 3]),
        range_m=np.array([2.2, 2.2, 2.2]),
        bearing=bearing,
        sigma_range=np.full(3, 0.11),
        sigma_bearing=np.full(3, 0.01),
        elevation=None if elevation is None else np.full(3, elevation),
    )
    sensor = Sensor("camera", "landmarks", series, noise=dict(noise))
    return Mission(name="three", sensors={"camera": sensor}, start_utc=0.0)


def seen(of: Mission) -> LandmarkSeries:
    series = of.sensors["camera"].series
    assert isinstance(series, LandmarkSeries)
    return series


def test_ranges_that_are_neither_too_long_nor_depths_stay() -> None:
    given = mission()
    assert with_slant_ranges(given) is given


def test_ranges_that_are_too_long_are_shortened_with_their_sigmas() -> None:
    shortened = seen(with_slant_ranges(mission(range_scale=0.1)))
    np.testing.assert_allclose(shortened.range_m, 2.0)
    np.testing.assert_allclose(shortened.sigma_range, 0.1)


def test_depths_become_ranges_and_what_is_behind_the_camera_is_rejected() -> None:
    changed = with_slant_ranges(mission(range_along_axis=True))
    np.testing.assert_allclose(seen(changed).range_m, [2.2, 4.4])
    by_bearing = 4.4 * np.tan(np.radians(60.0)) * 0.01
    np.testing.assert_allclose(seen(changed).sigma_range, [0.11, np.hypot(0.22, by_bearing)])
    np.testing.assert_array_equal(seen(changed).row, [4, 5])
    assert [(r.sensor, r.index, r.reason) for r in changed.rejections] == [
        ("camera", 6, BESIDE_OR_BEHIND)
    ]


def test_a_depth_of_what_is_above_the_camera_is_shorter_too() -> None:
    changed = with_slant_ranges(mission(np.radians(60.0), range_along_axis=True))
    np.testing.assert_allclose(seen(changed).range_m, [4.4, 8.8])


def test_what_is_nearly_abeam_is_no_landmark_far_away() -> None:
    given = mission(range_along_axis=True)
    abeam = replace(seen(given), bearing=np.radians([0.0, 89.99, 90.0]))
    changed = with_slant_ranges(given.with_sensor(replace(given.sensors["camera"], series=abeam)))
    np.testing.assert_array_equal(seen(changed).row, [4])


def test_what_was_taken_out_is_not_taken_out_again() -> None:
    once = with_slant_ranges(mission(range_along_axis=True, range_scale=0.1))
    assert with_slant_ranges(once) is once


def test_a_depth_without_a_bearing_is_an_error() -> None:
    given = mission(range_along_axis=True)
    alone = replace(seen(given), bearing=None, sigma_bearing=None)
    blind = given.with_sensor(replace(given.sensors["camera"], series=alone))
    with pytest.raises(DataError, match="'camera': range_along_axis needs the bearing"):
        with_slant_ranges(blind)


def test_estimators_see_the_way_along_the_ray() -> None:
    """A simulated camera that tells depths, which its card says, loses nothing by it."""
    simulated = gn.simulate("marina", seed=1).without("sonar").crop(stop_s=100.0)
    sensor = simulated.sensors["landmarks"]
    rays = sensor.series
    assert isinstance(rays, LandmarkSeries)
    assert rays.range_m is not None
    assert rays.bearing is not None
    ahead = np.abs(rays.bearing) < np.radians(80.0)
    depths = replace(rays, range_m=rays.range_m * np.cos(rays.bearing) * 1.05).select(ahead)
    told = {**sensor.noise, "range_along_axis": True, "range_scale": 0.05}
    by_rays, by_depths = (
        gn.estimate(simulated.with_sensor(changed), "landmark-ekf").trajectory.p_n
        for changed in (
            replace(sensor, series=rays.select(ahead)),
            replace(sensor, series=depths, noise=told),
        )
    )
    np.testing.assert_allclose(by_depths, by_rays, atol=0.2)
