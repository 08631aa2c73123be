"""Where a compass alone tells the turns, the graph looks at it often, and believes no more of it
than the smoothed readings tell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import gtsam_nav as gn
from gtsam_nav.config import Config
from gtsam_nav.frames import Array
from gtsam_nav.graph.factors import X
from gtsam_nav.graph.measurements import build_problem
from gtsam_nav.graph.outset import (
    COMPASS_INTERVAL_S,
    MOST_BY_COMPASS,
    mission_keyframes,
    start_and_motion,
)
from gtsam_nav.graph.refinement import knots_of
from gtsam_nav.mission import Mission
from gtsam_nav.simulation import SimulationSettings

NONE = np.empty(0)


@pytest.fixture(scope="module")
def compass_alone() -> Mission:
    settings = SimulationSettings.matched()
    mission = gn.simulate("marina", seed=1, duration_s=40.0, settings=settings)
    return mission.without("imu", "landmarks", "sonar")


def with_disturbance(mission: Mission, sigma_deg: float, time_s: float) -> Mission:
    compass = mission.sensors["heading"]
    noise = compass.noise | {"disturbance_sigma_deg": sigma_deg, "disturbance_time_s": time_s}
    return replace(mission, sensors=mission.sensors | {"heading": replace(compass, noise=noise)})


def spacing(mission: Mission) -> Array:
    return np.diff(mission_keyframes(mission, NONE, NONE, Config()))


def test_the_disturbance_cannot_stray_far_between_keyframes(compass_alone: Mission) -> None:
    apart = spacing(with_disturbance(compass_alone, 1.2, 60.0))
    # the variance of a bridge's middle
    strays_deg = np.sqrt(2 * 1.2**2 / 60.0 * apart / 4)
    assert np.max(strays_deg) <= 0.2 + 1e-9
    assert np.max(strays_deg) > 0.19
    assert np.min(spacing(with_disturbance(compass_alone, 20.0, 10.0))) > 0.9 * COMPASS_INTERVAL_S
    interval_s = Config().graph.keyframe_interval_s
    assert np.max(spacing(with_disturbance(compass_alone, 0.0, 60.0))) > 0.9 * interval_s


def test_while_the_imu_is_silent_the_compass_is_looked_at_often() -> None:
    mission = gn.simulate("marina", seed=1, duration_s=60.0).without("landmarks", "sonar")
    imu = mission.sensors["imu"]
    heard = (imu.series.t < 20.0) | (imu.series.t > 50.0)
    silent = mission.with_sensor(replace(imu, series=imu.series.select(heard)))
    before, after = (mission_keyframes(m, NONE, NONE, Config()) for m in (mission, silent))
    assert np.max(np.diff(before)) > 4.0
    within = after[(after >= 19.9) & (after <= 50.1)]
    assert np.max(np.diff(within)) <= COMPASS_INTERVAL_S + 1e-9
    assert np.max(np.diff(after[after >= 50.0])) > 4.0


def test_a_long_mission_gets_no_more_keyframes_for_it(compass_alone: Mission) -> None:
    compass = compass_alone.sensors["heading"]
    late = replace(compass.series, t=compass.series.t + 3 * MOST_BY_COMPASS)
    mission = replace(
        compass_alone, sensors=compass_alone.sensors | {"heading": replace(compass, series=late)}
    )
    assert len(spacing(mission)) <= MOST_BY_COMPASS + 1


def test_a_keyframe_knows_its_heading_no_better_than_the_smoothed_compass(
    compass_alone: Mission,
) -> None:
    config = Config()
    start, motion = start_and_motion(compass_alone, config)
    t = mission_keyframes(compass_alone, NONE, NONE, config)
    problem = build_problem(compass_alone, start, motion, t, config)
    poses = {X(k) for k in range(len(t))}
    roots = [
        entry.gaussian.noiseModel().R()[:3, :3]
        for entry in problem.entries
        if entry.sensor == "heading" and poses & set(entry.gaussian.keys())
    ]
    sigma = [float(np.sqrt(np.linalg.inv(root.T @ root)[2, 2])) for root in roots]
    assert motion.compass_sigma is not None
    assert motion.compass_sigma > np.radians(0.1)
    assert len(sigma) > 10
    assert min(sigma) >= motion.compass_sigma - 1e-12


def test_knots_are_where_they_are_asked_for() -> None:
    t_keyframes = np.arange(0.0, 31.0)
    t_echoes, t_scans = np.arange(0.5, 30.0), np.array([5.0, 15.0, 25.0])
    np.testing.assert_array_equal(
        knots_of(t_echoes, t_keyframes, t_scans).keyframes, [0, 5, 15, 25, 30]
    )
    every = knots_of(t_echoes, t_keyframes, t_scans, spacing_s=0.0)
    np.testing.assert_array_equal(every.keyframes, np.arange(31))
    np.testing.assert_allclose(every.fraction, 0.5)


@pytest.mark.parametrize("spacing_s", [0.0, 20.0])
def test_a_scan_without_echoes_has_its_knot_all_the_same(spacing_s: float) -> None:
    t_keyframes, t_scans = np.arange(0.0, 61.0), np.arange(5.0, 60.0, 10.0)
    t_echoes = np.concatenate([np.arange(0.5, 10.0), np.arange(30.5, 40.0)])
    knots = knots_of(t_echoes, t_keyframes, t_scans, spacing_s)
    t_knots = t_keyframes[knots.keyframes]
    assert np.all(np.isin(t_scans, t_knots))
    t_before, t_after = t_knots[knots.knot], t_knots[knots.knot + 1]
    np.testing.assert_allclose(t_before + knots.fraction * (t_after - t_before), t_echoes)
