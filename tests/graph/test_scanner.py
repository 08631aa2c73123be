"""A ground robot's scanner: its clock, the odometry's wheels, and loops between submaps."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

import gtsam_nav as gn
from gtsam_nav.config import Config
from gtsam_nav.evaluation.relations import between, planar_poses
from gtsam_nav.frames import Array
from gtsam_nav.graph.scan_calibration import ScanCalibration, calibrate_by_scans
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.preprocess.alignment import align
from gtsam_nav.preprocess.motion import vehicle_motion
from gtsam_nav.readers.carmen import LASER_NOISE, LATE_S
from gtsam_nav.series import OdometrySeries, ScanSeries
from gtsam_nav.sonar.echoes import echoes_of_scans
from gtsam_nav.sonar.motion import PlanarMotion
from gtsam_nav.sonar.preparation import deskewed, scans_at_once, sonar_turns

RATE_HZ = 5.0
LATE = 0.12
CURVATURE = np.radians(0.8)


def drive(laps: float) -> tuple[Array, Array]:
    """Times, and poses (n, 3) on a rounded square of 12 m a side, with a swaying course."""
    t = np.arange(0.0, 64.0 * laps, 0.02)
    phase = 2 * np.pi * t / 64.0
    north, east = 6 * np.tanh(1.5 * np.cos(phase)), 6 * np.tanh(1.5 * np.sin(phase))
    north = north + 0.3 * np.sin(7 * phase)
    course = np.unwrap(np.arctan2(np.gradient(east, t), np.gradient(north, t)))
    return t, np.column_stack([north, east, course])


def walls() -> Array:
    """Segments (n, 2, 2) of a ring of corridor with niches."""
    rng = np.random.default_rng(5)
    found = []
    for half, side in ((9.0, 1.0), (3.0, -1.0)):
        corners = half * np.array([[1, 1], [1, -1], [-1, -1], [-1, 1], [1, 1]])
        found += list(pairwise(corners))
        for _ in range(14):
            a = rng.uniform(-half, half)
            edge = half - side * rng.uniform(0.3, 0.9)
            at = np.array([[a, edge], [a + 0.8, edge]])
            turn = rng.integers(4)
            c, s = np.cos(turn * np.pi / 2), np.sin(turn * np.pi / 2)
            found.append(tuple(at @ np.array([[c, -s], [s, c]]).round(12)))
    return np.array(found)


def seen(pose: Array, segments: Array, rng: np.random.Generator) -> Array:
    """Points of a laser of 180 degrees, in the body frame."""
    angle = pose[2] + np.radians(np.arange(-90, 90, 2.0))
    ray = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    a, along = segments[:, 0] - pose[:2], segments[:, 1] - segments[:, 0]
    cross = ray[:, None, 0] * along[None, :, 1] - ray[:, None, 1] * along[None, :, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        r = (a[:, 0] * along[:, 1] - a[:, 1] * along[:, 0])[None] / cross
        u = (a[None, :, 0] * ray[:, None, 1] - a[None, :, 1] * ray[:, None, 0]) / cross
    r = np.where((r > 0) & (u >= 0) & (u <= 1), r, np.inf).min(axis=1)
    r = r + rng.normal(0.0, 0.02, len(r))
    body = angle - pose[2]
    return (r[:, None] * np.stack([np.cos(body), np.sin(body)], axis=1))[np.isfinite(r)]


@cache
def robot(laps: float) -> tuple[Mission, Array, Array]:
    """A mission whose scans are stamped late and whose wheels differ; and its true course."""
    rng, segments = np.random.default_rng(2), walls()
    t, poses = drive(laps)
    step = between(poses[:-5:5], poses[5::5])
    middle, dt = 0.5 * (t[:-5:5] + t[5::5]), 0.1
    v = np.hypot(step[:, 0], step[:, 1]) / dt
    columns = {
        "t": middle,
        "v_b": np.column_stack([v * rng.normal(1.0, 0.02, len(v)), np.zeros(len(v))]),
        "yaw_rate": step[:, 2] / dt - CURVATURE * v + rng.normal(0.0, 0.01, len(v)),
        "sigma_v": np.full(len(v), 0.1),
        "sigma_yaw_rate": np.full(len(v), 0.05),
    }
    row = np.arange(len(v))
    odometry = Sensor("odometry", "odometry", OdometrySeries(row=row, **columns))
    taken = np.arange(0, len(t), round(50 / RATE_HZ))
    points = [seen(poses[k], segments, rng) for k in taken]
    first = np.concatenate([[0], np.cumsum([len(p) for p in points])]).astype(np.int64)
    series = ScanSeries(
        t=t[taken] + LATE, row=np.arange(len(taken)), first=first, points_b=np.concatenate(points)
    )
    scans = Sensor("scans", "scans", series, noise=LASER_NOISE, time_offset_sigma_s=LATE_S)
    return Mission("robot", {"odometry": odometry, "scans": scans}), t, poses


def calibrated(mission: Mission) -> ScanCalibration | None:
    config = Config()
    motion = vehicle_motion(mission, align(mission), config.motion)
    planar = PlanarMotion.of(
        motion.trajectory, motion.position_variance_m2_s, motion.yaw_variance_rad2_s
    )
    turns = sonar_turns(mission, config.sonar, planar)
    assert turns is not None
    echoes = echoes_of_scans(mission.sensors["scans"])
    sonar = deskewed(echoes, turns, planar, at_once=scans_at_once(mission))
    return calibrate_by_scans(mission, sonar, motion, config)


def test_scans_tell_their_clock_and_the_wheels() -> None:
    mission, _, _ = robot(0.6)
    found = calibrated(mission)
    assert found is not None
    assert found.clock is not None
    assert found.clock.offset_s == pytest.approx(-LATE, abs=0.03)
    assert found.clock.sigma_s < 0.5 * LATE_S
    assert np.degrees(found.curvature_rad_m) == pytest.approx(0.8, abs=0.3)
    corrected = found.corrected(mission)
    # the graph takes the same scans in: what they told is no prior of its own
    assert corrected.sensors["odometry"].noise == mission.sensors["odometry"].noise
    again = calibrated(corrected)
    assert again is not None
    assert abs(again.offset_s) < 0.03
    assert abs(np.degrees(again.curvature_rad_m)) < 0.3


def test_what_is_known_is_not_sought() -> None:
    mission, _, _ = robot(0.6)
    scans, wheels = mission.sensors["scans"], mission.sensors["odometry"]
    known = mission.with_sensor(replace(scans, time_offset_sigma_s=0.0))
    found = calibrated(known)
    assert found is not None
    assert found.clock is None
    assert found.offset_s == 0.0
    known = known.with_sensor(replace(wheels, noise={"curvature_sigma_deg_m": 0.0}))
    assert calibrated(known) is None


def test_a_clock_that_nobody_doubts_is_not_spoken_of() -> None:
    mission, _, _ = robot(0.6)
    scans = mission.sensors["scans"]
    solution = gn.estimate(mission.with_sensor(replace(scans, time_offset_sigma_s=0.0)), "graph")
    assert solution.clock_offsets == ()
    assert not any("time offset" in warning for warning in solution.warnings)


def test_a_slow_sonars_scans_are_not_taken_at_once() -> None:
    mission, _, _ = robot(0.6)
    scans = mission.sensors["scans"]
    slow = mission.with_sensor(replace(scans, series=scans.series.select(np.arange(0, 150, 15))))
    assert scans_at_once(mission)
    assert not scans_at_once(slow)


@pytest.mark.slow
def test_two_laps_are_one() -> None:
    """By dead reckoning the second lap lies beside the first."""
    mission, t, poses = robot(2.0)
    apart = np.column_stack([np.arange(5.0, 60.0, 5.0), np.arange(5.0, 60.0, 5.0) + 64.0])
    true = between(*(np.column_stack([np.interp(at, t, c) for c in poses.T]) for at in apart.T))
    errors = {}
    for method in ("dr", "graph"):
        solution = gn.estimate(mission, method)
        q = between(*(planar_poses(solution.trajectory, at) for at in apart.T))
        errors[method] = np.hypot(*(q - true)[:, :2].T)
    assert errors["dr"].max() > 2.0
    assert errors["graph"].max() < 0.3
    accepted = [loop for loop in solution.loops if loop.verdict == "accepted"]
    assert len(accepted) >= 5
    assert solution.clock_offsets[0].observed


@pytest.mark.slow
def test_a_stretch_that_shows_nothing_closes_no_loop() -> None:
    mission, _, _ = robot(2.0)
    scans = mission.sensors["scans"]
    series = scans.series
    assert isinstance(series, ScanSeries)
    sees = (series.t % 64.0 < 10.0) | (series.t % 64.0 > 40.0)
    sizes = np.where(sees, np.diff(series.first), 0)
    kept = np.repeat(sees, np.diff(series.first))
    first = np.concatenate([[0], np.cumsum(sizes)])
    dim = replace(series, first=first, points_b=series.points_b[kept])
    solution = gn.estimate(mission.with_sensor(replace(scans, series=dim)), "graph")
    empty = [loop for loop in solution.loops if loop.reason == "fewer than 20 points"]
    assert empty
    assert all(loop.verdict == "rejected" and np.isnan(loop.dx_m) for loop in empty)
    assert any(loop.verdict == "accepted" for loop in solution.loops)
