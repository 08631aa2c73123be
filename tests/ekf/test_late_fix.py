"""Dead reckoning whose one fix came late."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import gtsam_nav as gn
from gtsam_nav.mission import Mission
from gtsam_nav.simulation import simulate


def marina(first_fix_s: float) -> Mission:
    mission = simulate("marina", seed=2, duration_s=120.0)
    gnss = mission.sensors["gnss"]
    late = replace(gnss, series=gnss.series.crop(first_fix_s, np.inf))
    return mission.with_sensor(late)


@pytest.mark.parametrize("first_fix_s", [0.0, 60.0])
def test_the_track_passes_its_fix_when_it_was_taken(first_fix_s: float) -> None:
    mission = marina(first_fix_s)
    solution = gn.estimate(mission, "dr")
    scores = gn.evaluate(solution, mission.reference)
    assert scores.ate.none is not None
    assert scores.ate.none.rmse < 2.5
    assert scores.nees is not None
    assert 0.02 < scores.nees.mean < 4.0
    assert solution.gnss_used == 1
    sigma = solution.trajectory.sigma_p_n
    assert sigma is not None
    assert np.all(np.hypot(*sigma.T[:2]) < 10.0)


def test_a_stated_start_stays() -> None:
    mission = marina(60.0)
    stated = replace(mission.initial, p_n=(5.0, -3.0, 0.0), sigma_p=1.0)
    solution = gn.estimate(replace(mission, initial=stated), "dr")
    np.testing.assert_allclose(solution.trajectory.p_n[0, :2], [5.0, -3.0], atol=0.5)
