"""Landmarks as states: ground robots, vehicles with a DVL, and an IMU alone."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import gtsam
import numpy as np
import pytest
from rovers import rover

import gtsam_nav as gn
from gtsam_nav.frames import rotation_from_rpy, wrap_angle
from gtsam_nav.graph import factors
from gtsam_nav.graph.factors import L, S, X
from gtsam_nav.graph.measurements.landmarks import TOO_NEAR
from gtsam_nav.graph.measurements.sightings import Seen, SightingFactors
from gtsam_nav.graph.robust import Robustness
from gtsam_nav.mission import InitialState, LandmarkMap, Mission, Sensor
from gtsam_nav.preprocess.landmark_placing import NO_PARALLAX
from gtsam_nav.sensors.landmarks import Sighting, observe, predict
from gtsam_nav.sensors.prediction import BodyState
from gtsam_nav.series import LandmarkSeries
from gtsam_nav.simulation.marina import marina
from gtsam_nav.simulation.settings import LandmarkSimulation, SimulationSettings
from gtsam_nav.solution import Solution

WORLD = marina()
CLEAR_WATER = SimulationSettings(landmarks=LandmarkSimulation(max_range_m=20.0))


@pytest.fixture(scope="module")
def mission() -> Mission:
    return gn.simulate("marina", seed=5, duration_s=150.0, settings=CLEAR_WATER).without("sonar")


@pytest.fixture(scope="module")
def robot(mission: Mission) -> Mission:
    """Odometry and sightings, and nothing else."""
    return mission.without("dvl", "imu", "gnss", "heading", "attitude", "depth")


@pytest.fixture(scope="module")
def survey() -> LandmarkMap:
    return LandmarkMap(WORLD.landmark_id, WORLD.landmarks_n, np.full(len(WORLD.landmark_id), 0.05))


def factor_of(seen: Seen, states: dict[int, Any]) -> Any:
    (factor,) = SightingFactors([seen])([0], states.__getitem__)
    return factor


def se2_rmse_m(solution: Solution) -> float:
    errors = gn.evaluate(solution).ate.se2
    assert errors is not None
    return errors.rmse


def test_sightings_hold_a_robot_on_its_course(robot: Mission) -> None:
    solution = gn.estimate(robot, "graph")
    assert se2_rmse_m(solution) < 0.6 * se2_rmse_m(gn.estimate(robot.without("landmarks"), "graph"))
    assert not solution.georeferenced
    trajectory = solution.trajectory
    np.testing.assert_allclose(trajectory.rpy[:, :2], 0.0, atol=1e-2)
    np.testing.assert_allclose(trajectory.p_n[:, 2], 0.0, atol=1e-2)


@pytest.mark.slow
def test_learnt_landmarks_are_where_their_covariance_says(mission: Mission) -> None:
    """With GNSS and a compass the frame is the world's own."""
    solution = gn.estimate(mission, "graph")
    learnt = solution.landmarks
    assert learnt is not None
    assert len(learnt.id) >= 2
    np.testing.assert_array_equal(learnt.id, np.sort(learnt.id))
    for landmark, p_n, cov_n in zip(learnt.id, learnt.p_n, learnt.cov_n, strict=True):
        off = (p_n - WORLD.landmarks_n[WORLD.landmark_id == landmark][0])[:2]
        assert off @ np.linalg.solve(cov_n[:2, :2], off) < 16.0
        np.testing.assert_array_equal(cov_n[2], 0.0)  # no sighting tells how deep it is


def test_a_surveyed_map_places_a_robot_that_knows_nothing(
    robot: Mission, survey: LandmarkMap
) -> None:
    solution = gn.estimate(replace(robot, landmark_map=survey), "graph")
    assert solution.georeferenced
    errors = gn.evaluate(solution).ate.none
    assert errors is not None
    assert errors.rmse < 0.6


def test_the_map_can_be_left_out(robot: Mission, survey: LandmarkMap) -> None:
    mapped = replace(robot, landmark_map=survey)
    ignoring = gn.estimate(mapped, "graph", gn.load_config(None, ["landmarks.use_map=false"]))
    np.testing.assert_array_equal(
        ignoring.trajectory.p_n, gn.estimate(robot, "graph").trajectory.p_n
    )


