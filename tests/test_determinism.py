"""The same input, configuration and seed give the same bytes."""

from __future__ import annotations

import os
import subprocess
import sys
from itertools import chain
from pathlib import Path

import numpy as np
import pytest

import gtsam_nav as gn
from gtsam_nav.methods import estimate, methods, runnable_methods
from gtsam_nav.writers.mission_folder import write_mission

MISSIONS = {"marina": 60.0, "harbour": 10.0, "ranger": 20.0}
"""Scenarios with their durations, s: among them they hold what each method needs."""


def results(folder: Path) -> dict[str, bytes]:
    """All files of a run but its record."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in files
        if path.name != "run.json"
    }


@pytest.mark.slow
def test_every_method_writes_the_same_bytes_on_any_workers(tmp_path: Path) -> None:
    runs: set[tuple[str, str]] = set()
    for name, duration_s in MISSIONS.items():
        mission = gn.simulate(name, seed=5, duration_s=duration_s)
        write_mission(mission, tmp_path / "missions" / name)
        runs |= {(name, method) for method in runnable_methods(mission)}
    assert {method for _, method in runs} == set(methods())

    written = []
    for workers, hash_seed in (("1", "1"), ("2", "4242")):
        out = tmp_path / workers
        # not every mission has what every method needs: those runs fail
        subprocess.run(
            [
                *(sys.executable, "-c", "from gtsam_nav.cli import main; main()"),
                *("batch", str(tmp_path / "missions" / "*"), "--quiet"),
                *("--out", str(out), "--workers", workers),
                *chain.from_iterable(("--method", method) for method in methods()),
            ],
            check=False,
            capture_output=True,
            env={**os.environ, "PYTHONHASHSEED": hash_seed},
        )
        folders = {Path(name, method) for name, method in runs}
        written.append(
            {folder / k: v for folder in folders for k, v in results(out / folder).items()}
        )
    first, second = written
    assert first.keys() == second.keys()
    for mission, method in runs:
        assert Path(mission, method, "trajectory.tum") in first
        assert Path(mission, method, "metrics.json") in first
    assert Path("marina/graph/loops.csv") in first
    assert [str(name) for name in first if first[name] != second[name]] == []


@pytest.mark.slow
@pytest.mark.parametrize("name", MISSIONS)
def test_no_method_draws_from_numpys_global_generator(name: str) -> None:
    mission = gn.simulate(name, seed=5, duration_s=10.0)
    for method in runnable_methods(mission):
        np.random.seed(0)  # noqa: NPY002  what libraries draw from that were given no generator
        estimate(mission, method)
        state = np.random.get_state(legacy=False)["state"]  # noqa: NPY002
        np.random.seed(0)  # noqa: NPY002
        untouched = np.random.get_state(legacy=False)["state"]  # noqa: NPY002
        assert state["pos"] == untouched["pos"], method
        np.testing.assert_array_equal(state["key"], untouched["key"], method)
