"""Turns by a compass alone: as uncertain as the smoothed readings are."""

from __future__ import annotations

import numpy as np
import pytest

import gtsam_nav as gn
from gtsam_nav.preprocess.compass_turns import (
    disturbance_walk_rad2_s,
    smoothed_heading,
    turned_by_compass,
)
from gtsam_nav.series import HeadingSeries
from gtsam_nav.simulation.processes import gauss_markov

STEP_S, SIGMA, YAW_ACCEL = 0.1, 0.005, 0.1


def test_what_the_smoother_leaves_of_the_noise_is_what_it_says() -> None:
    rng, n, walk = np.random.default_rng(1), 20_000, 4e-5
    t = STEP_S * np.arange(n)
    rate = np.cumsum(YAW_ACCEL * np.sqrt(STEP_S) * rng.normal(size=n))
    turned = np.cumsum(STEP_S * rate) + np.cumsum(np.sqrt(walk * STEP_S) * rng.normal(size=n))
    readings = turned + SIGMA * rng.normal(size=n)
    headings = HeadingSeries(t=t, heading=readings, sigma=np.full(n, SIGMA))
    level, sigma = smoothed_heading(headings, walk, YAW_ACCEL)
    assert np.std(level - turned) == pytest.approx(sigma, rel=0.05)
    assert sigma < 0.8 * SIGMA


def test_the_disturbance_walks_as_its_model_does_at_first() -> None:
    mission = gn.simulate("marina", seed=1, duration_s=20.0)
    compass = mission.sensors["heading"]
    spread, time_s = 2.0, 60.0
    compass.noise.update(disturbance_sigma_deg=spread, disturbance_time_s=time_s)
    strays = gauss_markov(np.random.default_rng(0), 200_000, 1.0, np.radians(spread), time_s, 1)
    per_s = np.mean(np.diff(strays[:, 0]) ** 2)
    assert disturbance_walk_rad2_s(mission) == pytest.approx(per_s, rel=0.03)


def test_a_gyro_takes_the_turns_from_the_compass() -> None:
    mission = gn.simulate("marina", seed=1, duration_s=20.0)
    assert not turned_by_compass(mission)
    assert turned_by_compass(mission.without("imu"))
    assert not turned_by_compass(mission.without("imu", "heading"))
