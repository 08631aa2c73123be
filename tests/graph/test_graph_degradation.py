"""The graph on missions that lack something: a recorded degradation and a result, nothing lost."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from test_exported import moved_by_levenberg_marquardt

import gtsam_nav as gn
from gtsam_nav.frames import Array, Origin, sag_m
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.series import (
    BeamSeries,
    DepthSeries,
    DvlSeries,
    GnssSeries,
    HeadingSeries,
    ScanSeries,
    Series,
)
from gtsam_nav.simulation import SimulationSettings
from gtsam_nav.solution import Solution
from gtsam_nav.sonar.defects import WHOLE_SENSOR
from gtsam_nav.sonar.echoes import segment
from gtsam_nav.sonar.scans import find_turns
from gtsam_nav.trajectory import Trajectory

DURATION_S = 60.0
SOON = ("graph.loops.min_separation_s=20", "graph.loops.radius_m=30")
"""In a minute the vehicle comes back to no place: let scans half a minute apart be loops."""


@pytest.fixture(scope="module")
def mission() -> Mission:
    return gn.simulate("marina", seed=3, duration_s=DURATION_S)


def estimated(mission: Mission, *overrides: str) -> Solution:
    return gn.estimate(mission, "graph", gn.load_config(None, overrides))


VELOCITY_ERRORS = {"velocity_scale", "velocity_misalignment_rad"}


def assert_sound(solution: Solution) -> None:
    """A whole trajectory with positive covariances."""
    trajectory = solution.trajectory
    assert trajectory.t[0] < 1.0
    assert trajectory.t[-1] > DURATION_S - 1.0
    assert trajectory.cov_pose_n is not None
    assert np.all(np.linalg.eigvalsh(trajectory.cov_pose_n[::50]) > 0)
    assert solution.online is not None
    assert len(solution.online) == solution.n_keyframes


def rmse_m(solution: Solution) -> float:
    errors = gn.evaluate(solution).ate.none
    assert errors is not None
    return errors.rmse


def with_beams(mission: Mission, **change: Array) -> Mission:
    sonar = mission.sensors["sonar"]
    assert isinstance(sonar.series, BeamSeries)
    return mission.with_sensor(replace(sonar, series=replace(sonar.series, **change)))


@pytest.mark.parametrize("fault", ["off", "silent", "frozen"])
def test_unusable_sonar_is_recorded(mission: Mission, fault: str) -> None:
    series = mission.sensors["sonar"].series
    assert isinstance(series, BeamSeries)
    faulty, overrides, reason = {
        "off": (mission, ["sonar.use=false"], "switched off by sonar.use"),
        "silent": (
            with_beams(mission, intensity=np.zeros_like(series.intensity)),
            [],
            "all echo intensities are zero",
        ),
        "frozen": (
            with_beams(mission, angle=np.full(len(series), 1.0)),
            [],
            "the head angle never changes",
        ),
    }[fault]
    solution = estimated(faulty, *overrides)
    assert_sound(solution)
    whole = [r for r in solution.rejections if r.index == WHOLE_SENSOR]
    assert [(r.sensor, r.reason) for r in whole] == [("sonar", reason)]
    assert any("sonar" in warning and reason in warning for warning in solution.warnings)
    assert solution.sonar_map is None
    assert solution.sonar_kind is None
    assert solution.loops == ()
    assert rmse_m(solution) < 1.0


def test_odometry_stands_in_for_the_dvl(mission: Mission) -> None:
    solution = estimated(mission.without("dvl"))
    assert_sound(solution)
    assert rmse_m(solution) < 1.0


def test_a_second_sensor_of_a_kind_is_said_to_be_left_out(mission: Mission) -> None:
    twin = replace(mission.sensors["dvl"], name="aft_dvl")
    few = mission.without("sonar", "landmarks", "imu").crop(0.0, 10.0)
    assert not any("of several sensors" in said for said in estimated(few).warnings)
    said = "'aft_dvl' is left out: of several sensors of type dvl the graph takes one, 'dvl'"
    assert said in estimated(few.with_sensor(twin)).warnings


def test_a_slow_imu_before_a_fast_one_tells_nothing(mission: Mission) -> None:
    few = mission.without("sonar", "landmarks", "odometry").crop(0.0, 10.0)
    imu = few.sensors["imu"]
    seconds = np.arange(len(imu.series)) % 100 == 0
    slow = replace(imu, name="slow", series=imu.series.select(seconds))
    both = replace(few, sensors={"slow": slow, **few.sensors})
    alone, beside = (estimated(one).trajectory for one in (few, both))
    np.testing.assert_array_equal(beside.p_n, alone.p_n)


def test_without_gnss_nothing_is_georeferenced(mission: Mission) -> None:
    solution = estimated(mission.without("gnss"))
    assert_sound(solution)
    assert not solution.georeferenced
    ate = gn.evaluate(solution).ate
    assert ate.none is None
    assert ate.se2 is not None
    assert ate.se2.rmse < 1.0


def test_a_receiver_of_velocities_alone_leaves_the_frame_local(mission: Mission) -> None:
    gnss = mission.sensors["gnss"]
    series = gnss.series
    assert isinstance(series, GnssSeries)
    useless = replace(series, sigma=np.full((len(series), 3), 2e4))
    bare = mission.without("sonar", "landmarks").with_sensor(replace(gnss, series=useless))
    solution = estimated(bare)
    assert not solution.georeferenced
    assert solution.trajectory.sigma_p_n is not None
    assert np.all(solution.trajectory.sigma_p_n[0, :2] < 2.0)


def test_dvl_and_sonar_alone(mission: Mission) -> None:
    """Nothing measures heading, attitude, depth or position."""
    lost = ("gnss", "heading", "attitude", "depth", "imu", "odometry", "landmarks")
    solution = estimated(mission.without(*lost))
    assert_sound(solution)
    assert not solution.georeferenced
    assert solution.slow_states is not None
    assert set(solution.slow_states.columns) == VELOCITY_ERRORS


def test_velocities_whose_turns_nothing_tells_leave_the_way_as_long_as_it_was() -> None:
    mission = gn.simulate("marina", 3, 150.0, SimulationSettings(sonar=None, landmarks=None))
    blind = mission.without("heading", "attitude", "imu", "odometry", "gnss")
    dead_reckoned, found = (gn.estimate(blind, name).trajectory for name in ("dr", "graph"))
    assert np.max(np.linalg.norm(np.diff(found.p_n, axis=0), axis=1) / np.diff(found.t)) < 1.0
    assert way_m(found) == pytest.approx(way_m(dead_reckoned), rel=0.02)


def way_m(trajectory: Trajectory) -> float:
    return float(np.sum(np.linalg.norm(np.diff(trajectory.p_n[:, :2], axis=0), axis=1)))


def test_slow_imu_is_not_preintegrated(mission: Mission) -> None:
    imu = mission.sensors["imu"]
    slow = mission.with_sensor(replace(imu, series=imu.series.select(slice(None, None, 10))))
    solution = estimated(slow)
    assert_sound(solution)
    assert solution.slow_states is not None
    assert set(solution.slow_states.columns) == {"heading_bias_rad"} | VELOCITY_ERRORS
    assert rmse_m(solution) < 1.0


def test_imu_gap_is_bridged(mission: Mission) -> None:
    imu = mission.sensors["imu"]
    t = imu.series.t
    gap = mission.with_sensor(replace(imu, series=imu.series.select((t < 20) | (t > 27))))
    solution = estimated(gap)
    assert_sound(solution)
    assert rmse_m(solution) < 1.0


def silent(mission: Mission, *names: str) -> Mission:
    """Without the samples of some sensors from 20 s to 50 s."""
    for name in names:
        sensor = mission.sensors[name]
        t = sensor.series.t
        said = sensor.series.select((t < 20.0) | (t > 50.0))
        mission = mission.with_sensor(replace(sensor, series=said))
    return mission


@pytest.mark.parametrize("others", [(), ("imu",)], ids=["imu", "no imu"])
def test_a_depth_is_not_held_while_its_sensor_is_silent(
    mission: Mission, others: tuple[str, ...]
) -> None:
    mission = mission.without("sonar", "landmarks", *others)
    whole, solution = estimated(mission), estimated(silent(mission, "depth"))
    assert_sound(solution)
    read = solution.robust_weights["depth"].t
    assert not np.any((read > 21.0) & (read < 49.0))
    assert any("'depth' is silent from " in said for said in solution.warnings)
    sigma_m, whole_m = (np.interp(35.0, s.trajectory.t, down_sigma(s)) for s in (solution, whole))
    assert sigma_m > 1.2 * whole_m
    off_m = solution.trajectory.p_n[:, 2] - whole.trajectory.p_n[:, 2]
    assert np.all(np.abs(off_m) < 5.0 * down_sigma(solution))


@pytest.mark.parametrize(("from_s", "holds"), [(20.0, True), (5.0, False)], ids=["told", "untold"])
def test_heights_of_fixes_count_from_the_zero_of_a_depth_sensor_that_fell_silent(
    mission: Mission, from_s: float, holds: bool
) -> None:
    """Where the fixes beside it tell that zero; else the accelerometers alone carry the height."""
    depth, gnss = mission.sensors["depth"], mission.sensors["gnss"]
    fixes = gnss.series
    assert isinstance(fixes, GnssSeries)
    short = replace(depth, series=depth.series.crop(0.0, from_s))
    mission = mission.without("sonar", "landmarks", "dvl", "odometry").with_sensor(short)
    higher = replace(fixes, p_n=fixes.p_n - [0.0, 0.0, 40.0])
    as_stated, lifted = (
        estimated(mission.with_sensor(replace(gnss, series=series))) for series in (fixes, higher)
    )
    off_m = np.abs(lifted.trajectory.p_n - as_stated.trajectory.p_n)
    assert np.all(off_m[:, :2] < 0.2)
    # heights that nothing tells, known to tens of metres, depend on the start by so much
    assert np.all(off_m[:, 2] < 0.2 + 0.005 * down_sigma(as_stated))
    assert (np.max(down_sigma(as_stated)) < 1.0) == holds


def test_heights_of_fixes_follow_the_sea_far_from_the_origin() -> None:
    """The zero of a depth sensor that fell silent, 30 km off, is not the plane's."""
    rng = np.random.default_rng(0)
    t, origin = np.arange(0.0, 1000.0, 5.0), Origin(41.0, 3.0, 0.0)
    p_n = np.column_stack([30.0 * t, 0.0 * t, 5.0 + 0.0 * t])
    p_n[:, 2] += sag_m(p_n, origin)
    one, every = np.ones(len(t)), np.ones(len(t), dtype=bool)
    v_d = np.tile([30.0, 0.0, 0.0], (len(t), 1))
    dvl = DvlSeries(t=t, v_d=v_d, sigma=0.02 * one, valid=every, bottom_lock=every)
    fixes = p_n + rng.normal(0.0, 0.5, p_n.shape)
    series: dict[str, Series] = {
        "dvl": dvl,
        "heading": HeadingSeries(t=t, heading=0.0 * t, sigma=0.01 * one),
        "depth": DepthSeries(t=t, depth_m=5.0 * one, sigma=0.05 * one).crop(500.0, 1000.0),
        "gnss": GnssSeries(t=t, p_n=fixes, sigma=np.full(p_n.shape, 0.5)),
    }
    aboard = {name: Sensor(name, name, told) for name, told in series.items()}
    solution = gn.estimate(
        Mission("far", aboard, origin=origin), "graph", gn.load_config(None, ["gnss.use=all"])
    )
    off_m = solution.trajectory.p_n[:, 2] - np.interp(solution.trajectory.t, t, p_n[:, 2])
    assert np.median(np.abs(off_m[solution.trajectory.t < 500.0])) < 1.0


