"""Where a mission begins, from its first sightings of surveyed landmarks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rovers import LANDMARKS_N, rover, rows_of, series

from gtsam_nav.frames import Array, rotation_from_rpy, wrap_angle
from gtsam_nav.mission import LandmarkMap, Mission
from gtsam_nav.preprocess.alignment import Alignment
from gtsam_nav.preprocess.landmark_start import landmark_start
from gtsam_nav.preprocess.planar_motion import planar_motion
from gtsam_nav.preprocess.settings import MotionSettings
from gtsam_nav.sensors.settings import LandmarkSettings
from gtsam_nav.series import LandmarkSeries

both = pytest.mark.parametrize("association", ["ids", "nearest"])


def start_of(mission: Mission, association: str = "ids") -> Alignment | None:
    motion = planar_motion(mission, MotionSettings())
    assert motion is not None
    settings = LandmarkSettings.model_validate({"association": association})
    return landmark_start(mission, motion, settings)


def rows(mission: Mission) -> Array:
    seen = mission.sensors["landmarks"].series
    assert isinstance(seen, LandmarkSeries)
    return rows_of(seen)


def with_rows(mission: Mission, given: Array) -> Mission:
    return mission.with_sensor(replace(mission.sensors["landmarks"], series=series(given)))


def assert_at_start(found: Alignment | None, atol: float = 0.15) -> None:
    assert found is not None
    np.testing.assert_allclose(found.p_n, [2.0, -1.0, 0.0], atol=atol)
    assert abs(wrap_angle(found.rpy[2])) < atol
    assert found.georeferenced
    assert found.heading_known
    assert found.t == 0.0


@both
@pytest.mark.parametrize("seed", range(4))
def test_the_start_is_found(seed: int, association: str) -> None:
    assert_at_start(start_of(rover(seed=seed), association))


def test_its_sigmas_are_honest() -> None:
    errors = []
    for seed in range(10):
        found = start_of(rover(seed=seed, duration_s=10.0))
        assert found is not None
        sigma = np.append(found.sigma_p[:2], found.sigma_rpy[2])
        errors.append(np.append(found.p_n[:2] - [2.0, -1.0], found.rpy[2]) / sigma)
    assert 0.4 < np.sqrt(np.mean(np.square(errors))) < 1.6


@both
def test_one_false_sighting_does_no_harm(association: str) -> None:
    mission = rover(seed=1)
    spoilt = rows(mission)
    spoilt[1, 2:] = 1.5, -1.0
    assert_at_start(start_of(with_rows(mission, spoilt), association))


@both
def test_a_first_sighting_that_comes_late_tells_the_start(association: str) -> None:
    mission = rover(seed=2)
    late = rows(mission)
    found = start_of(with_rows(mission, late[late[:, 0] > 6.0]), association)
    assert_at_start(found, atol=0.5)
    early = start_of(mission, association)
    assert early is not None
    assert found is not None
    assert found.sigma_rpy[2] > early.sigma_rpy[2]


def test_any_heading_and_place_is_found() -> None:
    mission = rover(seed=3)
    surveyed = mission.landmark_map
    assert surveyed is not None
    for yaw in (1.0, 2.5, -2.0):
        R = rotation_from_rpy([0.0, 0.0, yaw])
        turned = LandmarkMap(surveyed.id, surveyed.p_n @ R.T + [30.0, -20.0, 0.0], surveyed.sigma)
        found = start_of(replace(mission, landmark_map=turned))
        assert found is not None
        np.testing.assert_allclose(found.p_n, R @ [2.0, -1.0, 0.0] + [30.0, -20.0, 0.0], atol=0.15)
        assert abs(wrap_angle(found.rpy[2] - yaw)) < 0.15


def test_one_landmark_tells_nothing() -> None:
    mission = rover(seed=1)
    seen = rows(mission)
    assert start_of(with_rows(mission, seen[seen[:, 1] == 4])) is None


def test_an_ambiguous_map_tells_nothing() -> None:
    # two landmarks 3 m apart, surveyed twice over: without ids both places fit alike
    mission = rover(seed=1)
    pair = LANDMARKS_N[[4, 2]]
    p_n = np.column_stack([np.vstack([pair, pair + 50.0]), np.zeros(4)])
    seen = rows(mission)
    seen = seen[np.isin(seen[:, 1], [4, 2]) & (seen[:, 0] < 20.0)]
    twice = replace(
        mission, landmark_map=LandmarkMap(np.array([4, 2, 14, 12]), p_n, np.full(4, 0.01))
    )
    assert_at_start(start_of(with_rows(twice, seen)), atol=0.3)
    assert start_of(with_rows(twice, seen), "nearest") is None


def test_sightings_of_nothing_on_the_map_tell_nothing() -> None:
    mission = rover(seed=1)
    seen = rows(mission)
    seen[:, 1] += 100
    assert start_of(with_rows(mission, seen)) is None


def test_no_map_and_no_sightings_tell_nothing() -> None:
    mission = rover(seed=1)
    assert start_of(replace(mission, landmark_map=None)) is None
    assert start_of(mission.without("landmarks")) is None
