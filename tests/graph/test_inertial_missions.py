"""Missions that an IMU carries from fix to fix: without a DVL, without odometry."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import gtsam_nav as gn
from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.mission import Constraints, InitialState, LandmarkMap, Mission, Sensor
from gtsam_nav.series import GnssSeries, HeadingSeries, LandmarkSeries, ReferenceSeries
from gtsam_nav.solution import Solution


@pytest.fixture(scope="module")
def mission() -> Mission:
    return gn.simulate("laps", seed=2).crop(0.0, 90.0)


@pytest.fixture(scope="module")
def solution(mission: Mission) -> Solution:
    return gn.estimate(mission, "graph")


def errors(solution: Solution, mission: Mission) -> tuple[Array, Array]:
    """Of position (k, 3), m, and of yaw (k,), rad, at the trajectory's times."""
    assert mission.reference is not None
    truth = mission.reference.series
    assert isinstance(truth, ReferenceSeries)
    assert truth.rpy is not None
    t = solution.trajectory.t
    p_n = np.stack([np.interp(t, truth.t, axis) for axis in truth.p_n.T], axis=1)
    yaw = np.interp(t, truth.t, np.unwrap(truth.rpy[:, 2]))
    return solution.trajectory.p_n - p_n, wrap_angle(solution.trajectory.rpy[:, 2] - yaw)


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(np.atleast_2d(values.T) ** 2, axis=0))))


def test_it_is_far_better_than_the_fixes(mission: Mission, solution: Solution) -> None:
    position, yaw = errors(solution, mission)
    assert rms(position[:, :2]) < 0.6  # the fixes: 2.8 m
    assert np.degrees(rms(yaw)) < 0.2
    assert solution.georeferenced
    assert solution.gnss_used == len(mission.sensors["gnss"].series)


def test_keyframes_are_at_the_fixes(mission: Mission, solution: Solution) -> None:
    trajectory = solution.trajectory
    assert trajectory.keyframe is not None
    keyframes = trajectory.t[trajectory.keyframe]
    off = np.min(np.abs(keyframes[:, None] - mission.sensors["gnss"].series.t), axis=0)
    assert np.max(off) < 1e-9


def test_the_trajectory_is_smooth_between_keyframes(solution: Solution) -> None:
    """Velocities are the derivatives of positions, across keyframes too."""
    trajectory = solution.trajectory
    assert trajectory.v_n is not None
    slope = np.diff(trajectory.p_n, axis=0) / np.diff(trajectory.t)[:, None]
    mean = 0.5 * (trajectory.v_n[1:] + trajectory.v_n[:-1])
    assert np.max(np.abs(slope - mean)) < 0.02
    assert np.max(np.diff(trajectory.t)) <= 0.1 + 1e-9


def test_errors_are_as_large_as_it_says(mission: Mission, solution: Solution) -> None:
    position, _ = errors(solution, mission)
    cov = solution.trajectory.cov_pose_n
    assert cov is not None
    nees = np.einsum("ni,nij,nj->n", position, np.linalg.inv(cov[:, :3, :3]), position)
    assert 0.3 < np.mean(nees) / 3 < 3.0


@pytest.mark.slow
def test_without_a_compass_the_fixes_tell_the_heading(mission: Mission) -> None:
    blind = mission.without("heading")
    solution = gn.estimate(blind, "graph")
    position, yaw = errors(solution, mission)
    assert solution.georeferenced
    assert rms(position[:, :2]) < 0.6
    sigma = solution.trajectory.sigma_rpy
    assert sigma is not None
    moving = solution.trajectory.t > 40.0
    assert np.all(np.abs(yaw[moving]) < 4 * sigma[moving, 2])
    assert np.degrees(np.max(sigma[moving, 2])) < 20.0


def test_without_velocities_too(mission: Mission) -> None:
    gnss = mission.sensors["gnss"]
    assert isinstance(gnss.series, GnssSeries)
    positions = mission.with_sensor(replace(gnss, series=replace(gnss.series, v_n=None)))
    position, _ = errors(gn.estimate(positions, "graph"), mission)
    assert rms(position[:, :2]) < 1.2


@pytest.mark.slow
@pytest.mark.parametrize(("stop", "limit_m"), [(51.0, 0.7), (80.0, 1.5)])
def test_a_silent_imu_is_bridged(mission: Mission, stop: float, limit_m: float) -> None:
    imu = mission.sensors["imu"]
    t = imu.series.t
    silent = mission.with_sensor(replace(imu, series=imu.series.select((t < 50.0) | (t > stop))))
    solution = gn.estimate(silent, "graph")
    assert any("silent from 50.0 s" in warning for warning in solution.warnings)
    position, _ = errors(solution, mission)
    assert rms(position[:, :2]) < limit_m
    trajectory = solution.trajectory
    sigma = trajectory.sigma_v_n
    assert sigma is not None
    inside = (trajectory.t > 50.0) & (trajectory.t < stop)
    assert np.max(sigma[inside, :2]) > 1.5 * np.median(sigma[~inside, :2])


