"""Missions whose sightings have no ids, or none that are looked at."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rovers import LANDMARKS_N, rover

from gtsam_nav import simulate
from gtsam_nav.config import load_config
from gtsam_nav.errors import DataError
from gtsam_nav.mission import Mission
from gtsam_nav.preprocess.identified import NO_MAP, identified
from gtsam_nav.sensors.association import NONE
from gtsam_nav.sensors.settings import LandmarkSettings
from gtsam_nav.series import IntArray, LandmarkSeries

CONFIG = load_config(None, ["landmarks.association=joint"])


def sightings(mission: Mission) -> LandmarkSeries:
    series = mission.sensors["landmarks"].series
    assert isinstance(series, LandmarkSeries)
    return series


def agree(found: IntArray, true: IntArray) -> None:
    """One number for each landmark, and another for each other."""
    pairs = {(int(a), int(b)) for a, b in zip(found, true, strict=True) if a >= 0}
    assert len(pairs) == len({a for a, _ in pairs}) == len({b for _, b in pairs})


@pytest.mark.parametrize("association", ["joint", "nearest"])
def test_ids_of_its_own_are_those_of_the_sensor(association: str) -> None:
    mission = rover(2)
    settings = LandmarkSettings(association=association, use_map=False)
    found = sightings(identified(mission, CONFIG.motion, settings)).id
    agree(found, sightings(mission).id)
    assert np.mean(found >= 0) > 0.99
    assert len(np.unique(found[found >= 0])) == len(LANDMARKS_N)
    # in the order of discovery
    _, first = np.unique(found[found >= 0], return_index=True)
    assert np.all(np.diff(first) > 0)


def test_the_sensors_own_ids_are_not_looked_at() -> None:
    mission = rover(1, duration_s=20.0)
    sensor, series = mission.sensors["landmarks"], sightings(mission)
    blind = mission.with_sensor(replace(sensor, series=replace(series, id=0 * series.id - 1)))
    one, other = (
        sightings(identified(m, CONFIG.motion, CONFIG.landmarks)).id for m in (mission, blind)
    )
    np.testing.assert_array_equal(one, other)


def test_the_surveyed_map_is_given_up_and_that_is_said() -> None:
    found = identified(rover(0, duration_s=10.0), CONFIG.motion, CONFIG.landmarks)
    assert found.landmark_map is None
    assert NO_MAP in found.warnings


@pytest.mark.parametrize("association", ["joint", "nearest"])
def test_an_imu_alone_is_enough(association: str) -> None:
    """Over two minutes in which its path runs away by many times the landmarks' distance."""
    mission = simulate("ranger", seed=1, duration_s=120.0)
    settings = LandmarkSettings(association=association)
    found = sightings(identified(mission, CONFIG.motion, settings)).id
    agree(found, sightings(mission).id)
    assert np.mean(found >= 0) > 0.97


def test_without_any_motion_there_is_no_association() -> None:
    mission = rover(0, duration_s=10.0).without("odometry")
    with pytest.raises(DataError, match="the motion needs a DVL with valid samples, odometry or"):
        identified(mission, CONFIG.motion, CONFIG.landmarks)


def test_two_sensors_of_landmarks_are_not_told_apart() -> None:
    mission = rover(0, duration_s=10.0)
    other = replace(mission.sensors["landmarks"], name="other")
    with pytest.raises(DataError, match="single sensor of landmarks; there are landmarks, other"):
        identified(mission.with_sensor(other), CONFIG.motion, CONFIG.landmarks)


def test_what_was_seen_once_is_of_no_landmark() -> None:
    mission = rover(1, duration_s=20.0)
    series = sightings(mission)
    assert series.range_m is not None
    k = len(series) // 2
    stray = series.range_m.copy()
    stray[k] += 30.0
    sensor = replace(mission.sensors["landmarks"], series=replace(series, range_m=stray))
    found = sightings(identified(mission.with_sensor(sensor), CONFIG.motion, CONFIG.landmarks)).id
    assert found[k] == NONE
    agree(found, series.id)
