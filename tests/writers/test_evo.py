"""evo_ape, as its users call it, on what a run exports: it must find our own figures."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import solutions

from gtsam_nav.config import Config
from gtsam_nav.evaluation.metrics import Metrics, evaluate
from gtsam_nav.mission import Sensor
from gtsam_nav.series import ReferenceSeries
from gtsam_nav.writers.exports import export_run
from gtsam_nav.writers.frame import Frame
from gtsam_nav.writers.run_folder import write_run
from gtsam_nav.writers.trajectories import write_kitti, write_tum

pytestmark = pytest.mark.slow

STEP = 10
"""Samples of the trajectory for one of the reference."""


@pytest.fixture(scope="module")
def scored(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Metrics]:
    """A run scored on the truth at every tenth of its samples, and what we say of it."""
    solution = solutions.graph_solution()
    truth = solutions.true_trajectory(solution.trajectory.t[::STEP])
    series = ReferenceSeries(t=truth.t, p_n=truth.p_n, rpy=truth.rpy)
    solution = replace(solution, reference=Sensor("reference", "reference", series))
    return write_run(solution, Config(), tmp_path_factory.mktemp("out")), evaluate(solution)


def evo_ape(home: Path, *arguments: str | Path) -> dict[str, float]:
    """The statistics that evo_ape prints, by name."""
    command = [Path(sys.executable).with_name("evo_ape"), *arguments]
    # evo keeps its settings in the home folder
    environment = {**os.environ, "HOME": str(home), "MPLBACKEND": "agg"}
    run = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stdout + run.stderr
    return {name: float(value) for name, value in re.findall(r"(\w+)\t(\d\S*)", run.stdout)}


@pytest.mark.parametrize("frame", ["ned", "enu"])
def test_evo_ape_finds_our_figures_in_tum(
    scored: tuple[Path, Metrics], tmp_path: Path, frame: Frame
) -> None:
    run, metrics = scored
    (estimate,) = export_run(run, ["tum"], frame)
    truth = solutions.true_trajectory(np.loadtxt(estimate)[::STEP, 0])
    write_tum(truth, tmp_path / "truth.tum", frame)
    assert metrics.ate_3d is not None
    for options, ours in (((), metrics.ate_3d.none), (("--align",), metrics.ate_3d.se3)):
        found = evo_ape(tmp_path, "tum", tmp_path / "truth.tum", estimate, *options)
        assert ours is not None
        for name in ("rmse", "mean", "median", "max"):
            assert found[name] == pytest.approx(getattr(ours, name), abs=2e-6), name


def test_evo_ape_finds_our_figures_in_kitti(scored: tuple[Path, Metrics], tmp_path: Path) -> None:
    run, metrics = scored
    exported, _ = export_run(run, ["kitti"])
    # KITTI has no times: the poses of both files must be of the same ones
    estimate = tmp_path / "estimate.kitti"
    estimate.write_text("".join(exported.read_text().splitlines(keepends=True)[::STEP]))
    t = np.loadtxt(run / "trajectory.tum")[::STEP, 0]
    write_kitti(solutions.true_trajectory(t), tmp_path / "truth.kitti")
    found = evo_ape(tmp_path, "kitti", tmp_path / "truth.kitti", estimate)
    assert metrics.ate_3d is not None
    assert metrics.ate_3d.none is not None
    assert found["rmse"] == pytest.approx(metrics.ate_3d.none.rmse, abs=2e-6)
