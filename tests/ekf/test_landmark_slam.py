"""Landmark SLAM over whole missions: on a map and without, with ids and without, and spoilt."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rovers import LANDMARKS_N, rover, rows_of, series

import gtsam_nav as gn
from gtsam_nav.ekf.landmark_slam import Track
from gtsam_nav.ekf.sighting_updates import GATED, REPEATED, TOO_NEAR, UNCONFIRMED
from gtsam_nav.errors import DataError, EstimationError
from gtsam_nav.evaluation.metrics import evaluate
from gtsam_nav.frames import Array
from gtsam_nav.mission import InitialState, Mission, Sensor
from gtsam_nav.series import HeadingSeries, LandmarkSeries, OdometrySeries
from gtsam_nav.solution import Solution

MAP, SLAM = (), ("landmarks.use_map=false",)


def seen(mission: Mission) -> Array:
    found = mission.sensors["landmarks"].series
    assert isinstance(found, LandmarkSeries)
    return rows_of(found)


def with_sightings(mission: Mission, rows: Array) -> Mission:
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    return mission.with_sensor(replace(mission.sensors["landmarks"], series=series(rows)))


def estimated(mission: Mission, *overrides: str) -> Solution:
    return gn.estimate(mission, "landmark-ekf", gn.load_config(None, overrides))


def rmse_m(solution: Solution) -> float:
    errors = evaluate(solution).ate
    chosen = errors.none or errors.se2
    assert chosen is not None
    return chosen.rmse


def landmark_errors(solution: Solution) -> Array:
    """Distances of learnt landmarks between each other, against the true ones."""
    assert solution.landmarks is not None
    p, true = solution.landmarks.p_n[:, :2], LANDMARKS_N[solution.landmarks.id]
    return np.array(
        [np.hypot(*(p[0] - q)) - np.hypot(*(true[0] - r)) for q, r in zip(p, true, strict=True)]
    )


def reasons(solution: Solution) -> Counter[str]:
    return Counter(r.reason for r in solution.rejections if r.sensor == "landmarks")


@pytest.fixture(scope="module")
def mission() -> Mission:
    return rover(seed=3)


def test_without_noise_the_path_and_the_map_are_exact() -> None:
    exact = rover(noise=0.0)
    solution = estimated(exact, *SLAM)
    assert rmse_m(solution) < 2e-3
    np.testing.assert_allclose(landmark_errors(solution), 0.0, atol=2e-3)


def test_on_a_map_the_start_is_found_and_the_path_georeferenced(mission: Mission) -> None:
    solution = estimated(mission, *MAP)
    assert solution.georeferenced
    assert rmse_m(solution) < 0.06
    metrics = evaluate(solution)
    assert metrics.coverage == pytest.approx(1.0)
    assert metrics.nees is not None
    assert 0.5 < metrics.nees.mean < 6.0
    assert solution.landmarks is not None
    np.testing.assert_allclose(solution.landmarks.p_n[:, :2], LANDMARKS_N, atol=0.01)


def test_a_map_is_left_alone_on_demand(mission: Mission) -> None:
    solution = estimated(mission, *SLAM)
    assert not solution.georeferenced
    assert solution.landmarks is not None
    np.testing.assert_array_equal(np.sort(solution.landmarks.id), np.arange(len(LANDMARKS_N)))
    assert np.all(np.abs(landmark_errors(solution)) < 0.25)
    assert rmse_m(solution) < 0.12
    start = solution.trajectory
    assert start.cov_pose_n is not None
    np.testing.assert_allclose(start.p_n[0, :2], 0.0, atol=1e-9)
    np.testing.assert_allclose(start.cov_pose_n[0, :2, :2], 0.0, atol=1e-12)


def test_it_beats_the_odometry(mission: Mission) -> None:
    alone = gn.estimate(mission, "dr")
    assert rmse_m(estimated(mission, *SLAM)) < 0.5 * rmse_m(alone)


@pytest.mark.parametrize("association", ["nearest", "joint"])
@pytest.mark.parametrize("use_map", ["true", "false"])
def test_unknown_ids_are_found_out(mission: Mission, association: str, use_map: str) -> None:
    solution = estimated(
        mission, f"landmarks.association={association}", f"landmarks.use_map={use_map}"
    )
    assert rmse_m(solution) < 0.15
    assert solution.landmarks is not None
    assert len(solution.landmarks.id) == len(LANDMARKS_N)


def test_single_unknown_ids_are_found_out_among_known_ones(mission: Mission) -> None:
    rows = seen(mission)
    rows[::3, 1] = -1
    solution = estimated(with_sightings(mission, rows), *SLAM)
    assert rmse_m(solution) < 0.12
    assert solution.landmarks is not None
    assert len(solution.landmarks.id) == len(LANDMARKS_N)


@pytest.mark.parametrize("association", ["ids", "nearest", "joint"])
def test_false_sightings_do_no_harm(mission: Mission, association: str) -> None:
    rng = np.random.default_rng(5)
    rows = seen(mission)
    false = rng.choice(len(rows), len(rows) // 20, replace=False)
    rows[false, 2] = rng.uniform(1.0, 6.0, len(false))
    rows[false, 3] = rng.uniform(-1.2, 1.2, len(false))
    solution = estimated(with_sightings(mission, rows), f"landmarks.association={association}")
    assert rmse_m(solution) < 0.12
    assert sum(reasons(solution).values()) > len(false) // 2


def test_a_landmark_that_is_seen_once_is_not_believed(mission: Mission) -> None:
    rows = np.vstack([seen(mission), [[20.1, 77.0, 3.0, 0.2]]])
    solution = estimated(with_sightings(mission, rows), *SLAM)
    assert solution.landmarks is not None
    assert 77 not in solution.landmarks.id
    assert reasons(solution)[UNCONFIRMED] == 1


def test_a_false_first_sighting_gives_way(mission: Mission) -> None:
    rows = seen(mission)
    first = np.flatnonzero(rows[:, 1] == 2)[0]
    rows[first, 2] += 2.0
    solution = estimated(with_sightings(mission, rows), *SLAM)
    assert np.all(np.abs(landmark_errors(solution)) < 0.25)
    found = [r for r in solution.rejections if r.reason == UNCONFIRMED]
    assert [r.index for r in found] == [first]


def test_every_sighting_is_used_or_rejected_or_places_a_landmark(mission: Mission) -> None:
    rows = seen(mission)
    solution = estimated(mission, *SLAM)
    used = len(solution.innovations["landmarks"].t)
    assert used + sum(reasons(solution).values()) + len(LANDMARKS_N) == len(rows)


def test_the_second_sighting_of_a_landmark_at_one_moment_is_left_out(mission: Mission) -> None:
    rows = seen(mission)
    again = rows[rows[:, 1] == 2][5].copy()
    again[2] += 0.02
    solution = estimated(with_sightings(mission, np.vstack([rows, again])), *MAP)
    assert reasons(solution)[REPEATED] == 1
    assert rmse_m(solution) < 0.06


def test_a_rejected_sighting_says_how_far_off_it_was(mission: Mission) -> None:
    rows = seen(mission)
    k = len(rows) // 2
    rows[k, 2] += 1.5
    found = [r for r in estimated(with_sightings(mission, rows)).rejections if r.reason == GATED]
    assert k in [r.index for r in found]
    assert all(r.normalised_residual is not None and r.normalised_residual > 3 for r in found)


def test_bearings_behind_the_vehicle_are_wrapped() -> None:
    exact = rover(noise=0.0, duration_s=20.0)
    rows = seen(exact)
    truth = exact.reference
    assert truth is not None
    # one more landmark, seen dead astern all the way
    t = np.unique(rows[:, 0])
    p = np.stack([np.interp(t, truth.series.t, c) for c in truth.series.p_n[:, :2].T], axis=1)  # type: ignore[attr-defined]
    course = np.interp(t, truth.series.t, np.unwrap(truth.series.rpy[:, 2]))  # type: ignore[attr-defined]
    offset = np.array([-6.0, -2.0]) - p
    bearing = np.arctan2(offset[:, 1], offset[:, 0]) - course
    astern = np.column_stack([t, np.full(len(t), 50), np.hypot(*offset.T), bearing])
    assert np.any(np.abs(np.diff(np.mod(bearing + np.pi, 2 * np.pi))) > 6)
    solution = estimated(with_sightings(exact, np.vstack([rows, astern])), *SLAM)
    assert rmse_m(solution) < 2e-3
    assert reasons(solution)[GATED] == 0


def test_a_landmark_at_zero_range_is_survived(mission: Mission) -> None:
    rows = np.vstack([seen(mission), [[10.0, 2, 0.0, 0.3], [10.1, 60, 0.0, -2.0]]])
    solution = estimated(with_sightings(mission, rows), *SLAM)
    assert rmse_m(solution) < 0.12
    assert reasons(solution)[TOO_NEAR] == 1


def test_sightings_without_noise_end_in_an_error_of_ours(mission: Mission) -> None:
    sensor = mission.sensors["landmarks"]
    tiny = np.full(len(sensor.series), 1e-200)  # its square underflows
    spoilt = replace(sensor, series=replace(sensor.series, sigma_range=tiny, sigma_bearing=tiny))
    with pytest.raises(EstimationError, match="landmark-ekf diverged"):
        estimated(mission.with_sensor(spoilt), *SLAM)


def test_a_carried_vehicle_finds_its_landmarks_again(mission: Mission) -> None:
    odometry = mission.sensors["odometry"].series
    lost = (odometry.t > 30.0) & (odometry.t < 34.0)
    yaw_rate = odometry.yaw_rate + np.where(lost, 0.5, 0.0)  # type: ignore[attr-defined]
    rows = seen(mission)
    rows = rows[(rows[:, 0] < 30.0) | (rows[:, 0] > 34.0)]
    sensor = replace(
        mission.sensors["odometry"],
        series=replace(odometry, yaw_rate=yaw_rate),  # type: ignore[call-arg]
    )
    solution = estimated(with_sightings(mission.with_sensor(sensor), rows), *MAP)
    late = evaluate(solution, window_s=(45.0, 60.0)).ate.none
    assert late is not None
    assert late.rmse < 0.1


def test_a_start_that_is_stated_is_not_searched(mission: Mission) -> None:
    stated = InitialState(p_n=np.array([2.0, -1.0, 0.0]), sigma_p=0.1, heading=0.0)
    solution = estimated(replace(mission, initial=stated), *MAP)
    assert rmse_m(solution) < 0.06


def test_a_map_that_tells_no_start_is_reported(mission: Mission) -> None:
    rows = seen(mission)
    lone = with_sightings(mission, rows[rows[:, 1] == 4])
    solution = estimated(lone, *MAP)
    assert not solution.georeferenced
    assert any("map is not used" in warning for warning in solution.warnings)


def test_no_sighting_is_no_mission_for_it(mission: Mission) -> None:
    with pytest.raises(DataError, match="there are samples of: odometry"):
        estimated(mission.without("landmarks"))


@pytest.mark.parametrize(
    ("motion", "needs"),
    [("auto", "a DVL or odometry, or else an IMU"), ("odometry", "odometry"), ("ins", "an IMU")],
)
def test_landmarks_without_motion_are_refused(mission: Mission, motion: str, needs: str) -> None:
    still = mission.without("odometry") if motion != "ins" else mission
    with pytest.raises(DataError, match=rf"landmark-ekf needs .*{needs}.*the mission has: "):
        estimated(still, f"landmark_ekf.motion={motion}")


@pytest.mark.slow
def test_consistency_on_a_map_and_overconfidence_without() -> None:
    """EKF-SLAM is known to grow over-confident with heading errors: by little on this rover."""
    found = []
    for seed in range(20):
        metrics = evaluate(estimated(rover(seed=seed), *MAP), window_s=(10.0, 60.0))
        assert metrics.nees is not None
        found.append(metrics.nees.mean)
    assert 1.5 < np.mean(found) < 2.6


@pytest.mark.parametrize("name", ["ranger", pytest.param("submarine", marks=pytest.mark.slow)])
def test_landmarks_help_an_ins(name: str) -> None:
    for seed in (0, 1):
        simulated = gn.simulate(name, seed)
        truth = simulated.reference
        assert truth is not None
        pure, aided = (gn.estimate(simulated, m) for m in ("ins-ekf", "landmark-ekf"))
        ends = []
        for solution in (pure, aided):
            last = solution.trajectory.p_n[-1, :2]
            ends.append(float(np.hypot(*(last - truth.series.p_n[-1, :2]))))  # type: ignore[attr-defined]
        assert ends[1] < 0.7 * ends[0]


MRCLAM6_KNOWN_M = (0.177, 0.247, 0.238, 0.307, 0.265)


@pytest.mark.realdata
@pytest.mark.slow
def test_mrclam_on_the_surveyed_map_and_without(recorded_data: Path) -> None:
    learnt = []
    for robot, published in enumerate(MRCLAM6_KNOWN_M, start=1):
        recorded = gn.open_mission(recorded_data / "mrclam6" / f"Robot{robot}")
        assert rmse_m(estimated(recorded, *MAP)) <= 1.1 * published
        learnt.append(rmse_m(estimated(recorded, *SLAM)))
    assert np.mean(learnt) <= 0.2


def test_a_stated_error_of_the_ranges_scale_is_estimated() -> None:
    """Ranges a twentieth too long, among surveyed landmarks and among learnt ones."""
    long = rover(seed=3)
    rows = seen(long)
    rows[:, 2] *= 1.05
    stretched = with_sightings(long, rows)
    sensor = stretched.sensors["landmarks"]
    stated = stretched.with_sensor(replace(sensor, noise={"range_scale_sigma": 0.05}))
    assert rmse_m(estimated(stated, *MAP)) < 0.5 * rmse_m(estimated(stretched, *MAP))
    nees = evaluate(estimated(stated, *MAP)).nees
    assert nees is not None
    assert nees.mean < 6.0
    assert rmse_m(estimated(stated, *SLAM)) < 0.15


def test_a_stated_misalignment_turns_the_way() -> None:
    """Wheels that go 3 degrees to port of where they say, while a compass tells the course."""
    t = np.arange(0.0, 100.0, 0.2)
    n, askew = len(t), np.radians(3.0)
    wheels = OdometrySeries(
        t=t,
        v_b=np.tile([1.0, 0.0], (n, 1)),
        yaw_rate=np.zeros(n),
        sigma_v=np.full(n, 0.02),
        sigma_yaw_rate=np.full(n, 0.01),
    )
    compass = HeadingSeries(t=t, heading=np.zeros(n), sigma=np.full(n, 0.005))
    ahead = np.array([[k, 0, 10.0 - k, 0.0] for k in (0.0, 0.5, 1.0, 1.5)])
    quiet = {"bias_sigma_deg": 0.1, "disturbance_sigma_deg": 0.1}
    sensors = {
        "odometry": Sensor("odometry", "odometry", wheels, noise={"misalignment_sigma_deg": 3.0}),
        "heading": Sensor("heading", "heading", compass, noise=quiet),
        "landmarks": Sensor("landmarks", "landmarks", series(ahead)),
    }
    start = InitialState(p_n=np.zeros(3), heading=0.0, sigma_heading=np.radians(0.1))
    track = estimated(Mission("askew", sensors, initial=start)).trajectory
    error = track.p_n[-1, :2] - t[-1] * np.array([np.cos(askew), -np.sin(askew)])
    assert track.cov_pose_n is not None
    assert error @ np.linalg.solve(track.cov_pose_n[-1, :2, :2], error) < 6.0


def test_a_second_sensor_of_landmarks_is_said_to_be_left_out(mission: Mission) -> None:
    twin = replace(mission.sensors["landmarks"], name="aft")
    said = estimated(mission.with_sensor(twin)).warnings
    assert any("'aft' is left out" in warning for warning in said)


def test_a_vehicle_beyond_the_earth_is_an_error() -> None:
    track = Track([np.eye(3)], [np.array([1e32, 0.0, 0.0])], [np.zeros(3)], [np.eye(6)])
    with pytest.raises(EstimationError, match=r"diverged: 1e\+32 m from where"):
        track.trajectory(np.zeros(1))