@pytest.mark.slow
def test_false_sightings_are_rejected_and_do_no_harm(robot: Mission) -> None:
    sensor = robot.sensors["landmarks"]
    series = sensor.series
    assert isinstance(series, LandmarkSeries)
    false = np.arange(len(series)) % 10 == 3
    bearing = np.where(false, wrap_angle(series.bearing + 1.5), series.bearing)
    faulty = robot.with_sensor(replace(sensor, series=replace(series, bearing=bearing)))
    solution = gn.estimate(faulty, "graph")
    rejected = {r.index for r in solution.rejections if r.reason == "sighting outlier"}
    assert set(np.flatnonzero(false)) <= rejected
    assert len(rejected) <= np.sum(false) + 3
    assert se2_rmse_m(solution) < 1.3 * se2_rmse_m(gn.estimate(robot, "graph"))


def test_sightings_without_an_id_are_recorded(robot: Mission) -> None:
    sensor = robot.sensors["landmarks"]
    series = sensor.series
    assert isinstance(series, LandmarkSeries)
    unknown = np.arange(len(series)) % 4 == 0
    blind = replace(series, id=np.where(unknown, -1, series.id))
    solution = gn.estimate(robot.with_sensor(replace(sensor, series=blind)), "graph")
    recorded = [r.index for r in solution.rejections if r.reason == "unknown landmark"]
    np.testing.assert_array_equal(recorded, series.row[unknown])


def test_sightings_that_all_lack_an_id_are_said_to_be_unused(robot: Mission) -> None:
    sensor = robot.sensors["landmarks"]
    series = sensor.series
    assert isinstance(series, LandmarkSeries)
    blind = robot.with_sensor(replace(sensor, series=replace(series, id=np.full(len(series), -1))))
    (said,) = [w for w in gn.estimate(blind, "graph").warnings if "no id" in w]
    assert f"{len(series)} of {len(series)} sightings" in said
    assert "landmarks.association=joint" in said
    joint = gn.load_config(None, ["landmarks.association=joint"])
    assert not [w for w in gn.estimate(blind, "graph", joint).warnings if "no id" in w]


