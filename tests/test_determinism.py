"""The same input, configuration and seed give the same bytes."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import gtsam_nav as gn
from gtsam_nav.writers.mission_folder import write_mission


def results(folder: Path) -> dict[str, bytes]:
    """All files of a run but its record."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in files
        if path.name != "run.json"
    }


@pytest.mark.slow
def test_two_runs_write_the_same_bytes(tmp_path: Path) -> None:
    write_mission(gn.simulate("marina", seed=5, duration_s=120.0), tmp_path / "mission")
    runs = []
    for hash_seed in ("1", "4242"):
        out = tmp_path / hash_seed
        subprocess.run(
            [
                *(sys.executable, "-c", "from gtsam_nav.cli import main; main()"),
                *("run", str(tmp_path / "mission"), "--quiet", "--out", str(out)),
                *("--method", "dr", "--method", "graph"),
                *("--set", "gnss.use=window", "--set", "gnss.window_s=[0,60]"),
            ],
            check=True,
            capture_output=True,
            env={**os.environ, "PYTHONHASHSEED": hash_seed},
        )
        runs.append({f"{m}/{k}": v for m in ("dr", "graph") for k, v in results(out / m).items()})
    first, second = runs
    assert first.keys() == second.keys()
    assert {"graph/trajectory.tum", "graph/loops.csv", "graph/metrics.json"} <= first.keys()
    assert [name for name in first if first[name] != second[name]] == []


@pytest.mark.slow
def test_any_number_of_workers_writes_the_same_bytes(tmp_path: Path) -> None:
    for seed in (1, 2):
        mission = gn.simulate("ranger", seed=seed, duration_s=20.0)
        write_mission(mission, tmp_path / "missions" / f"m{seed}")
    runs = []
    for workers in (1, 2):
        out = tmp_path / str(workers)
        methods = ("landmark-ekf", "ins-ekf")
        table = gn.batch(str(tmp_path / "missions" / "*"), out, methods, workers=workers)
        assert table["cause"].isna().all(), table["error"].tolist()
        runs.append({k: v for k, v in results(out).items() if not k.startswith(("results", "rep"))})
    first, second = runs
    assert {"m1/landmark-ekf/trajectory.tum", "m2/ins-ekf/metrics.json"} <= first.keys()
    assert first == second
