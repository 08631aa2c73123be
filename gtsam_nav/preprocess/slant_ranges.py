"""Ranges of landmarks as the models take them: along the ray, and neither too long nor too short.

A camera that tells a distance by an object's size in the picture tells a depth: how far the object
lies in front of it, along its axis.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gtsam_nav.errors import DataError
from gtsam_nav.mission import Mission, Rejection, Sensor
from gtsam_nav.sensors.noise import LandmarkNoise
from gtsam_nav.series import LandmarkSeries

BESIDE_OR_BEHIND = "beside or behind the camera"
LEAST_SHARE = float(np.cos(np.radians(80.0)))
"""Of a range that a depth must be: farther from the axis no camera sees, and angles tell it all."""


def with_slant_ranges(mission: Mission) -> Mission:
    """The mission with what each card states of its ranges taken out of them.

    Raises
    ------
    DataError
        For ranges along an axis without bearings.
    """
    for sensor in mission.of_type("landmarks"):
        noise = LandmarkNoise.model_validate(sensor.noise)
        if noise.range_scale or noise.range_along_axis:
            mission = _with_slant_ranges(mission, sensor, noise)
    return mission


def _with_slant_ranges(mission: Mission, sensor: Sensor, noise: LandmarkNoise) -> Mission:
    series = sensor.series
    assert isinstance(series, LandmarkSeries)
    if series.range_m is None or series.sigma_range is None:
        return mission
    share, of_angles = np.ones(len(series.t)), np.zeros(len(series.t))
    if noise.range_along_axis:
        if series.bearing is None or series.sigma_bearing is None:
            raise DataError(
                f"'{sensor.name}': range_along_axis needs the bearing of each sighting; without it"
                " ranges are along the ray"
            )
        angles = [series.bearing, *([] if series.elevation is None else [series.elevation])]
        share = np.prod(np.cos(angles), axis=0)
        of_angles = np.linalg.norm(np.tan(angles), axis=0) * series.sigma_bearing
    before = share > LEAST_SHARE
    stretch = 1.0 / ((1.0 + noise.range_scale) * np.where(before, share, 1.0))
    range_m = series.range_m * stretch
    sigma = np.hypot(series.sigma_range * stretch, range_m * of_angles)
    slant = replace(series, range_m=range_m, sigma_range=sigma).select(before)
    left_out = tuple(
        Rejection(float(series.t[k]), sensor.name, int(series.row[k]), BESIDE_OR_BEHIND)
        for k in np.flatnonzero(~before)
    )
    told = {**sensor.noise, "range_scale": 0.0, "range_along_axis": False}
    return replace(
        mission.with_sensor(replace(sensor, series=slant, noise=told)),
        rejections=(*mission.rejections, *left_out),
    )
