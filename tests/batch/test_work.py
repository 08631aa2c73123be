"""One run on a worker: whatever happens ends as a row."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from gtsam_nav.batch.plan import PlannedRun, plan_runs
from gtsam_nav.batch.resume import finished_keys
from gtsam_nav.batch.table import TABLE, read_results
from gtsam_nav.batch.work import attempts_path, carry_out
from gtsam_nav.config import Config
from gtsam_nav.errors import EstimationError, OutputError
from gtsam_nav.writers.run_folder import read_run

registry = import_module("gtsam_nav.methods")


@pytest.fixture
def out(tmp_path: Path) -> Path:
    (tmp_path / TABLE).mkdir()
    return tmp_path


def planned(path: Path, out: Path) -> PlannedRun:
    (run,) = plan_runs([path], out, ["dr"], Config(), {})
    return run


def only_row(out: Path) -> dict[str, Any]:
    (row,) = read_results(out).to_dict("records")
    return {str(name): None if pd.isna(value) else value for name, value in row.items()}


def test_a_good_run_leaves_its_folder_and_its_scores(missions: Path, out: Path) -> None:
    run = planned(missions / "m0", out)
    assert carry_out(run, out) is None
    row, left = only_row(out), read_run(out / "m0/dr")
    assert left.metrics.ate.none is not None
    assert row["ate_none_mean_m"] == left.metrics.ate.none.mean
    assert (row["exit_code"], row["attempts"], row["cause"]) == (0, 1, None)
    assert row["mission_s"] == left.record.mission_s
    assert 0.0 < row["cpu_s"] < 10.0 * row["wall_s"]
    assert row["worker_peak_mb"] > 50.0


def test_bad_data_are_a_row(missions: Path, out: Path) -> None:
    assert carry_out(planned(missions / "bad", out), out) == "DataError"
    row = only_row(out)
    assert (row["exit_code"], row["traceback"]) == (3, None)
    assert "dvl.csv" in row["error"]
    assert not (out / "bad/dr").exists()


@pytest.mark.parametrize(
    ("error", "exit_code"), [(EstimationError("diverged"), 4), (TypeError("a bug"), 1)]
)
def test_a_method_that_fails_is_a_row(
    missions: Path, out: Path, monkeypatch: pytest.MonkeyPatch, error: Exception, exit_code: int
) -> None:
    def fail(*_: object) -> None:
        raise error

    monkeypatch.setattr(registry, "estimate", fail)
    assert carry_out(planned(missions / "m0", out), out) == type(error).__name__
    row = only_row(out)
    assert (row["exit_code"], row["error"]) == (exit_code, str(error))
    # where a bug is must be told; where bad data were found is no one's concern
    assert (row["traceback"] is not None) == (exit_code == 1)


def test_a_run_that_is_repeated_though_it_was_done_keeps_its_row(
    missions: Path, out: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = planned(missions / "bad", out)
    carry_out(run, out)
    before = only_row(out)
    monkeypatch.setattr(registry, "estimate", None)
    assert carry_out(run, out) == "DataError"
    assert only_row(out) == before


def test_the_third_attempt_is_not_made(missions: Path, out: Path) -> None:
    """Two workers began it, and neither left a row."""
    run = planned(missions / "m0", out)
    path = attempts_path(out, run.key)
    path.parent.mkdir()
    path.write_text("host 1\nhost 2\n")
    assert carry_out(run, out) == "worker died"
    row = only_row(out)
    assert (row["exit_code"], row["attempts"]) == (1, 2)


# --------------------------------------------------------------------------------- what is done


def test_a_finished_run_is_done_until_its_input_changes(missions: Path, out: Path) -> None:
    run = planned(missions / "m1", out)
    carry_out(run, out)
    assert finished_keys(read_results(out), [run]) == {run.key}
    velocities = missions / "m1/dvl.csv"
    text = velocities.read_text()
    velocities.write_text(text + "\n")
    assert finished_keys(read_results(out), [run]) == set()
    velocities.write_text(text)
    assert finished_keys(read_results(out), [run]) == {run.key}


def test_what_failed_or_lost_its_folder_is_not_done(missions: Path, out: Path) -> None:
    runs = [planned(missions / name, out) for name in ("bad", "m0")]
    for run in runs:
        carry_out(run, out)
    assert finished_keys(read_results(out), runs) == {runs[1].key}
    (out / "m0").rename(out / "elsewhere")
    assert finished_keys(read_results(out), runs) == set()


def test_a_mission_does_not_take_the_folder_of_another(missions: Path, out: Path) -> None:
    carry_out(planned(missions / "m0", out), out)
    other = planned(missions / "elsewhere/m0", out)
    with pytest.raises(OutputError, match=r"m0/dr holds a run of .*/m0; choose another --out"):
        finished_keys(read_results(out), [other])