def test_lost_fixes_cost_certainty(mission: Mission) -> None:
    gnss = mission.sensors["gnss"]
    t = gnss.series.t
    solution = gn.estimate(
        mission.with_sensor(replace(gnss, series=gnss.series.select((t < 50) | (t > 65)))), "graph"
    )
    position, _ = errors(solution, mission)
    sigma = solution.trajectory.sigma_p_n
    assert sigma is not None
    inside = (solution.trajectory.t > 51) & (solution.trajectory.t < 64)
    assert np.max(sigma[inside, :2]) > np.median(sigma[~inside, :2])
    assert np.all(np.abs(position[inside, :2]) < 4 * sigma[inside, :2])


@pytest.mark.slow
def test_velocities_belong_to_a_time_before_their_stamp(mission: Mission) -> None:
    """Stamped late by a lag that the card states, they are as good as before."""
    gnss, lag_s = mission.sensors["gnss"], 0.4
    assert isinstance(gnss.series, GnssSeries)
    assert gnss.series.v_n is not None
    assert isinstance(mission.reference, object)
    t = gnss.series.t
    late = np.stack([np.interp(t - lag_s, t, axis) for axis in gnss.series.v_n.T], axis=1)
    lagging = replace(
        gnss,
        series=replace(gnss.series, v_n=late),
        noise={**gnss.noise, "velocity_lag_s": lag_s},
    )
    position, _ = errors(gn.estimate(mission.with_sensor(lagging), "graph"), mission)
    assert rms(position[:, :2]) < 0.6


def test_rest_that_the_mission_states_is_used(mission: Mission) -> None:
    """Twenty seconds at rest: the velocity there is known, and with it the gyro's bias."""
    resting = replace(mission, constraints=Constraints(zero_velocity=True)).crop(0.0, 15.0)
    trajectory = gn.estimate(resting, "graph").trajectory
    afloat = gn.estimate(mission.crop(0.0, 15.0), "graph").trajectory
    inside = (trajectory.t > 2.0) & (trajectory.t < 13.0)
    assert trajectory.v_n is not None
    assert trajectory.sigma_v_n is not None
    assert afloat.sigma_v_n is not None
    assert np.max(np.abs(trajectory.v_n[inside])) < 0.02
    assert np.max(trajectory.sigma_v_n[inside]) < 0.3 * np.min(afloat.sigma_v_n[:, :2])


def test_an_imu_and_a_stated_start_are_enough(mission: Mission) -> None:
    """Ten seconds at rest and a few more: drift, but a trajectory with its growing uncertainty."""
    alone = replace(
        mission.without("gnss", "heading"), initial=InitialState(np.zeros(3), 0.1, 0.18, 0.01)
    ).crop(0.0, 30.0)
    solution = gn.estimate(alone, "graph")
    position, _ = errors(solution, mission)
    sigma = solution.trajectory.sigma_p_n
    assert sigma is not None
    assert sigma[-1, 0] > sigma[0, 0]
    assert any("drifts freely" in warning for warning in solution.warnings)
    assert np.all(np.abs(position[-1, :2]) < 4 * sigma[-1, :2] + 0.5)


def test_a_stated_heading_is_believed_as_it_was_stated(mission: Mission) -> None:
    """Not as the compass, which is off by 10 deg, has it at the start."""
    assert mission.reference is not None
    truth = mission.reference.series
    assert isinstance(truth, ReferenceSeries)
    assert truth.rpy is not None
    compass = mission.sensors["heading"]
    assert isinstance(compass.series, HeadingSeries)
    off = replace(compass.series, heading=compass.series.heading + np.radians(10.0))
    noise = {**compass.noise, "bias_sigma_deg": 10.0}
    stated = InitialState(heading=float(truth.rpy[0, 2]), sigma_heading=float(np.radians(0.5)))
    biased = mission.with_sensor(replace(compass, series=off, noise=noise)).crop(0.0, 15.0)
    solution = gn.estimate(replace(biased, initial=stated), "graph")
    assert np.degrees(np.abs(solution.trajectory.rpy[0, 2] - truth.rpy[0, 2])) < 1.5


def test_no_motion_sensor_at_all(mission: Mission) -> None:
    with pytest.raises(gn.errors.DataError, match="the motion needs"):
        gn.estimate(mission.without("imu"), "graph")


