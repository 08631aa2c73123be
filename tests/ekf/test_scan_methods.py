"""Scan matching and pose SLAM on small missions whose truth is known, and on bad ones."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import gtsam_nav as gn
from gtsam_nav.config import Config, load_config
from gtsam_nav.ekf.augmented_state import AugmentedState
from gtsam_nav.ekf.compounding import compound
from gtsam_nav.ekf.considered import ConsideredErrors, with_considered
from gtsam_nav.ekf.constant_velocity import YAW
from gtsam_nav.ekf.dead_reckoning import dead_reckon, filtered_trajectory
from gtsam_nav.ekf.distortion import Distortion
from gtsam_nav.ekf.pose_slam import PoseFilter, estimated_scale_sigma, loop_candidates
from gtsam_nav.ekf.scan_match import ChainEnd, completed, match_consecutive
from gtsam_nav.ekf.scan_solution import (
    PoseHistory,
    _bridge,
    _turned,
    after_scans,
    between_scans,
)
from gtsam_nav.ekf.scan_track import (
    COMPASS,
    MISALIGNMENT,
    NORTH_EAST,
    POSE,
    WITHIN,
    ScanTrack,
    follow_scans,
)
from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.mission import InitialState, Mission, Sensor
from gtsam_nav.registration.result import PlanarMatch
from gtsam_nav.series import (
    BeamSeries,
    HeadingSeries,
    OdometrySeries,
    ReferenceSeries,
    ScanSeries,
    Series,
)
from gtsam_nav.simulation.processes import gauss_markov
from gtsam_nav.simulation.settings import SimulationSettings
from gtsam_nav.solution import Solution
from gtsam_nav.sonar.defects import WHOLE_SENSOR
from gtsam_nav.sonar.scans import planar_rotations

METHODS = ("scan-match", "pose-ekf")
RADIUS_M, SPEED_M_S, LAPS = 12.0, 1.0, 2
SCAN_EVERY_S = 3.0
STOP_S = LAPS * 2 * np.pi * RADIUS_M / SPEED_M_S


def truth(t: Array) -> Array:
    """North, east and yaw on a circle, clockwise."""
    angle = SPEED_M_S * t / RADIUS_M
    return np.column_stack(
        [RADIUS_M * np.sin(angle), RADIUS_M * (1 - np.cos(angle)), wrap_angle(angle)]
    )


def circling(
    compass: bool = True, seed: int = 0, turn_error: float = 0.0, stop_s: float = STOP_S
) -> Mission:
    """Laps among posts, with odometry of poor speed, and a compass or an odd turn rate."""
    rng = np.random.default_rng(seed)
    posts = rng.uniform([-30, -20], [30, 45], (120, 2))
    t = np.arange(0.0, stop_s, 0.1)
    n = len(t)
    t_scan = np.arange(1.0, stop_s, SCAN_EVERY_S)
    points = []
    for north, east, yaw in truth(t_scan):
        c, s = np.cos(yaw), np.sin(yaw)
        seen = (posts - [north, east]) @ np.array([[c, -s], [s, c]])
        seen = seen[np.linalg.norm(seen, axis=1) < 25.0]
        points.append(seen + 0.05 * rng.normal(size=seen.shape))
    v_b = np.column_stack([np.full(n, 1.05 * SPEED_M_S), np.zeros(n)])
    rate = np.full(n, SPEED_M_S / RADIUS_M + turn_error)
    series: dict[str, Series] = {
        "odometry": OdometrySeries(
            t=t,
            v_b=v_b + 0.05 * rng.normal(size=(n, 2)),
            yaw_rate=rate + 0.01 * rng.normal(size=n),
            sigma_v=np.full(n, 0.2),
            sigma_yaw_rate=np.full(n, 0.05),
        ),
        "scans": ScanSeries(
            t=t_scan,
            first=np.concatenate([[0], np.cumsum([len(p) for p in points])]),
            points_b=np.vstack(points),
        ),
        "reference": ReferenceSeries(
            t=t, p_n=np.column_stack([truth(t)[:, :2], np.zeros(n)]), vertical_usable=False
        ),
    }
    if compass:
        wobble = np.radians(3.0) * np.sin(t / 20.0)
        series["heading"] = HeadingSeries(
            t=t, heading=truth(t)[:, 2] + wobble, sigma=np.full(n, 0.01)
        )
    sensors = {name: Sensor(name, name, one) for name, one in series.items()}
    start = InitialState(p_n=np.zeros(3), sigma_p=0.1, heading=0.0)
    return Mission("circling", sensors, initial=start)


def error_m(solution: Solution) -> float:
    """Root mean square of the horizontal error, without alignment."""
    difference = solution.trajectory.p_n[:, :2] - truth(solution.trajectory.t)[:, :2]
    return float(np.sqrt(np.mean(np.sum(difference**2, axis=1))))


@pytest.fixture(scope="module", params=[True, False], ids=["compass", "no compass"])
def mission(request: pytest.FixtureRequest) -> Mission:
    turn_error = 0.0 if request.param else 0.002
    return circling(compass=request.param, turn_error=turn_error)


def test_matching_mends_dead_reckoning_and_loops_mend_matching(mission: Mission) -> None:
    solutions = [gn.estimate(mission, name) for name in ("dr", *METHODS)]
    aligned = [gn.evaluate(s, mission.reference).ate.se2 for s in solutions]
    dr, matched, slam = (e.mean for e in aligned if e is not None)
    assert dr > 0.8
    assert matched < 0.05
    assert slam < 0.75 * matched
    # the start's heading, known to 3 deg, turns it all
    assert all(error_m(solution) < 0.3 for solution in solutions[1:])


@pytest.mark.parametrize("method", METHODS)
def test_the_trajectory_is_whole(mission: Mission, method: str) -> None:
    solution = gn.estimate(mission, method)
    trajectory, online = solution.trajectory, solution.online
    assert online is not None
    scans = mission.sensors["scans"].series
    for one in (trajectory, online):
        assert (one.t[0], one.t[-1]) == pytest.approx(mission.span_s)
        assert np.max(np.diff(one.t)) <= 0.1 + 1e-9
        assert one.cov_pose_n is not None
        np.testing.assert_allclose(one.cov_pose_n, np.swapaxes(one.cov_pose_n, 1, 2), atol=1e-12)
        assert np.linalg.eigvalsh(one.cov_pose_n)[:, 0].min() > -1e-9
    assert trajectory.keyframe is not None
    np.testing.assert_array_equal(trajectory.t[trajectory.keyframe], scans.t)
    steps = np.linalg.norm(np.diff(trajectory.p_n, axis=0), axis=1)
    assert steps.max() < 0.5, "no jump at a scan"
    turns = np.abs(wrap_angle(np.diff(trajectory.rpy[:, 2])))
    assert turns.max() < np.radians(5.0)
    assert solution.n_keyframes == len(scans)
    assert solution.sonar_map is not None
    assert len(solution.sonar_map.points_n) > 0
    assert {"odometry", "scans"} <= set(solution.innovations)


def test_without_matches_the_pose_filter_is_dead_reckoning() -> None:
    """A compass that drifts turns the whole way: its error at a scan is no news at the next."""
    mission, config = circling(), load_config()
    track = follow_scans(mission, config)
    state = AugmentedState(len(track), track.first, track.first_cov)
    for k in range(1, len(track)):
        state.augment(*track.predict(k, state.newest))
    reckoned = dead_reckon(mission, track.start, config, track.t)
    drift = track.drift
    assert drift is not None
    misalignment = ConsideredErrors.of(mission).misalignment
    assert misalignment > 0.0
    drifting = ConsideredErrors(0.0, drift.sigma, drift.time_s, misalignment, 0.0)
    dr = with_considered(filtered_trajectory(reckoned.filtered, mission), drifting)
    at_scans = dr.select(np.searchsorted(dr.t, track.t))
    assert at_scans.cov_pose_n is not None
    np.testing.assert_allclose(state.poses[:, :2], at_scans.p_n[:, :2], atol=0.2)
    planar = np.array([0, 1, 5])
    stated = at_scans.cov_pose_n[:, planar[:, None], planar]
    for axis in range(3):
        np.testing.assert_allclose(
            state.marginals[5:, axis, axis], stated[5:, axis, axis], rtol=0.1
        )


@pytest.mark.parametrize("compass", [True, False])
def test_a_misalignment_turns_the_way_to_the_first_scan_too(compass: bool) -> None:
    mission = circling(compass=compass)
    late = mission.with_sensor(of_times(mission, 30.0, STOP_S))
    track, errors = follow_scans(late, load_config()), ConsideredErrors.of(mission)
    angle = errors.misalignment
    straight = np.diff(track.filtered.x[[0, track.record[0]], :2], axis=0)[0]
    aside = angle * np.array([-straight[1], straight[0]])
    aligned = track.first_cov[NORTH_EAST, NORTH_EAST] - np.outer(aside, aside)
    assert np.linalg.eigvalsh(aligned).min() > 0.0
    np.testing.assert_allclose(track.first_cov[MISALIGNMENT, NORTH_EAST], angle * aside)
    precise = replace(mission.sensors["odometry"], noise={"misalignment_sigma_deg": 0.0})
    exact = follow_scans(late.with_sensor(precise), load_config())
    np.testing.assert_allclose(exact.first_cov[NORTH_EAST, NORTH_EAST], aligned, rtol=1e-6)
    first = np.zeros(len(track.filtered.t), dtype=np.int64)
    by_misalignment = np.subtract(*(_turned(track, first, first, first, a) for a in (angle, 0.0)))
    assert not np.any(by_misalignment[: track.record[0]])
    assert np.all(by_misalignment[-1].trace() > 0.0)


def without_drift(mission: Mission) -> Mission:
    compass = mission.sensors["heading"]
    return mission.with_sensor(replace(compass, noise={"disturbance_sigma_deg": 0.0}))


def test_white_noise_of_a_compass_averages_out_over_a_scan_and_no_further() -> None:
    """All of it counts in a scan taken at once, a share in one that takes a turn of the head."""
    at_once = follow_scans(without_drift(circling(stop_s=10.0)), load_config())
    white = at_once.filtered.P[at_once.record[0], YAW, YAW]
    assert at_once.first_cov[-1, -1] == pytest.approx(white)
    mission = without_drift(gn.simulate("marina", seed=1, duration_s=20.0))
    turning = follow_scans(mission, load_config())
    headings = mission.sensors["heading"].series
    assert isinstance(headings, HeadingSeries)
    turns = turning.sonar.turns
    begin_s, end_s = turning.instrument.series.t[[turns.first[0], turns.last[0] - 1]]
    n = np.count_nonzero((headings.t >= begin_s) & (headings.t <= end_s))
    assert n > 100
    assert turning.first_cov[-1, -1] == pytest.approx(headings.sigma[0] ** 2 / n, rel=0.02)


def with_sonar_noise(mission: Mission, **noise: float) -> Mission:
    scans = mission.sensors["scans"]
    return mission.with_sensor(replace(scans, noise={**scans.noise, **noise}))


def test_a_card_states_the_floors_of_matches_else_the_settings_do() -> None:
    config = load_config(None, ["pic.floor_xy_m=0.2", "pic.floor_yaw_deg=1.0"])
    stated = with_sonar_noise(circling(), match_floor_m=0.03)
    for mission, floor_m in ((circling(), 0.2), (stated, 0.03)):
        track = follow_scans(mission, config)
        assert (track.pic.floor_xy_m, track.pic.floor_yaw_deg) == (floor_m, 1.0)
    sigma_m = [
        np.sqrt(match_consecutive(follow_scans(m, config), 3, config)[0].match.cov[0, 0])
        for m in (circling(), stated)
    ]
    assert sigma_m[0] > 0.2 > 0.1 > sigma_m[1]


def test_a_scale_is_estimated_where_the_velocity_knows_its_own_better() -> None:
    """The odometry's is known to 3 %."""
    for sigma, estimated in ((0.05, 0.05), (0.02, 0.0)):
        track = follow_scans(with_sonar_noise(circling(), scale_sigma=sigma), load_config())
        assert estimated_scale_sigma(track) == estimated