def down_sigma(solution: Solution) -> Array:
    assert solution.trajectory.sigma_p_n is not None
    return solution.trajectory.sigma_p_n[:, 2]


def test_a_tilt_is_not_held_while_its_sensor_is_silent(mission: Mission) -> None:
    """The IMU carries it; without one it is as vague as where nothing ever measures it."""
    mission = silent(mission.without("sonar", "landmarks"), "attitude")
    carried, lost = estimated(mission), estimated(mission.without("imu"))
    for solution, instead in ((carried, "the IMU carries"), (lost, "nothing tells")):
        assert_sound(solution)
        (said,) = [w for w in solution.warnings if w.startswith("'attitude' is silent")]
        assert said.endswith(f"{instead} roll and pitch")
    roll_sigma = [np.degrees(np.sqrt(tilt_variance(s).max())) for s in (carried, lost)]
    assert roll_sigma[0] < 1.0
    assert roll_sigma[1] > 3.0


def test_a_tilt_that_is_told_a_moment_later_holds_from_the_start(mission: Mission) -> None:
    mission = mission.without("sonar", "landmarks", "imu")
    attitude = mission.sensors["attitude"]
    later = attitude.series.select(attitude.series.t > 1.3)
    solution = estimated(mission.with_sensor(replace(attitude, series=later)))
    assert not any("is silent" in said for said in solution.warnings)
    assert solution.trajectory.cov_pose_n is not None
    assert np.degrees(np.sqrt(solution.trajectory.cov_pose_n[0, 3, 3])) < 1.5