def test_biases_that_walk_between_keyframes_widen_the_noise_alone(
    mission: Mission, solution: Solution
) -> None:
    """Both forms of preintegration tell the same path, the combined one a little less surely."""
    config = gn.load_config(None, ["graph.imu_preintegration=combined"])
    combined = gn.estimate(mission, "graph", config)
    a, b = combined.trajectory, solution.trajectory
    assert np.max(np.abs(a.p_n - b.p_n)) < 0.02
    assert np.degrees(np.max(np.abs(wrap_angle(a.rpy - b.rpy)))) < 0.02
    assert a.cov_pose_n is not None
    assert b.cov_pose_n is not None
    ratio = np.trace(a.cov_pose_n, axis1=1, axis2=2) / np.trace(b.cov_pose_n, axis1=1, axis2=2)
    assert np.all(ratio > 0.999)
    assert 1.0 < np.mean(ratio) < 1.1


@pytest.mark.slow
def test_a_large_gyro_bias_does_not_bend_what_follows_the_fixes() -> None:
    """Compass, attitude and depth stay; the gyro is biased by 0.02 rad/s, twice its sigma."""
    whole = gn.simulate("marina", seed=7, duration_s=240.0)
    mission = whole.without("dvl", "odometry", "sonar", "landmarks")
    config = gn.load_config(None, ["gnss.use=window", "gnss.window_s=[0,60]"])
    solution = gn.estimate(mission, "graph", config)
    assert solution.warnings == ()
    scores = gn.evaluate(solution)
    assert scores.ate.none is not None
    assert scores.nees is not None
    assert scores.ate.none.mean < 30.0  # it was 750 m
    assert scores.nees.mean < 2.0


@pytest.mark.slow
def test_fixes_between_keyframes_do_not_hold_the_yaw_to_the_drifted_first_guess() -> None:
    """Without a compass that guess turns with the gyro's bias."""
    whole = gn.simulate("marina", seed=9, duration_s=240.0)
    mission = whole.without("dvl", "heading", "attitude", "depth", "sonar", "landmarks")
    config = gn.load_config(None, ["gnss.use=window", "gnss.window_s=[0,60]"])
    scores = gn.evaluate(gn.estimate(mission, "graph", config))
    assert scores.ate.none is not None
    assert scores.nees is not None
    assert scores.ate.none.mean < 6.0  # it was 12 m
    assert scores.nees.mean < 4.0  # it was 10


@pytest.mark.slow
def test_the_yaw_by_fixes_alone_is_as_sure_as_it_says() -> None:
    """Slow, with an antenna on a mast: the accelerations and the swaying mast tell the yaw."""
    shares = []
    for seed in range(4):
        whole = gn.simulate("marina", seed=seed, duration_s=240.0)
        alone = whole.without(*(s for s in whole.sensors if s not in ("imu", "gnss", "reference")))
        solution = gn.estimate(alone, "graph")
        _, yaw = errors(solution, whole)
        sigma = solution.trajectory.sigma_rpy
        assert sigma is not None
        shares.append(float(np.mean((yaw / sigma[:, 2]) ** 2)))
    assert np.mean(shares) < 5.0  # it was 25


def with_beacons(mission: Mission) -> Mission:
    """Ranges to four beacons on the bottom, by turns."""
    assert mission.reference is not None
    truth = mission.reference.series
    assert isinstance(truth, ReferenceSeries)
    middle = truth.p_n.mean(axis=0)
    beacons = middle + np.array([[-60, -50, 30], [70, -40, 31], [60, 80, 29], [-50, 70, 30.5]])
    t = np.arange(0.5, 89.0, 1.0)
    beacon = np.arange(len(t)) % 4
    p_n = np.stack([np.interp(t, truth.t, axis) for axis in truth.p_n.T], axis=1)
    noise_m = np.random.default_rng(2).normal(0.0, 0.2, len(t))
    ranges = LandmarkSeries(
        t=t,
        id=beacon,
        range_m=np.linalg.norm(p_n - beacons[beacon], axis=1) + noise_m,
        sigma_range=np.full(len(t), 0.2),
    )
    known = LandmarkMap(np.arange(4), beacons, np.full(4, 0.1))
    return replace(mission, landmark_map=known).with_sensor(Sensor("ranges", "landmarks", ranges))


@pytest.mark.parametrize("compass", [True, False])
def test_ranges_to_surveyed_beacons_place_a_vessel_without_fixes(
    mission: Mission, compass: bool
) -> None:
    """Above its beacons, not mirrored below them, and in the world."""
    ranged = with_beacons(mission).without("gnss")
    solution = gn.estimate(ranged if compass else ranged.without("heading"), "graph")
    assert solution.georeferenced
    assert any("side of the beacons" in warning for warning in solution.warnings)
    position, yaw = errors(solution, mission)
    assert np.all(np.sqrt(np.mean(position**2, axis=0)) < [0.5, 0.5, 1.0])
    assert np.degrees(rms(yaw)) < 10.0