def test_a_landmark_seen_once(robot: Mission) -> None:
    sensor = robot.sensors["landmarks"]
    series = sensor.series
    assert isinstance(series, LandmarkSeries)
    once = series.id.copy()
    once[len(once) // 2] = 77
    solution = gn.estimate(robot.with_sensor(replace(sensor, series=replace(series, id=once))))
    assert solution.landmarks is not None
    assert 77 in solution.landmarks.id


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_an_imu_between_two_looks_at_landmarks(seed: int) -> None:
    """The simulated runs of the published robot: INS alone is out by a decimetre."""
    mission = gn.simulate("ranger", seed=seed)
    solution = gn.estimate(mission, "graph")
    alone = gn.estimate(mission.without("landmarks"), "graph")
    assert mission.reference is not None
    truth: np.ndarray = mission.reference.series.p_n[-1]  # type: ignore[attr-defined]
    off = solution.trajectory.p_n[-1] - truth
    cov = solution.trajectory.cov_pose_n
    assert cov is not None
    assert off[:2] @ np.linalg.solve(cov[-1, :2, :2], off[:2]) < 14.0
    assert cov[-1, 0, 0] < 0.5 * alone.trajectory.cov_pose_n[-1, 0, 0]  # type: ignore[index]


@pytest.mark.slow
def test_elevations_tell_how_deep_a_landmark_is() -> None:
    """Ten minutes of the submarine: inertial navigation, depth, beacons in three dimensions."""
    mission = gn.simulate("submarine", seed=1, duration_s=600.0)
    solution = gn.estimate(mission, "graph")
    assert solution.landmarks is not None
    np.testing.assert_allclose(solution.landmarks.p_n[:, 2], 80.0, atol=4.0)
    assert np.all(np.diagonal(solution.landmarks.cov_n, axis1=1, axis2=2) > 0)
    errors = gn.evaluate(solution).ate.none
    assert errors is not None
    assert errors.rmse < 10.0


@pytest.mark.parametrize("flat_first", [True, False])
def test_a_sensor_without_elevations_pins_no_depth_that_another_tells(flat_first: bool) -> None:
    mission = gn.simulate("submarine", seed=1, duration_s=100.0)
    told = mission.sensors["landmarks"]
    assert isinstance(told.series, LandmarkSeries)
    early = told.series.select(told.series.t < 40.0)
    flat = replace(told, name="flat", series=replace(early, elevation=None))
    others = mission.without("landmarks").sensors
    seeing = (flat, told) if flat_first else (told, flat)
    both = replace(mission, sensors={**others, **{sensor.name: sensor for sensor in seeing}})
    learnt = gn.estimate(both, "graph").landmarks
    assert learnt is not None
    sigma = np.sqrt(learnt.cov_n[:, 2, 2])
    assert np.all(sigma > 0)
    np.testing.assert_array_less(np.abs(learnt.p_n[:, 2] - 80.0), 4.0 * sigma)


def test_a_stated_start_places_the_landmarks(robot: Mission) -> None:
    stated = replace(robot, initial=InitialState(np.array([100.0, -50.0, 0.0]), 0.1, 1.0, 0.01))
    solution, local = gn.estimate(stated, "graph"), gn.estimate(robot, "graph")
    assert solution.georeferenced
    assert solution.landmarks is not None
    assert local.landmarks is not None
    c, s = np.cos(1.0), np.sin(1.0)
    turned = local.landmarks.p_n[:, :2] @ np.array([[c, s], [-s, c]]) + [100.0, -50.0]
    np.testing.assert_allclose(solution.landmarks.p_n[:, :2], turned, atol=0.2)


@pytest.mark.parametrize(("elevation", "level"), [(False, False), (False, True), (True, False)])
def test_a_made_factor_is_that_of_the_sensor_model(elevation: bool, level: bool) -> None:
    rng = np.random.default_rng(3)
    sensor = Sensor(
        name="landmarks",
        type="landmarks",
        series=gn.simulate("ranger", seed=0).sensors["landmarks"].series,
        xyz_b=rng.normal(size=3),
        R_bs=rotation_from_rpy([0.1, -0.2, 0.7]),
    )
    R_nb, p_n, landmark_n = rotation_from_rpy([0.1, 0.05, 2.5]), rng.normal(size=3), np.ones(3) * 4
    body = BodyState(R_nb, p_n, np.zeros(3))
    seen = Sighting(5.0, 3.0, 0.4 if elevation else None, 0.2, 0.05)
    model = observe(body, landmark_n[None], sensor, elevation=elevation, level=np.array([level]))
    states = {
        int(X(0)): factors.nav_state(R_nb, p_n, np.zeros(3)),
        int(L(0)): factors.nav_state(np.eye(3), landmark_n, np.zeros(3)),
    }
    values = gtsam.Values()
    for key, state in states.items():
        values.insert(key, state)
    made = factor_of(Seen(0, int(L(0)), seen, sensor, level, excess=2.0), states)
    A, b = made.linearize(values).jacobian()
    m = len(seen.measured)
    whiten = np.linalg.inv(np.linalg.cholesky(2.0 * seen.cov))
    by_key = dict(zip(list(made.keys()), np.split(A[:m], 2, axis=1), strict=True))
    np.testing.assert_allclose(-b[:m], whiten @ model.residual(seen.measured)[0], atol=1e-9)
    np.testing.assert_allclose(by_key[X(0)], whiten @ model.jacobian_body[0], atol=1e-9)
    by_landmark = whiten @ model.jacobian_landmark[0]
    np.testing.assert_allclose(by_key[L(0)][:, 3:6], by_landmark, atol=1e-9)
    assert not np.any(A[m:])
    assert not np.any(b[m:])


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 3])
def test_an_imu_and_level_sightings_hold_the_place_but_not_the_height(seed: int) -> None:
    """Where accelerometers alone tell the height it runs away, and must not take all along."""
    solution = gn.estimate(gn.simulate("ranger", seed=seed, duration_s=150.0), "graph")
    errors = gn.evaluate(solution).ate.none
    assert errors is not None
    assert errors.max < 0.2
    assert not any("settled" in warning for warning in solution.warnings)
    (warning,) = [w for w in solution.warnings if w.startswith("nothing measures the height")]
    assert solution.trajectory.cov_pose_n is not None
    sigma_d = np.sqrt(solution.trajectory.cov_pose_n[-1, 2, 2])
    assert f"grows to {sigma_d:.0f} m at" in warning
    assert abs(solution.trajectory.p_n[-1, 2]) < 3.0 * sigma_d