def tilt_variance(solution: Solution) -> Array:
    """About the level axes, in the midst of the silence."""
    trajectory = solution.trajectory
    assert trajectory.cov_pose_n is not None
    return np.diagonal(trajectory.cov_pose_n[np.searchsorted(trajectory.t, 35.0)])[3:5]


def test_an_imu_that_is_silent_with_the_tilt_is_bridged(mission: Mission) -> None:
    imu = mission.sensors["imu"]
    t = imu.series.t
    gap = mission.with_sensor(replace(imu, series=imu.series.select((t < 30) | (t > 33))))
    assert_sound(estimated(silent(gap.without("sonar", "landmarks"), "attitude")))


def test_short_mission_without_a_scan(mission: Mission) -> None:
    """Three seconds: a start, a stop, no turn of the head in between."""
    solution = estimated(mission.crop(0.0, 3.0))
    assert len(solution.trajectory) > 10
    assert solution.loops == ()


def as_scans(mission: Mission) -> Mission:
    """The same sonar as scans that were extracted elsewhere, each moved to its middle's frame."""
    sonar, config = mission.sensors["sonar"], gn.Config()
    assert mission.reference is not None
    echoes = segment(sonar, config.sonar.segmentation)
    turns = find_turns(sonar, config.sonar.scans.max_gap_s)
    dead_reckoned = gn.estimate(mission, "dr", config).trajectory
    points, first = [], [0]
    for begin, end, t_ref in zip(turns.first, turns.last, turns.t_ref, strict=True):
        own = (echoes.beam >= begin) & (echoes.beam < end)
        t, which = np.unique(echoes.t[own], return_inverse=True)
        there = dead_reckoned.interpolate(np.clip(t, *dead_reckoned.t[[0, -1]]))
        here = dead_reckoned.interpolate([t_ref])
        xyz_b = np.column_stack([echoes.xy_b[own], np.zeros(own.sum())])
        p_n = there.p_n[which] + np.einsum("kij,kj->ki", there.R_nb[which], xyz_b)
        points.append((p_n - here.p_n[0]) @ here.R_nb[0])
        first.append(first[-1] + int(own.sum()))
    series = ScanSeries(t=turns.t_ref, first=np.array(first), points_b=np.concatenate(points))
    scans = Sensor(name="scans", type="scans", series=series, noise=sonar.noise)
    return mission.without("sonar").with_sensor(scans)


