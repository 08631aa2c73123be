"""Missions with 3-D clouds through the factor graph: odometry, loops and map."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import gtsam_nav as gn
from gtsam_nav.config import load_config
from gtsam_nav.mission import Mission
from gtsam_nav.registration import packages
from gtsam_nav.series import Cloud, CloudSeries, ReferenceSeries
from gtsam_nav.simulation import SimulationSettings, make_scenario, simulate
from gtsam_nav.simulation.lidar import LidarSimulation
from gtsam_nav.solution import Solution


def lap(duration_s: float, seed: int = 3) -> Mission:
    """The harbour at 4 m/s with few sweeps: a lap takes 45 s."""
    settings = make_scenario("harbour").settings
    motion = settings.motion.model_copy(update={"rest_s": 1.0, "ramp_s": 3.0, "speed_m_s": 4.0})
    quick = {**dict(settings), "motion": motion, "lidar": LidarSimulation(rate_hz=4.0)}
    return simulate("harbour", seed, duration_s, SimulationSettings.model_validate(quick))


def errors_m(solution: Solution, mission: Mission) -> np.ndarray:
    """Distance from the truth after the start's pose is taken out, shape (n,)."""
    assert mission.reference is not None
    series = mission.reference.series
    assert isinstance(series, ReferenceSeries)
    inside = solution.trajectory.covers(series.t)
    p_n = solution.trajectory.interpolate(series.t[inside]).p_n[:, :2]
    truth = series.p_n[inside, :2]
    a, b = (x[:, 0] + 1j * x[:, 1] for x in (p_n, truth))
    a, b = a - a.mean(), b - b.mean()
    return np.abs(a * np.exp(1j * np.angle(np.sum(np.conj(a) * b))) - b)


@pytest.mark.slow
@pytest.mark.usefixtures("open3d_here")
def test_a_lap_is_closed_and_mapped(tmp_path: Path) -> None:
    mission = lap(56.0)
    config = load_config(None, ["gnss.use=none"])
    solution = gn.estimate(mission, "graph", config)
    accepted = [loop for loop in solution.loops if loop.verdict == "accepted"]
    assert len(accepted) >= 2
    assert all(loop.t_b - loop.t_a >= 30.0 for loop in accepted)
    assert errors_m(solution, mission).max() < 0.15
    assert solution.sonar_map is not None
    heights = -solution.sonar_map.points_n[:, 2]
    assert len(heights) > 5000
    assert -1.0 < np.percentile(heights, 1) < np.percentile(heights, 99) < 10.5
    gn.write_run(solution, config, tmp_path)
    rows = (tmp_path / "graph" / "loops.csv").read_text(encoding="utf-8").splitlines()
    assert len(rows) == 1 + len(solution.loops)
    assert (tmp_path / "graph" / "map.ply").is_file()


@pytest.mark.slow
def test_without_open3d_the_trajectory_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    """Loops and map are missing, and said to be."""
    attempt = packages._attempt
    monkeypatch.setattr(
        packages,
        "_attempt",
        lambda module: (None, "libGL.so.1 is missing") if module == "open3d" else attempt(module),
    )
    mission = lap(48.0)
    solution = gn.estimate(mission, "graph", load_config(None, ["gnss.use=none"]))
    assert errors_m(solution, mission).max() < 0.5
    assert solution.sonar_map is None
    assert [w for w in solution.warnings if "no loops" in w and "libGL.so.1" in w]
    assert [w for w in solution.warnings if "no map" in w and "libGL.so.1" in w]


@pytest.mark.parametrize("broken", ["package", "points"])
def test_unusable_clouds_leave_the_rest(broken: str, monkeypatch: pytest.MonkeyPatch) -> None:
    mission = lap(6.0)
    if broken == "package":
        monkeypatch.setattr(packages, "_attempt", lambda _: (None, "no module"))
    else:
        lidar = mission.sensors["lidar"]
        assert isinstance(lidar.series, CloudSeries)
        empty = (Cloud(np.zeros((0, 3))),) * len(lidar.series)
        mission = mission.with_sensor(replace(lidar, series=replace(lidar.series, clouds=empty)))
    solution = gn.estimate(mission, "graph")
    assert len(solution.trajectory) > 50
    said = [w for w in solution.warnings if "the clouds are not used" in w]
    assert len(said) == 1
    assert {"package": "kiss_icp", "points": "fewer than two clouds"}[broken] in said[0]


@pytest.mark.slow
def test_clouds_alone_are_enough_for_kiss() -> None:
    mission = lap(12.0).without("imu", "gnss", "heading")
    solution = gn.estimate(mission, "kiss")
    assert not solution.georeferenced
    assert errors_m(solution, mission).max() < 0.15