def test_a_scale_of_matches_stretches_the_chain_along_its_way() -> None:
    sigma = 0.05
    plain, scaled = (
        gn.estimate(m, "scan-match").trajectory.select(slice(200, None))
        for m in (circling(), with_sonar_noise(circling(), scale_sigma=sigma))
    )
    assert plain.cov_pose_n is not None
    assert scaled.cov_pose_n is not None
    np.testing.assert_allclose(scaled.p_n, plain.p_n)
    way = plain.p_n[:, :2]
    expected = sigma**2 * way[:, :, None] * way[:, None]
    added = (scaled.cov_pose_n - plain.cov_pose_n)[:, :2, :2]
    # between scans it is interpolated
    np.testing.assert_allclose(added, expected, atol=0.1)


def test_between_two_scans_a_drift_turns_the_way_as_drawn() -> None:
    """Carried from both scans, whose headings are known: half of each in the middle."""
    track = follow_scans(circling(), load_config())
    assert track.drift is not None
    first, last = track.record[4:6].tolist()
    steps = np.diff(track.filtered.x[first : last + 1, :2], axis=0)
    aside = np.column_stack([-steps[:, 1], steps[:, 0]])
    n, middle = len(steps), len(steps) // 2
    step_s = float(track.t[5] - track.t[4]) / n
    drifts = gauss_markov(
        np.random.default_rng(3), n, step_s, track.drift.sigma, track.drift.time_s, 4000
    ).T
    before = (drifts[:, :middle] - drifts[:, :1]) @ aside[:middle]
    after = (drifts[:, -1:] - drifts[:, middle:]) @ aside[middle:]
    seen = np.cov(0.5 * (before + after).T)
    everywhere = np.ones(len(track.filtered.t), dtype=np.int64)
    stated = _turned(track, 4 * everywhere, 5 * everywhere, 0.5 * everywhere, 0.0)[first + middle]
    np.testing.assert_allclose(stated[:2, :2], seen, atol=0.1 * np.trace(seen))
    off = drifts[:, middle] - 0.5 * (drifts[:, 0] + drifts[:, -1])
    assert stated[2, 2] == pytest.approx(np.var(off), rel=0.1)


