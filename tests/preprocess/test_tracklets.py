"""Sightings that follow each other, and the noise that they tell of."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from rovers import rover

from gtsam_nav.config import load_config
from gtsam_nav.preprocess.planar_motion import planar_motion
from gtsam_nav.preprocess.planar_smoothing import SightedPoints
from gtsam_nav.preprocess.tracklets import noise_found, tracklets
from gtsam_nav.sensors.landmarks import level_points
from gtsam_nav.series import LandmarkSeries


def test_tracklets_hold_one_landmark_each() -> None:
    mission = rover(3)
    sensor = mission.sensors["landmarks"]
    assert isinstance(sensor.series, LandmarkSeries)
    t = np.unique(np.append(0.0, sensor.series.t))
    seen = SightedPoints(np.searchsorted(t, sensor.series.t), *level_points(sensor.series, sensor))
    motion = planar_motion(mission, load_config(None, []).motion)
    assert motion is not None
    number = tracklets(t, seen, motion)
    true = sensor.series.id
    assert all(len(np.unique(true[number == k])) == 1 for k in range(number.max() + 1))
    assert number.max() + 1 < 0.1 * len(number)
    assert noise_found(t, seen, motion) == 1.0  # the stated noise is the true one
    loose = replace(seen, cov_b=1e4 * seen.cov_b)
    assert noise_found(t, loose, motion) < 0.1