def spoilt(robot: Mission, **columns: object) -> Mission:
    """The robot with other sightings."""
    sensor = robot.sensors["landmarks"]
    assert isinstance(sensor.series, LandmarkSeries)
    return robot.with_sensor(replace(sensor, series=replace(sensor.series, **columns)))


@pytest.mark.slow
def test_a_landmark_at_no_distance_is_placed_by_a_later_sighting(robot: Mission) -> None:
    series = robot.sensors["landmarks"].series
    assert isinstance(series, LandmarkSeries)
    assert series.range_m is not None
    range_m = series.range_m.copy()
    first = int(np.argmax(series.id == series.id[-1]))
    range_m[first] = 0.0
    solution = gn.estimate(spoilt(robot, range_m=range_m), "graph")
    assert first in {r.index for r in solution.rejections if r.reason == "sighting outlier"}
    assert se2_rmse_m(solution) < 1.3 * se2_rmse_m(gn.estimate(robot, "graph"))


def test_a_landmark_only_seen_at_no_distance_is_said_and_not_used(robot: Mission) -> None:
    series = robot.sensors["landmarks"].series
    assert isinstance(series, LandmarkSeries)
    assert series.range_m is not None
    ids, range_m = series.id.copy(), series.range_m.copy()
    ids[7], range_m[7] = 99, 0.0
    solution = gn.estimate(spoilt(robot, id=ids, range_m=range_m), "graph")
    assert f"landmark 99 is not used: {TOO_NEAR}" in solution.warnings
    assert [r.index for r in solution.rejections if r.reason == TOO_NEAR] == [7]
    assert solution.landmarks is not None
    assert 99 not in solution.landmarks.id


@pytest.mark.parametrize("kind", ["range", pytest.param("bearing", marks=pytest.mark.slow)])
def test_ranges_or_bearings_alone_hold_a_rover_on_its_course(kind: str) -> None:
    other = "bearing" if kind == "range" else "range"
    lacking = {"range": "range_m", "bearing": "bearing"}[other]
    mission = spoilt(replace(rover(), landmark_map=None), **{lacking: None, f"sigma_{other}": None})
    solution = gn.estimate(mission, "graph")
    alone = gn.estimate(mission.without("landmarks"), "graph")
    assert solution.landmarks is not None
    assert len(solution.landmarks.id) >= 6
    assert se2_rmse_m(solution) < 0.5 * se2_rmse_m(alone)


def test_a_landmark_without_parallax_is_said_and_not_used(robot: Mission) -> None:
    """Two bearings are too few to place anything."""
    series = robot.sensors["landmarks"].series
    assert isinstance(series, LandmarkSeries)
    ids = series.id.copy()
    ids[5:7] = 99
    looking = spoilt(robot, id=ids, range_m=None, sigma_range=None)
    solution = gn.estimate(looking, "graph")
    assert f"landmark 99 is not used: {NO_PARALLAX}" in solution.warnings
    assert {5, 6} <= {r.index for r in solution.rejections if r.reason == NO_PARALLAX}


def test_a_range_scale_is_found_with_an_honest_sigma(robot: Mission) -> None:
    """Ranges 5 % too long: the odometry tells, within the spread of its own scale."""
    sensor = robot.sensors["landmarks"]
    assert isinstance(sensor.series, LandmarkSeries)
    assert sensor.series.range_m is not None
    long = replace(sensor.series, range_m=1.05 * sensor.series.range_m)
    doubtful = {**sensor.noise, "range_scale_sigma": 0.1}
    solution = gn.estimate(robot.with_sensor(replace(sensor, series=long, noise=doubtful)), "graph")
    assert solution.slow_states is not None
    scale, sigma = solution.slow_states.columns["landmarks_range_scale"]
    assert 0.001 < sigma[0] < 0.08
    assert abs(scale[0] - 0.05) < 3 * sigma[0]
    trusting = gn.estimate(robot.with_sensor(replace(sensor, series=long)), "graph")
    assert se2_rmse_m(solution) < se2_rmse_m(trusting) + 0.02