def test_scans_extracted_elsewhere_run_the_same_way(mission: Mission) -> None:
    solution = estimated(as_scans(mission))
    assert_sound(solution)
    assert solution.sonar_kind == "recorded"
    assert solution.sonar_map is not None
    assert solution.pose_graph is not None
    # scan matches beside the motion between keyframes
    assert len(solution.pose_graph.edges) > solution.n_keyframes - 1
    assert rmse_m(solution) < 0.6


def test_every_candidate_loop_has_a_verdict(mission: Mission, tmp_path: Path) -> None:
    solution = estimated(mission, *SOON)
    assert solution.pose_graph is not None
    _, moved = moved_by_levenberg_marquardt(solution.pose_graph, tmp_path / "graph.g2o")
    assert moved.max() < 0.01
    assert len(solution.loops) >= 2
    for loop in solution.loops:
        assert loop.t_b - loop.t_a >= 20.0
        assert loop.verdict in ("accepted", "rejected")
        if loop.verdict == "accepted":
            assert loop.reason == ""
            assert loop.weight is not None
            assert 0 < loop.weight <= 1
        else:
            assert loop.reason
            assert loop.weight is None
    scans = solution.scans
    assert scans is not None
    assert {t for loop in solution.loops for t in (loop.t_a, loop.t_b)} <= set(scans.t)
    beams = solution.mission.sensors[scans.sensor].series.t
    np.testing.assert_array_equal(beams[(scans.first_beam + scans.last_beam) // 2], scans.t)
    counts = gn.evaluate(solution).loops
    assert counts.proposed == len(solution.loops) == counts.accepted + counts.rejected


def test_impossible_gate_rejects_every_loop_with_its_reason(mission: Mission) -> None:
    solution = estimated(mission, *SOON, "graph.robust.loops.gate_probability=1e-9")
    assert_sound(solution)
    assert solution.loops
    assert {loop.verdict for loop in solution.loops} == {"rejected"}
    assert all(loop.reason for loop in solution.loops)


def test_a_yaw_that_nothing_tells_any_more_is_one_nobody_knows(mission: Mission) -> None:
    blind = mission.without("imu", "odometry", "sonar", "landmarks")
    heading = blind.sensors["heading"]
    ended = blind.with_sensor(replace(heading, series=heading.series.crop(0.0, 20.0)))
    solution = estimated(ended, "gnss.use=none")
    sigma = solution.trajectory.sigma_rpy
    assert sigma is not None
    at_20, at_60 = np.searchsorted(solution.trajectory.t, [20.0, 60.0]).clip(max=len(sigma) - 1)
    assert np.degrees(sigma[at_20, 2]) < 5.0
    assert np.degrees(sigma[at_60, 2]) > 75.0
    assert any("nothing measures how the vehicle turns from 19.9 s" in w for w in solution.warnings)