def test_after_the_last_scan_a_misalignment_turns_the_way() -> None:
    """From there on alone: what they did before is in the pose of the scan."""
    mission = circling(compass=False)
    track = follow_scans(mission.with_sensor(of_times(mission, 0.0, 20.0)), load_config())
    angle = 0.02
    last = np.full(len(track.filtered.t), len(track) - 1)
    found = _turned(track, last, last, np.zeros(len(last)), angle)
    north, east = track.filtered.x[-1, :2] - track.pose(len(track) - 1)[:2]
    aside = angle * np.array([-east, north])
    np.testing.assert_allclose(found[-1, :2, :2], np.outer(aside, aside))
    np.testing.assert_allclose(found[track.record[-1]], 0.0, atol=1e-12)


def exact_but_for_a_turn(track: ScanTrack, variance: float) -> PoseHistory:
    """Poses of which one error of the heading, the same all along, is all that is wrong."""
    cov = np.zeros((len(track), 3, 3))
    poses = np.array([track.pose(k) for k in range(len(track))])
    turned = np.column_stack([-poses[:, 1], poses[:, 0], np.ones(len(poses))])
    return PoseHistory(poses, cov + variance * turned[:, :, None] * turned[:, None])


def test_a_heading_that_is_wrong_turns_the_way_from_a_scan() -> None:
    """Before, between and after the scans, and in the causal estimate, which hangs on the last."""
    whole = circling(compass=False)
    mission = whole.with_sensor(of_times(whole, 5.0, 20.0))
    track = follow_scans(mission, load_config())
    for carried in (between_scans, after_scans):
        exact, turned = (
            carried(track, exact_but_for_a_turn(track, variance), 0.0) for variance in (0.0, 0.01)
        )
        assert exact.cov_pose_n is not None
        assert turned.cov_pose_n is not None
        north, east = exact.p_n[:, :2].T
        aside = np.column_stack([-east, north])
        added = (turned.cov_pose_n - exact.cov_pose_n)[:, :2, :2]
        np.testing.assert_allclose(added, 0.01 * aside[:, :, None] * aside[:, None], atol=1e-9)


