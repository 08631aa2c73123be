"""Where a mission begins, from ranges alone to surveyed beacons."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rovers import LANDMARKS_N, rover, truth

import gtsam_nav as gn
from gtsam_nav.config import load_config
from gtsam_nav.frames import Array, rotation_from_rpy, wrap_angle
from gtsam_nav.mission import Constraints, LandmarkMap, Mission, Sensor
from gtsam_nav.preprocess.alignment import Alignment
from gtsam_nav.preprocess.landmark_start import landmark_start
from gtsam_nav.preprocess.planar_motion import planar_motion
from gtsam_nav.preprocess.settings import MotionSettings
from gtsam_nav.sensors.settings import LandmarkSettings
from gtsam_nav.series import DepthSeries, DvlSeries, HeadingSeries, LandmarkSeries, OdometrySeries

BEACONS_N = np.array([[40.0, 60.0, 0.0], [55.0, -45.0, 0.0], [-60.0, 10.0, 0.0]])
SIGMA_M = 0.1


def ranged(seed: int = 0, beacons_n: Array = BEACONS_N, depth_m: float = 0.0) -> Mission:
    """The rover, which pings a beacon a second in turn."""
    mission, rng = rover(seed=seed), np.random.default_rng(seed + 1000)
    t, p, _, _ = truth(60.0)
    pings = np.arange(0, len(t), 20)
    id_ = np.arange(len(pings)) % len(beacons_n)
    at = np.column_stack([p[pings], np.full(len(pings), depth_m)])
    range_m = np.linalg.norm(beacons_n[id_] - at, axis=1) + SIGMA_M * rng.normal(size=len(pings))
    series = LandmarkSeries(
        t=t[pings], id=id_, range_m=range_m, sigma_range=np.full(len(pings), SIGMA_M)
    )
    known = LandmarkMap(np.arange(len(beacons_n)), beacons_n, np.full(len(beacons_n), 0.01))
    sensor = Sensor("landmarks", "landmarks", series)
    return replace(mission.with_sensor(sensor), landmark_map=known)


def with_compass(mission: Mission) -> Mission:
    t, _, course, _ = truth(60.0)
    heading = HeadingSeries(t=t, heading=wrap_angle(course), sigma=np.full(len(t), 0.02))
    return mission.with_sensor(Sensor("heading", "heading", heading))


def straight(mission: Mission) -> Mission:
    """Exact ranges along a straight path, which odometry tells."""
    odometry, seen = (mission.sensors[name].series for name in ("odometry", "landmarks"))
    assert isinstance(odometry, OdometrySeries)
    assert isinstance(seen, LandmarkSeries)
    along = np.column_stack([2.0 + 0.5 * seen.t, np.full(len(seen.t), -1.0)])
    range_m = np.linalg.norm(BEACONS_N[seen.id, :2] - along, axis=1)
    ahead = replace(odometry, yaw_rate=0.0 * odometry.yaw_rate)
    return mission.with_sensor(replace(mission.sensors["odometry"], series=ahead)).with_sensor(
        replace(mission.sensors["landmarks"], series=replace(seen, range_m=range_m))
    )


def start_of(mission: Mission) -> Alignment | None:
    motion = planar_motion(mission, MotionSettings())
    assert motion is not None
    return landmark_start(mission, motion, LandmarkSettings())


def only(mission: Mission, *ids: int) -> Mission:
    seen = mission.sensors["landmarks"]
    chosen = seen.series.select(np.isin(seen.series.id, ids))  # type: ignore[attr-defined]
    return mission.with_sensor(replace(seen, series=chosen))


def assert_at_start(found: Alignment | None, atol: float = 0.3) -> None:
    assert found is not None
    np.testing.assert_allclose(found.p_n, [2.0, -1.0, 0.0], atol=atol)
    assert abs(wrap_angle(found.rpy[2])) < atol
    assert found.georeferenced
    assert found.heading_known


@pytest.mark.parametrize("seed", range(3))
def test_three_beacons_tell_place_and_heading(seed: int) -> None:
    assert_at_start(start_of(ranged(seed)))


def test_its_sigmas_are_honest() -> None:
    errors = []
    for seed in range(12):
        found = start_of(ranged(seed))
        assert found is not None
        sigma = np.append(found.sigma_p[:2], found.sigma_rpy[2])
        errors.append(np.append(found.p_n[:2] - [2.0, -1.0], found.rpy[2]) / sigma)
    assert 0.5 < np.sqrt(np.mean(np.square(errors))) < 1.5


def test_any_heading_and_place_is_found() -> None:
    for yaw in (1.0, 2.5, -2.0):
        R, p = rotation_from_rpy([0.0, 0.0, yaw]), np.array([300.0, -200.0, 0.0])
        mission = ranged(3)
        known = LandmarkMap(np.arange(3), BEACONS_N @ R.T + p, np.full(3, 0.01))
        found = start_of(replace(mission, landmark_map=known))
        assert found is not None
        np.testing.assert_allclose(found.p_n, R @ [2.0, -1.0, 0.0] + p, atol=0.3)
        assert abs(wrap_angle(found.rpy[2] - yaw)) < 0.3


def test_false_ranges_among_them_do_no_harm() -> None:
    mission = ranged(1)
    seen = mission.sensors["landmarks"].series
    assert isinstance(seen, LandmarkSeries)
    assert seen.range_m is not None
    spoilt = seen.range_m.copy()
    spoilt[2::9] += 25.0
    sensor = replace(mission.sensors["landmarks"], series=replace(seen, range_m=spoilt))
    assert_at_start(start_of(mission.with_sensor(sensor)))


def test_two_beacons_leave_two_mirrored_places_of_a_straight_path() -> None:
    assert start_of(straight(only(ranged(), 0, 1))) is None
    assert_at_start(start_of(straight(ranged())), atol=0.5)


def test_one_beacon_tells_the_place_beside_a_compass_only() -> None:
    mission = only(ranged(2), 0)
    assert start_of(mission) is None
    assert_at_start(start_of(with_compass(mission)), atol=2.0)


def test_slant_ranges_from_below_are_level_ones_by_the_depth() -> None:
    deep = BEACONS_N + np.array([0.0, 0.0, 50.0])
    mission = ranged(4, deep, depth_m=10.0)
    t = np.arange(0.0, 60.0, 0.5)
    depth = DepthSeries(t=t, depth_m=np.full(len(t), 10.0), sigma=np.full(len(t), 0.1))
    found = start_of(mission.with_sensor(Sensor("depth", "depth", depth)))
    assert found is not None
    np.testing.assert_allclose(found.p_n, [2.0, -1.0, 10.0], atol=0.5)


@pytest.mark.parametrize("method", ["graph", "landmark-ekf"])
def test_a_depth_that_nothing_measures_is_said(method: str) -> None:
    mission = rover(seed=3).crop(0.0, 10.0)
    deep_n = np.column_stack([LANDMARKS_N, np.full(len(LANDMARKS_N), 5.0)])
    known = LandmarkMap(np.arange(len(deep_n)), deep_n, np.full(len(deep_n), 0.1))
    for level in (False, True):
        stays = replace(mission, landmark_map=known, constraints=Constraints(constant_depth=level))
        said = gn.estimate(stays, method).warnings
        assert any("constant_depth" in warning for warning in said) is not level


def test_the_depth_of_what_rolls_by_the_configuration_is_that_of_its_start() -> None:
    mission = ranged(4, BEACONS_N + np.array([0.0, 0.0, 20.0]))
    wheels = load_config(None, ["motion.nonholonomic=true"])
    solution = gn.estimate(mission, "graph", wheels)
    np.testing.assert_allclose(solution.trajectory.p_n[:, 2], 0.0, atol=0.05)
    assert not any("nothing measures the depth" in warning for warning in solution.warnings)


def test_ranges_to_deeper_beacons_tell_the_depth() -> None:
    mission = ranged(4, BEACONS_N + np.array([0.0, 0.0, 20.0]), depth_m=8.0)
    solution = gn.estimate(mission, "graph")
    path = solution.trajectory
    assert path.cov_pose_n is not None
    sigma_m = np.sqrt(path.cov_pose_n[:, 2, 2])
    assert np.all(np.abs(path.p_n[:, 2] - 8.0) < 3.0 * sigma_m)
    assert np.all(sigma_m < 1.0)
    score = gn.evaluate(solution, mission.reference)
    assert score.ate.none.rmse < 0.3
    assert score.nees is not None
    assert score.nees.mean < 4.0


@pytest.mark.parametrize("depth_m", [40.0, 80.0])
def test_a_mission_that_begins_deep_finds_its_start(depth_m: float) -> None:
    """Its slant ranges are shorter than the beacons are deep."""
    mission = ranged(4, BEACONS_N + np.array([0.0, 0.0, 100.0]), depth_m=depth_m)
    found = start_of(mission)
    assert found is not None
    np.testing.assert_allclose(found.p_n, [2.0, -1.0, depth_m], atol=1.5)


def test_ranges_without_ids_tell_nothing() -> None:
    mission = ranged()
    seen = mission.sensors["landmarks"]
    nameless = replace(seen.series, id=np.full(len(seen.series), -1))
    assert start_of(mission.with_sensor(replace(seen, series=nameless))) is None


def test_the_graph_is_georeferenced_by_them() -> None:
    mission = ranged(5)
    solution = gn.estimate(mission, "graph")
    assert solution.georeferenced
    score = gn.evaluate(solution, mission.reference)
    assert score.ate.none.rmse < 0.3


def test_far_beacons_tell_no_tilt_that_nothing_measures() -> None:
    mission = with_compass(ranged(6, 3.0 * BEACONS_N + np.array([0.0, 0.0, 25.0])))
    t = mission.sensors["odometry"].series.t
    v_d = np.tile([0.5, 0.0, 0.0], (len(t), 1))
    good = np.ones(len(t), dtype=bool)
    dvl = DvlSeries(t=t, v_d=v_d, sigma=np.full(len(t), 0.02), valid=good, bottom_lock=good)
    depth = DepthSeries(t=t, depth_m=np.zeros(len(t)), sigma=np.full(len(t), 0.05))
    mission = mission.without("odometry").with_sensor(Sensor("dvl", "dvl", dvl))
    solution = gn.estimate(mission.with_sensor(Sensor("depth", "depth", depth)), "graph")
    assert not any("settled" in warning for warning in solution.warnings)
    assert gn.evaluate(solution, mission.reference).ate.none.rmse < 0.2
