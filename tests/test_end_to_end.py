"""From logs to scores: what the methods must reach."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import gtsam_nav as gn
from benchmarks.acceptance import MARINA, SEEDS, marina, run, stpere


def test_golden_short_mission() -> None:
    """Two minutes of the marina with a minute of GNSS."""
    mission = gn.simulate("marina", seed=11, duration_s=120.0)
    overrides = ("gnss.use=window", "gnss.window_s=[0,60]")
    dr = run(mission, "dr", overrides)
    graph = run(mission, "graph", overrides)
    assert dr.coverage is not None
    assert dr.coverage > 0.99
    assert graph.coverage is not None
    assert graph.coverage > 0.99
    assert dr.ate_none_rmse is not None
    assert dr.ate_none_rmse < 6.0
    assert graph.ate_none_rmse is not None
    assert graph.ate_none_rmse < 0.6
    assert graph.ate_none_rmse < dr.ate_none_rmse
    assert graph.nees_mean is not None
    assert 0.05 < graph.nees_mean < 10.0
    assert graph.sonar == "simulated"


@pytest.mark.slow
def test_marina_with_and_without_sonar() -> None:
    nees = []
    for seed in SEEDS:
        with_sonar, without = marina(seed, sonar=True), marina(seed, sonar=False)
        assert with_sonar.overrides[:2] == MARINA
        assert with_sonar.ate_none_rmse is not None
        assert without.ate_none_rmse is not None
        assert with_sonar.ate_none_rmse <= 0.6, f"seed {seed}"
        assert without.ate_none_rmse >= 2 * with_sonar.ate_none_rmse, f"seed {seed}"
        assert with_sonar.coverage is not None
        assert with_sonar.coverage >= 0.99
        nees.append(with_sonar.nees_mean)
    assert 0.5 <= np.mean(nees) <= 4.0


@pytest.fixture(scope="module")
def stpere_mission(stpere_folder: Path) -> gn.Mission:
    return gn.open_mission(stpere_folder)


@pytest.mark.slow
@pytest.mark.realdata
def test_stpere_with_five_minutes_of_gnss(stpere_mission: gn.Mission) -> None:
    graph = stpere(stpere_mission, "window")
    assert graph.sonar == "simulated"
    assert graph.ate_none_mean is not None
    assert graph.ate_none_mean <= 1.2
    assert graph.ate_se2_mean is not None
    assert graph.ate_se2_mean <= 0.75
    assert graph.coverage is not None
    assert graph.coverage >= 0.99
    dr = stpere(stpere_mission, "window", "dr")
    assert dr.ate_none_mean is not None
    assert dr.ate_none_mean > 5.0, "the real logs' drift is there, unhidden"


@pytest.mark.slow
@pytest.mark.realdata
def test_stpere_without_gnss(stpere_mission: gn.Mission) -> None:
    graph = stpere(stpere_mission, "none")
    assert graph.ate_none_mean is None
    assert graph.ate_se2_mean is not None
    assert graph.ate_se2_mean <= 0.75
    assert graph.coverage is not None
    assert graph.coverage >= 0.99
    dr = stpere(stpere_mission, "none", "dr")
    assert dr.ate_se2_mean is not None
    assert dr.ate_se2_mean > 2 * graph.ate_se2_mean