def test_before_the_first_scan_no_variance_is_negative() -> None:
    mission = circling()
    track = follow_scans(mission.with_sensor(of_times(mission, 5.0, 20.0)), load_config())
    for carried in (between_scans, after_scans):
        cov = carried(track, exact_but_for_a_turn(track, 0.0), 0.0).cov_pose_n
        assert cov is not None
        assert np.linalg.eigvalsh(cov).min() > -1e-12


def of_times(mission: Mission, start_s: float, stop_s: float) -> Sensor:
    """The scans from one time on and before another."""
    sensor = mission.sensors["scans"]
    return replace(sensor, series=sensor.series.crop(start_s, stop_s))


def test_between_scans_that_fill_the_time_a_walk_is_tied_to_their_means() -> None:
    track = follow_scans(circling(), load_config())
    here, (first, last) = track.record[5], track.t[4:6]
    steps, growth = 300, float(track.filtered.P[here, 0, 0]) / (last - first)
    walk_step = np.sqrt(growth * (last - first) / steps)
    # from the first beam of one scan to the last of the next, of equal lengths
    walks = np.cumsum(
        np.random.default_rng(7).normal(scale=walk_step, size=(4000, 2 * steps)), axis=1
    )
    means = walks.reshape(-1, 2, steps).mean(axis=2)
    at_scan, between = walks[:, steps // 2] - means[:, 0], walks[:, steps] - means.mean(axis=1)
    for span_s, seen in ((last - first, np.var(between) - np.var(at_scan)), (0.0, None)):
        filled = replace(track, beams_s=track.t[:, None] + span_s * np.array([-0.5, 0.5]))
        stated = _bridge(filled, np.array([5]), np.array([0.5]))[0, 0, 0]
        expected = seen if seen is not None else 0.25 * growth * (last - first)
        assert stated == pytest.approx(expected, rel=0.12)


def with_errors(pose: Array, misalignment: float = 0.0, compass: float = 0.0) -> Array:
    return np.concatenate([[misalignment, compass], pose])


def test_a_walk_within_scans_that_fill_the_time_is_counted_once() -> None:
    """From mean to mean a walk goes for as long as from middle to middle, less a third of a scan;
    counting how far either end is off its mean besides, it seemed to go longer."""
    mission = without_drift(circling(stop_s=20.0))
    precise = {"scale_sigma": 0.0, "misalignment_sigma_deg": 0.0}
    odometry = replace(mission.sensors["odometry"], noise=precise)
    track = follow_scans(mission.with_sensor(odometry), load_config())
    one, n = float(track.walked[track.record[2], 0, 0]), len(track) - 1
    # at the end from the mean, and of the mean from the begin: a third each, and a sixth shared
    onward, reached = np.linalg.cholesky([[1 / 3, 1 / 6], [1 / 6, 1 / 3]]) * np.sqrt(one)
    ends = np.stack([np.kron(np.eye(2), -reached), np.kron(np.eye(2), onward)])
    still = Distortion(np.zeros((1, 2, 4)), np.zeros((3, 4)), ends)
    track = replace(track, distortions=[still] * (n + 1), between=np.zeros(n + 1))
    state = AugmentedState(n + 1, track.first, track.first_cov_aligned)
    for k in range(1, n + 1):
        state.augment(*track.predict(k, state.newest))
    J = np.hstack([-np.eye(2), np.eye(2)])
    for a, b in ((1, 2), (0, n)):
        entries = np.r_[3 * a : 3 * a + 2, 3 * b : 3 * b + 2]
        stated = J @ state.cov[np.ix_(entries, entries)] @ J.T
        np.testing.assert_allclose(stated, (b - a - 1 / 3) * one * np.eye(2), atol=1e-9)
    expected = state.displacement(1, 2)[1]
    np.testing.assert_allclose(track.displacement(2)[1], expected, rtol=0.01, atol=1e-6)


def test_the_first_scan_is_on_the_whole_where_the_walk_has_led_to_it() -> None:
    """Up to its first echo the walk is no part of the scan; then it is the scan's own."""
    mission = without_drift(gn.simulate("marina", seed=1, duration_s=30.0))
    track = follow_scans(mission, load_config())
    cov, (_, reached) = track.first_cov_aligned, track._strayed(0)
    back = np.zeros((2, len(cov)))
    back[:, NORTH_EAST], back[:, WITHIN] = np.eye(2), -reached
    np.testing.assert_allclose(back @ cov @ back.T, track.between[0] * np.eye(2), atol=1e-4)
    to_reference = planar_rotations(track.pose(0)[2]) @ track.distortions[0].whole[:2]
    back[:, WITHIN] = to_reference
    walked = track.walked[track.record[0], :2, :2]
    np.testing.assert_allclose(back @ cov @ back.T, walked, atol=1e-4)


def test_a_compass_without_drift_is_right_again_at_the_next_scan() -> None:
    track = follow_scans(without_drift(circling(stop_s=20.0)), load_config())
    new, _, cov = track.predict(3, with_errors(np.add(track.pose(2), [0.0, 0.0, 0.2]), compass=0.2))
    np.testing.assert_allclose(new[POSE], track.pose(3), atol=1e-12)
    assert new[COMPASS] == 0.0
    assert cov[-1, -1] == pytest.approx(track.white_yaw[3])


def test_a_compass_error_that_matches_show_is_carried_on() -> None:
    track = follow_scans(circling(), load_config())
    last, h = with_errors(np.add(track.pose(7), [3.0, -2.0, 0.2]), 0.01, 0.2), 1e-6
    new, J, _ = track.predict(8, last)
    assert 0.15 < wrap_angle(new[-1] - track.pose(8)[2]) < 0.2
    assert 0.15 < new[COMPASS] < 0.2
    for axis, step in enumerate(h * np.eye(5)):
        ahead, behind = (track.predict(8, last + sign * step)[0] for sign in (1, -1))
        np.testing.assert_allclose((ahead - behind) / (2 * h), J[:, axis], atol=1e-6)


def test_without_a_compass_the_way_is_turned_too() -> None:
    track = follow_scans(circling(compass=False), load_config())
    last, h = with_errors(track.pose(7), 0.02), 1e-6
    new, J, _ = track.predict(8, last)
    straight = np.subtract(track.pose(8), track.pose(7))[:2]
    moved = new[NORTH_EAST] - last[NORTH_EAST]
    np.testing.assert_allclose(moved, planar_rotations(0.02) @ straight)
    columns = [MISALIGNMENT, 2, 3, 4]
    for column, step in zip(columns, h * np.eye(5)[columns], strict=True):
        ahead, behind = (track.predict(8, last + sign * step)[0] for sign in (1, -1))
        np.testing.assert_allclose((ahead - behind) / (2 * h), J[:, column], atol=1e-6)


@pytest.mark.parametrize("method", METHODS)
def test_the_causal_estimate_knows_no_future(mission: Mission, method: str) -> None:
    cut_s = 80.0
    whole, part = (gn.estimate(m, method).online for m in (mission, mission.crop(stop_s=cut_s)))
    assert whole is not None
    assert part is not None
    shared = part.t < cut_s - 1.0
    same = np.isin(whole.t, part.t[shared])
    np.testing.assert_allclose(whole.p_n[same], part.p_n[shared], atol=1e-9)
    np.testing.assert_allclose(whole.cov_pose_n[same], part.cov_pose_n[shared], atol=1e-9)  # type: ignore[index]


def test_the_poses_of_scans_are_kept_by_the_trajectory(mission: Mission) -> None:
    config = Config()
    track = follow_scans(mission, config)
    pose_filter = filtered(track, config)
    trajectory = gn.estimate(mission, "pose-ekf").trajectory
    scans = trajectory.select(trajectory.keyframe)  # type: ignore[arg-type]
    np.testing.assert_allclose(scans.p_n[:, :2], pose_filter.state.poses[:, :2], atol=1e-9)
    np.testing.assert_allclose(
        wrap_angle(scans.rpy[:, 2] - pose_filter.state.poses[:, 2]), 0.0, atol=1e-9
    )
    planar = np.array([0, 1, 5])
    assert scans.cov_pose_n is not None
    # what the filter does not know of constant errors turns and stretches all
    errors, zero = ConsideredErrors.of(mission), np.zeros(len(scans))
    north, east = (scans.p_n - trajectory.p_n[0])[:, :2].T
    turned = np.zeros((len(scans), 3, 3))
    for sigma, *way in (
        (errors.heading, -east, north, zero + 1.0),
        (errors.scale, north, east, zero),
    ):
        by_one = sigma * np.stack(way, axis=1)
        turned += by_one[:, :, None] * by_one[:, None]
    # and a single reading of the compass is not quite the heading of the scan
    if track.drift is not None:
        turned[:, 2, 2] += track.filtered.P[track.record, YAW, YAW]
    np.testing.assert_allclose(
        scans.cov_pose_n[:, planar[:, None], planar],
        pose_filter.state.marginals + turned,
        atol=1e-12,
    )


def filtered(track: ScanTrack, config: Config) -> PoseFilter:
    pose_filter = PoseFilter(track, config)
    for k in range(1, len(track)):
        pose_filter.add_scan(k)
    return pose_filter


def test_every_candidate_is_on_record() -> None:
    solution = gn.estimate(circling(), "pose-ekf", load_config(None, ["pic.min_overlap=0.8"]))
    verdicts = {loop.verdict for loop in solution.loops}
    assert verdicts == {"accepted", "rejected"}
    for loop in solution.loops:
        assert loop.t_b - loop.t_a > SCAN_EVERY_S * 1.5
        assert bool(loop.reason) == (loop.verdict == "rejected")
        if loop.verdict == "accepted":
            assert loop.score >= 0.8
    assert any("overlap" in loop.reason for loop in solution.loops)
    revisits = [loop for loop in solution.loops if loop.t_b - loop.t_a > 60.0]
    assert len(revisits) > 10
    scans = solution.scans
    assert scans is not None
    assert {t for loop in solution.loops for t in (loop.t_a, loop.t_b)} <= set(scans.t)
    assert min(len(scans.points(k)) for k in range(len(scans))) > 0
    graph = solution.pose_graph
    assert graph is not None
    used = sum(loop.verdict == "accepted" for loop in solution.loops)
    consecutive = solution.n_keyframes - 1
    unmatched = sum("scan match" in r.reason for r in solution.rejections)
    assert len(graph.edges) == consecutive + (consecutive - unmatched) + used


def test_candidates_are_those_within_the_radius_nearest_first() -> None:
    poses = np.array([[0, 0, 0], [9, 0, 1], [5, 0, 2], [2, 0, 3], [1, 0, 0], [1, 0, 0.0]])
    assert loop_candidates(poses, 4.5) == [0, 3, 2]
    assert loop_candidates(poses[:2], 4.5) == []


def test_a_match_that_fails_leaves_the_dead_reckoned_displacement() -> None:
    """With a blind scan the chain goes on, and says so."""
    mission = circling()
    sensor = mission.sensors["scans"]
    series = sensor.series
    assert isinstance(series, ScanSeries)
    sizes = np.diff(series.first)
    blind = 10
    kept = np.repeat(np.arange(len(series)) != blind, sizes)
    sizes[blind] = 0
    gappy = replace(
        series, first=np.concatenate([[0], np.cumsum(sizes)]), points_b=series.points_b[kept]
    )
    mission = mission.with_sensor(replace(sensor, series=gappy))
    for method in METHODS:
        solution = gn.estimate(mission, method)
        left_out = [r for r in solution.rejections if r.sensor == "scans"]
        assert [r.index for r in left_out] == [blind, blind + 1]
        assert all(r.reason == "scan match: fewer than 20 points" for r in left_out)
        assert error_m(solution) < 0.7
        assert solution.warnings == ()


def test_a_lie_is_stopped_by_the_gate() -> None:
    """A scan that shows the world from elsewhere is not believed."""
    mission = circling()
    sensor = mission.sensors["scans"]
    series = sensor.series
    assert isinstance(series, ScanSeries)
    points = series.points_b.copy()
    k = 12
    points[series.first[k] : series.first[k + 1]] += [3.5, -3.5]
    mission = mission.with_sensor(replace(sensor, series=replace(series, points_b=points)))
    solution = gn.estimate(mission, "pose-ekf")
    t = float(series.t[k])
    about = [loop for loop in solution.loops if t in (loop.t_a, loop.t_b)]
    assert about
    assert all(loop.verdict == "rejected" for loop in about)
    assert error_m(solution) < 0.3


@pytest.mark.parametrize("method", METHODS)
def test_scans_that_never_match_leave_dead_reckoning(method: str) -> None:
    config = load_config(None, ["sonar.scans.min_points=500"])
    solution, dr = (gn.estimate(circling(), name, config) for name in (method, "dr"))
    assert "no scan could be matched: the trajectory is dead-reckoned" in solution.warnings
    apart = solution.trajectory.interpolate(dr.trajectory.t[1:-1]).p_n - dr.trajectory.p_n[1:-1]
    # with a compass the filter's displacements are those of dr, less what it mends in hindsight
    assert np.abs(apart).max() < 0.3
    sigma, sigma_dr = solution.trajectory.sigma_p_n, dr.trajectory.sigma_p_n
    assert sigma is not None
    assert sigma_dr is not None
    # dr considers the velocity's constant errors too, and that a compass's disturbance lasts
    assert np.all(sigma[-1, :2] >= 0.75 * sigma_dr[-1, :2])


@pytest.mark.parametrize("method", METHODS)
def test_one_scan_is_enough_to_run(method: str) -> None:
    mission = circling(stop_s=3.5)
    assert len(mission.sensors["scans"].series) == 1
    solution = gn.estimate(mission, method)
    assert solution.n_keyframes == 1
    assert solution.loops == ()
    assert error_m(solution) < 0.5


@pytest.mark.parametrize("method", METHODS)
def test_a_mission_without_sonar_is_refused_by_name(method: str) -> None:
    with pytest.raises(
        DataError, match=r"needs a turn of a scanning sonar .* the mission has: heading, odometry$"
    ):
        gn.estimate(circling().without("scans"), method)


@pytest.mark.parametrize("method", METHODS)
def test_a_sonar_that_is_no_use_is_refused_with_the_reason(method: str) -> None:
    silent = BeamSeries(
        t=np.arange(0, 20, 0.1),
        angle=np.linspace(0, 6, 200),
        intensity=np.zeros((200, 50), np.uint8),
    )
    mission = circling().without("scans").with_sensor(Sensor("eye", "beams", silent))
    with pytest.raises(DataError, match="sonar 'eye' is not used: all echo intensities are zero"):
        gn.estimate(mission, method)
    with pytest.raises(DataError, match=r"switched off by sonar\.use"):
        gn.estimate(circling(), method, load_config(None, ["sonar.use=false"]))


def test_a_second_sonar_is_left_out_and_named() -> None:
    mission = circling()
    other = replace(mission.sensors["scans"], name="other")
    solution = gn.estimate(mission.with_sensor(other), "pose-ekf")
    assert [(r.sensor, r.index) for r in solution.rejections] == [("other", WHOLE_SENSOR)]
    assert "sonar 'other' is not used: the sonar 'scans' is used" in solution.warnings


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_two_runs_are_the_same(method: str) -> None:
    one, other = (gn.estimate(circling(), method) for _ in range(2))
    np.testing.assert_array_equal(one.trajectory.p_n, other.trajectory.p_n)
    np.testing.assert_array_equal(one.trajectory.cov_pose_n, other.trajectory.cov_pose_n)
    np.testing.assert_equal(one.loops, other.loops)


def test_the_sonar_of_the_marina_is_used() -> None:
    mission = gn.simulate("marina", seed=6, duration_s=90.0)
    config = load_config(None, ["gnss.use=none"])
    solution = gn.estimate(mission, "pose-ekf", config)
    assert solution.n_keyframes == 7
    assert "sonar" in solution.innovations
    metrics = gn.evaluate(solution, solution.reference)
    assert metrics.ate.se2 is not None
    assert metrics.ate.se2.mean < 1.0
    assert metrics.ate_online is not None
    assert metrics.coverage is not None
    assert metrics.coverage > 0.99


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_loops_mend_the_compass_of_the_marina(seed: int) -> None:
    mission = gn.simulate("marina", seed=seed)
    config = load_config(None, ["gnss.use=none"])
    slam, dr = (gn.estimate(mission, name, config) for name in ("pose-ekf", "dr"))
    errors = [gn.evaluate(s, mission.reference).ate.se2 for s in (slam, dr)]
    assert errors[0] is not None
    assert errors[1] is not None
    assert errors[0].mean <= 0.8
    assert errors[0].mean <= 0.4 * errors[1].mean


@pytest.mark.slow
@pytest.mark.realdata
@pytest.mark.parametrize("gnss", ["none", "window"])
def test_stpere(stpere_folder: Path, gnss: str) -> None:
    mission = gn.open_mission(stpere_folder)
    config = load_config(None, [f"gnss.use={gnss}", "gnss.window_s=[0,300]"])
    means = {}
    for method in ("dr", *METHODS):
        solution = gn.estimate(mission, method, config)
        metrics = gn.evaluate(solution, solution.reference, (0.0, 3020.0))
        assert metrics.coverage is not None
        assert metrics.coverage > 0.99
        assert metrics.ate.se2 is not None
        means[method] = metrics.ate.se2.mean
    assert means["pose-ekf"] <= 1.6
    assert means["pose-ekf"] < means["scan-match"] < means["dr"]


def test_along_a_corridor_the_chain_keeps_what_dead_reckoning_knows() -> None:
    prior, cov_prior = np.array([2.0, 0.1, 0.02]), np.diag([0.3, 0.3, 0.05]) ** 2
    told = np.diag([100.0, 0.1, 0.01]) ** 2
    along = np.array([[1.0, 0.0, 0.0]])
    match = PlanarMatch(np.array([2.4, 0.0, 0.0]), told, 0.9, 5, "", along)
    q, cov, _ = completed(match, prior, cov_prior)
    assert q[0] == pytest.approx(2.0, abs=1e-4)
    assert abs(q[1]) < 0.02
    np.testing.assert_allclose(np.sqrt(cov[0, 0]), 0.3, rtol=1e-4)
    assert np.sqrt(cov[1, 1]) < 0.1
    whole = PlanarMatch(match.q, told, 0.9, 5)
    np.testing.assert_array_equal(completed(whole, prior, cov_prior)[0], match.q)


@pytest.mark.parametrize("method", METHODS)
def test_a_yaw_that_is_unsure_makes_the_velocity_unsure(method: str) -> None:
    trajectory = gn.estimate(circling(), method).trajectory
    assert trajectory.sigma_rpy is not None
    assert trajectory.sigma_v_n is not None
    across = np.linalg.norm(trajectory.sigma_v_n[:, :2], axis=1)
    assert np.all(across >= 0.999 * SPEED_M_S * trajectory.sigma_rpy[:, 2])


def test_matches_of_one_scan_share_how_it_is_bent() -> None:
    """As with all errors side by side: what the last match has of them the next one has too."""
    rng, m = np.random.default_rng(2), 4
    end = ChainEnd(rng.normal(size=3), np.diag([0.1, 0.2, 0.05]) ** 2, np.zeros((3, m)))
    # how the pose answers to its own start and to the errors within every scan so far
    answers = np.hstack([np.linalg.cholesky(end.cov), np.zeros((3, m))])
    for _ in range(4):
        q, own = rng.normal(size=3), 0.05 * rng.normal(size=(3, 3))
        by_last, by_new = 0.05 * rng.normal(size=(2, 3, m))
        _, J_last, J_q = compound(end.pose, q)
        answers = J_last @ answers
        answers[:, -m:] += J_q @ by_last
        answers = np.hstack([answers[:, :-m], J_q @ own, answers[:, -m:], J_q @ by_new])
        cov = own @ own.T + by_last @ by_last.T + by_new @ by_new.T
        end = end.followed_by(q, cov, by_last, by_new)
        np.testing.assert_allclose(end.cov, answers @ answers.T)


def test_constant_errors_of_the_velocity_make_a_displacement_unsure() -> None:
    mission = circling(stop_s=10.0)
    errors = ConsideredErrors.of(mission)
    precise = {"scale_sigma": 0.0, "misalignment_sigma_deg": 0.0}
    exact = mission.with_sensor(replace(mission.sensors["odometry"], noise=precise))
    (q, cov), (_, without) = (
        follow_scans(m, load_config()).displacement(2) for m in (mission, exact)
    )
    length, unit = np.linalg.norm(q[:2]), q[:2] / np.linalg.norm(q[:2])
    added = (cov - without)[:2, :2]
    np.testing.assert_allclose(np.sqrt(unit @ added @ unit), errors.scale * length, rtol=1e-3)
    expected = (errors.scale**2 + errors.misalignment**2) * length**2
    assert np.trace(added) == pytest.approx(expected, rel=1e-3)


def test_the_chain_tests_a_match_as_the_filter_does() -> None:
    """With what dead reckoning and match share: how errors within the scans stray and bend."""
    mission = gn.simulate("marina", 1, duration_s=45.0, settings=SimulationSettings.matched())
    config = load_config(None, ["gnss.use=none", "pose_ekf.association=mean"])
    track = follow_scans(mission, config)
    pose_filter = PoseFilter(track, config)
    pose_filter.add_scan(1)
    found, bends = match_consecutive(track, 1, config)
    assert found.nis == pytest.approx(pose_filter.matches[0].nis, rel=0.03)
    assert np.abs(track.shared_with_match(1, *bends)).max() > 1e-4


@pytest.mark.parametrize("method", METHODS)
def test_a_sonar_that_hears_nothing_for_a_while_is_no_obstacle(method: str) -> None:
    mission = gn.simulate("marina", seed=1, duration_s=120.0)
    sonar = mission.first("beams")
    assert sonar is not None
    assert isinstance(sonar.series, BeamSeries)
    intensity = sonar.series.intensity.copy()
    intensity[(sonar.series.t > 30.0) & (sonar.series.t < 90.0)] = 0
    deaf = mission.with_sensor(replace(sonar, series=replace(sonar.series, intensity=intensity)))
    solution = gn.estimate(deaf, method)
    assert np.all(np.isfinite(solution.trajectory.p_n))
