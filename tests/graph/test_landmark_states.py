"""Landmarks as states: ground robots, vehicles with a DVL, and an IMU alone."""

from __future__ import annotations

from dataclasses import replace

import gtsam
import numpy as np
import pytest

import gtsam_nav as gn
from gtsam_nav.frames import rotation_from_rpy, wrap_angle
from gtsam_nav.graph import factors
from gtsam_nav.graph.factors import L, X
from gtsam_nav.graph.measurements.sightings import Seen
from gtsam_nav.mission import InitialState, LandmarkMap, Mission, Sensor
from gtsam_nav.sensors.landmarks import Sighting, observe
from gtsam_nav.sensors.prediction import BodyState
from gtsam_nav.series import LandmarkSeries
from gtsam_nav.simulation.marina import marina
from gtsam_nav.solution import Solution

WORLD = marina()


@pytest.fixture(scope="module")
def mission() -> Mission:
    return gn.simulate("marina", seed=5, duration_s=150.0).without("sonar")


@pytest.fixture(scope="module")
def robot(mission: Mission) -> Mission:
    """Odometry and sightings, and nothing else."""
    return mission.without("dvl", "imu", "gnss", "heading", "attitude", "depth")


@pytest.fixture(scope="module")
def survey() -> LandmarkMap:
    return LandmarkMap(WORLD.landmark_id, WORLD.landmarks_n, np.full(len(WORLD.landmark_id), 0.05))


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
    wanted = factors.sighting(
        X(0),
        L(0),
        R_nb.T @ (landmark_n - p_n),
        model.jacobian_landmark[0] @ R_nb,
        model.residual(seen.measured)[0],
        2.0 * seen.cov,
    )
    states = {
        int(X(0)): factors.nav_state(R_nb, p_n, np.zeros(3)),
        int(L(0)): factors.nav_state(np.eye(3), landmark_n, np.zeros(3)),
    }
    values = gtsam.Values()
    for key, state in states.items():
        values.insert(key, state)
    made = Seen(0, int(L(0)), seen, sensor, level, excess=2.0).make(states.__getitem__)
    for got, want in zip(
        made.linearize(values).jacobian(), wanted.linearize(values).jacobian(), strict=True
    ):
        np.testing.assert_allclose(got, want, atol=1e-9)