@pytest.mark.parametrize("seed", range(4))
def test_a_scaled_sighting_is_that_of_the_sensor_model(seed: int) -> None:
    """Residual and Jacobians in body, landmark and scale; and numerically."""
    rng = np.random.default_rng(seed)
    sensor = Sensor(
        name="landmarks",
        type="landmarks",
        series=gn.simulate("ranger", seed=0).sensors["landmarks"].series,
        xyz_b=rng.normal(size=3),
        R_bs=rotation_from_rpy(rng.normal(size=3)),
    )
    R_nb, p_n, landmark_n = rotation_from_rpy([0.1, 0.05, 2.5]), rng.normal(size=3), np.ones(3) * 4
    seen = Sighting(5.0, 3.0 if seed % 2 else None, None, 0.2, 0.05)
    states = {
        int(X(0)): factors.nav_state(R_nb, p_n, np.zeros(3)),
        int(L(0)): factors.nav_state(np.eye(3), landmark_n, np.zeros(3)),
        int(S(0)): factors.nav_state(np.eye(3), np.array([0.07, 0.0, 0.0]), np.zeros(3)),
    }
    values = gtsam.Values()
    for key, state in states.items():
        values.insert(key, state)
    factor = factor_of(Seen(0, int(L(0)), seen, sensor, False, scale_key=int(S(0))), states)
    body = BodyState(R_nb, p_n, np.zeros(3))
    model = predict(body, landmark_n, seen, sensor, range_scale=0.07)
    whiten = np.diag(1 / np.sqrt(np.diag(model.cov)))
    np.testing.assert_allclose(factor.whitenedError(values), whiten @ model.residual, atol=1e-9)
    linear = factor.linearize(values)
    A, _ = linear.jacobian()
    first = {key: 9 * n for n, key in enumerate(linear.keys())}
    at_x, at_l, at_s = (first[int(key)] for key in (X(0), L(0), S(0)))
    np.testing.assert_allclose(A[:, at_x : at_x + 9], whiten @ model.jacobian, atol=1e-9)
    np.testing.assert_allclose(
        A[:, at_l + 3 : at_l + 6], whiten @ model.jacobian_landmark, atol=1e-9
    )
    np.testing.assert_allclose(A[:, at_s + 3], whiten @ model.jacobian_scale, atol=1e-9)
    step = 1e-6
    ahead, behind = (
        predict(body, landmark_n, seen, sensor, range_scale=0.07 + off).residual
        for off in (step, -step)
    )
    np.testing.assert_allclose(model.jacobian_scale, (ahead - behind) / (2 * step), atol=1e-5)
    # a kernel's weight is that of the residual where the factor was made
    weighed = factors.robust(factor, Robustness(kernel="cauchy", threshold=1.0))
    squared = float(np.sum((whiten @ model.residual) ** 2))
    np.testing.assert_allclose(2 * weighed.error(values), squared / (1 + squared), rtol=1e-6)


def test_a_level_landmark_knows_no_depth_beside_a_range_scale_either() -> None:
    """A tilt must not count for more the deeper the body is."""
    series = gn.simulate("ranger", seed=0).sensors["landmarks"].series
    sensor = Sensor(name="landmarks", type="landmarks", series=series)
    seen = Sighting(5.0, 0.9, None, 0.2, 0.05)
    found = []
    for depth_m in (0.0, 500.0):
        states = {
            int(X(0)): factors.nav_state(np.eye(3), np.array([0.0, 0.0, depth_m]), np.zeros(3)),
            int(L(0)): factors.nav_state(np.eye(3), np.array([3.0, 4.0, 0.0]), np.zeros(3)),
            int(S(0)): factors.nav_state(np.eye(3), np.zeros(3), np.zeros(3)),
        }
        values = gtsam.Values()
        for key, state in states.items():
            values.insert(key, state)
        made = factor_of(Seen(0, int(L(0)), seen, sensor, True, scale_key=int(S(0))), states)
        found.append(made.linearize(values).jacobian())
    np.testing.assert_allclose(found[0][0], found[1][0], atol=1e-9)
    np.testing.assert_allclose(found[0][1], found[1][1], atol=1e-9)


def test_a_quiet_vehicle_starts_at_rest_in_the_graph_too() -> None:
    """Nothing but its IMU tells of it: the first sigmas of the velocity are those of rest."""
    solution = gn.estimate(gn.simulate("ranger", seed=3), "graph")
    assert solution.trajectory.sigma_v_n is not None
    assert np.all(solution.trajectory.sigma_v_n[0] < 0.02)
