"""Sightings without ids: tracklets, the planar map beneath, and what is merged."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rovers import LANDMARKS_N, rover

from gtsam_nav.config import load_config
from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission
from gtsam_nav.preprocess.identified import NO_MAP, identified
from gtsam_nav.preprocess.landmark_identity import Coincidences
from gtsam_nav.preprocess.planar_map import PlanarMap
from gtsam_nav.preprocess.planar_motion import planar_motion
from gtsam_nav.preprocess.planar_smoothing import SightedPoints
from gtsam_nav.preprocess.tracklets import noise_found, tracklets
from gtsam_nav.sensors.landmarks import level_points
from gtsam_nav.sensors.settings import LandmarkSettings
from gtsam_nav.series import IntArray, LandmarkSeries

CONFIG = load_config(None, ["landmarks.association=joint"])


def sightings(mission: Mission) -> LandmarkSeries:
    series = mission.sensors["landmarks"].series
    assert isinstance(series, LandmarkSeries)
    return series


def seen_points(mission: Mission) -> tuple[Array, SightedPoints]:
    series = sightings(mission)
    t = np.unique(np.append(0.0, series.t))
    p_b, cov_b = level_points(series, mission.sensors["landmarks"])
    return t, SightedPoints(np.searchsorted(t, series.t), p_b, cov_b)


def planar_map(mission: Mission) -> tuple[Array, PlanarMap]:
    t, seen = seen_points(mission)
    motion = planar_motion(mission, CONFIG.motion)
    assert motion is not None
    return t, PlanarMap(motion.increments(t), seen, 0.0, 0.0, 13.8)


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


def test_without_a_measured_speed_there_is_no_association() -> None:
    mission = rover(0, duration_s=10.0).without("odometry")
    with pytest.raises(DataError, match="association=joint needs a DVL or odometry"):
        identified(mission, CONFIG.motion, CONFIG.landmarks)


def test_tracklets_hold_one_landmark_each() -> None:
    mission = rover(3)
    t, seen = seen_points(mission)
    motion = planar_motion(mission, CONFIG.motion)
    assert motion is not None
    number = tracklets(t, seen, motion)
    true = sightings(mission).id
    assert all(len(np.unique(true[number == k])) == 1 for k in range(number.max() + 1))
    assert number.max() + 1 < 0.1 * len(number)
    assert noise_found(t, seen, motion) == 1.0  # the stated noise is the true one
    loose = replace(seen, cov_b=1e4 * seen.cov_b)
    assert noise_found(t, loose, motion) < 0.1


def test_the_planar_map_is_the_truth_where_nothing_errs() -> None:
    mission = replace(rover(0, noise=0.0), landmark_map=None)
    t, solver = planar_map(mission)
    true = sightings(mission).id
    names, of = np.unique(true, return_inverse=True)
    estimate = solver.solve(of, len(t))
    start = np.array([2.0, -1.0])
    np.testing.assert_allclose(estimate.landmarks + start, LANDMARKS_N[names], atol=0.02)
    assert np.nanmax(estimate.squared) < 1.0


def test_the_planar_maps_covariance_covers_its_errors() -> None:
    nees = []
    for seed in range(6):
        mission = rover(seed, duration_s=40.0)
        t, solver = planar_map(mission)
        names, of = np.unique(sightings(mission).id, return_inverse=True)
        estimate = solver.solve(of, len(t))
        off = (estimate.landmarks + np.array([2.0, -1.0]) - LANDMARKS_N[names]).ravel()
        cov = estimate.landmark_cov(np.arange(len(names)))
        nees.append(off @ np.linalg.solve(cov, off) / len(off))
    assert 0.5 < np.mean(nees) < 2.0


def coincidences(fresh: list[list[float]], old: list[list[float]], shared_m: float) -> Coincidences:
    """Fresh landmarks, wrong by 0.1 m each and by far more all alike, against exact ones."""
    p = np.array([*fresh, *old])
    s, n = len(fresh), len(p)
    between = np.zeros((n, n))
    between[:s, :s] = shared_m**2 + 0.1**2 * np.eye(s)
    cov = np.einsum("ab,ij->aibj", between, np.eye(2))
    possible = np.ones((s, n - s), dtype=bool)
    return Coincidences(p, cov, np.arange(s), np.arange(s, n), possible)


def test_what_errs_alike_is_merged_alike() -> None:
    """Each alone would go to its nearest; together they tell that all are off by 1 m."""
    old = [[0.0, 0.0], [2.0, 0.0], [4.0, 0.0]]
    fresh = [[1.1, 0.0], [3.1, 0.0]]
    compared = coincidences(fresh, old, shared_m=0.8)
    assert compared.pairs(LandmarkSettings(association="joint")) in (
        [(0, 0), (1, 1)],
        [(0, 1), (1, 2)],
    )
    # at no shared error nothing fits
    assert coincidences(fresh, old, shared_m=0.0).pairs(CONFIG.landmarks) == []


def test_what_was_seen_apart_is_never_merged() -> None:
    compared = coincidences([[0.0, 0.0]], [[0.0, 0.0]], shared_m=0.5)
    assert compared.pairs(CONFIG.landmarks) == [(0, 0)]
    apart = replace(compared, possible=np.zeros((1, 1), dtype=bool))
    assert apart.pairs(CONFIG.landmarks) == []
