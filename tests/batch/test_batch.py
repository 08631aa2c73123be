"""Whole batches on worker processes: bad missions, killed workers, a scheduler of others."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path

import pandas as pd
import pytest
from batch_rows import row

import gtsam_nav as gn
from gtsam_nav.batch import BatchProgress
from gtsam_nav.batch.plan import plan_runs
from gtsam_nav.batch.table import TABLE, write_row
from gtsam_nav.batch.work import MOST_ATTEMPTS, attempts_path
from gtsam_nav.config import Config
from gtsam_nav.errors import ConfigError, DataError, OutputError
from gtsam_nav.simulation import simulate
from gtsam_nav.writers.mission_folder import write_mission

ROOT = Path(__file__).parents[2]
PATIENCE_S = 120.0


def causes(results: pd.DataFrame) -> dict[str, str | None]:
    return {row.mission: None if pd.isna(row.cause) else row.cause for row in results.itertuples()}


def wait_for(what: Callable[[], bool]) -> None:
    end = time.monotonic() + PATIENCE_S
    while not what():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.01)


@pytest.fixture(scope="session")
def long(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A mission that takes a worker some seconds: time enough to kill it meanwhile."""
    folder = tmp_path_factory.mktemp("missions") / "long"
    write_mission(simulate("marina", seed=2, duration_s=400.0), folder)
    return folder


@contextmanager
def killer(mission: Path, out: Path, times: int) -> Iterator[None]:
    """Kills the worker of a mission whenever it has begun it, so many times."""
    (run,) = plan_runs([mission], out, ["graph"], Config(), {})
    path = attempts_path(out, run.key)

    def begun() -> list[str]:
        return path.read_text().splitlines() if path.exists() else []

    def kill() -> None:
        for k in range(times):
            wait_for(lambda k=k: len(begun()) > k)  # type: ignore[misc]
            os.kill(int(begun()[k].split()[1]), signal.SIGKILL)

    thread = threading.Thread(target=kill)
    thread.start()
    yield
    thread.join()


@contextmanager
def dask_scheduler(folder: Path) -> Iterator[str]:
    """Address of a scheduler on loopback with two workers, all of them processes of their own."""
    contact = folder / "scheduler.json"
    python = [sys.executable, "-m"]
    shared = ["--scheduler-file", str(contact), "--no-dashboard"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    commands = (
        [*python, "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0", *shared],
        [*python, "distributed.cli.dask_worker", "--nworkers", "2", "--nthreads", "1", *shared],
    )
    started = []
    try:
        for command in commands:
            with (folder / "log").open("ab") as log:
                started.append(
                    subprocess.Popen(
                        command, stdout=log, stderr=log, env=environment, cwd=str(folder)
                    )
                )
            wait_for(contact.exists)
        yield json.loads(contact.read_text())["address"]
    finally:
        for process in reversed(started):
            process.terminate()
        for process in reversed(started):
            process.wait(PATIENCE_S)


# ------------------------------------------------------------------------------- worker processes


@pytest.mark.slow
def test_a_batch_with_a_bad_mission_ends_and_resumes(missions: Path, tmp_path: Path) -> None:
    out, told = tmp_path / "out", list[BatchProgress]()
    first = gn.batch(missions / "*", out, ["dr"], workers=2, progress=told.append)
    assert causes(first) == {"m0": None, "m1": None, "bad": "DataError"}
    assert [p.done for p in told] == [1, 2, 3]
    assert (told[-1].failed, told[-1].remaining_s) == (1, 0.0)
    assert (out / "report.html").is_file()
    assert not (out / ".attempts").exists()

    sweep = {"seed": [5]}
    told.clear()
    second = gn.batch(missions / "m?", out, ["dr"], sweep=sweep, resume=True, progress=told.append)
    assert len(second) == 5
    assert (told[-1].total, told[-1].skipped) == (2, 0)

    told.clear()
    third = gn.batch(missions / "*", out, ["dr"], resume=True, workers=1, progress=told.append)
    assert (told[-1].total, told[-1].skipped) == (1, 2)
    kept = ["key", "finished_utc"]
    good = third["cause"].isna()
    assert third[good][kept].equals(second[second["cause"].isna()][kept])


@pytest.mark.slow
def test_a_killed_worker_costs_no_mission(missions: Path, long: Path, tmp_path: Path) -> None:
    """Its own mission is done at the second attempt."""
    out = tmp_path / "out"

    with killer(long, out, times=1):
        results = gn.batch([long, missions / "m?"], out, ["graph"], workers=2)
    assert causes(results) == {"long": None, "m0": None, "m1": None}
    assert list(results.set_index("mission")["attempts"][["long", "m0", "m1"]]) == [2, 1, 1]


@pytest.mark.slow
def test_a_mission_that_kills_its_workers_is_a_row(
    missions: Path, long: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    with killer(long, out, MOST_ATTEMPTS):
        results = gn.batch([long, missions / "*"], out, ["graph"], workers=2)
    assert causes(results) == {
        "long": "worker died",
        "m0": None,
        "m1": None,
        "bad": "DataError",
    }
    row = results.set_index("mission").loc["long"]
    assert (row["attempts"], row["exit_code"]) == (MOST_ATTEMPTS, 1)


@pytest.mark.slow
def test_workers_of_a_scheduler_that_runs_already(
    missions: Path, long: Path, tmp_path: Path
) -> None:
    """They are processes that this one did not start; one of them is killed as it works."""
    out = tmp_path / "out"
    with (
        dask_scheduler(tmp_path) as address,
        killer(long, out, MOST_ATTEMPTS),
    ):
        results = gn.batch([long, missions / "*"], out, ["graph"], scheduler=address)
        assert causes(results) == {
            "long": "worker died",
            "m0": None,
            "m1": None,
            "bad": "DataError",
        }
        assert str(os.getpid()) not in {worker.split()[1] for worker in results["worker"]}
        # it is still there for others
        again = gn.batch(missions / "m0", tmp_path / "again", ["graph"], scheduler=address)
        assert causes(again) == {"m0": None}


@pytest.mark.slow
def test_a_killed_batch_leaves_its_rows_and_can_be_resumed(
    missions: Path, long: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    command = [
        *(sys.executable, "-c", "from gtsam_nav.cli import main; main()"),
        *("batch", str(missions / "m?"), str(long), "--out", str(out), "-m", "graph"),
    ]
    table = out / "results.parquet"
    with subprocess.Popen(
        [*command, "--workers", "2"],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        start_new_session=True,
        stderr=subprocess.DEVNULL,
    ) as process:
        wait_for(lambda: len(list(table.glob("[!.]*"))) == 2)
        os.killpg(process.pid, signal.SIGKILL)
    assert set(pd.read_parquet(table)["mission"]) == {"m0", "m1"}
    told = list[BatchProgress]()
    resumed = gn.batch(missions / "*", out, ["graph"], resume=True, workers=1, progress=told.append)
    assert (told[-1].total, told[-1].skipped) == (1, 2)
    assert causes(resumed) == {"m0": None, "m1": None, "bad": "DataError"}


@pytest.mark.slow
def test_ctrl_c_ends_a_batch_without_a_word_of_its_workers(
    missions: Path, long: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    table = out / "results.parquet"
    command = [
        *(sys.executable, "-c", "from gtsam_nav.cli import main; main()"),
        *("batch", str(missions / "m0"), str(long), "--out", str(out), "-m", "graph", "--quiet"),
    ]
    with subprocess.Popen(
        [*command, "--workers", "2"],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        start_new_session=True,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        wait_for(lambda: len(list(table.glob("[!.]*"))) == 1)
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does
        _, said = process.communicate(timeout=PATIENCE_S)
    assert (process.returncode, said.strip()) in [(130, ""), (130, "Aborted.")]
    told = list[BatchProgress]()
    resumed = gn.batch(missions / "m?", out, ["graph"], resume=True, progress=told.append)
    assert causes(resumed).items() >= {"m0": None, "m1": None}.items()
    assert (told[-1].total, told[-1].skipped) == (1, 1)


# ------------------------------------------------------------------- what is wrong from the start


def test_what_cannot_work_is_said_before_anything_runs(missions: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    with pytest.raises(ConfigError, match="unknown method 'drr'"):
        gn.batch(missions / "*", out, ["drr"])
    with pytest.raises(ConfigError, match="unknown method 'drr'"):
        gn.batch(missions / "*", out, "drr")
    with pytest.raises(ConfigError, match="no method is given"):
        gn.batch(missions / "*", out, [])
    with pytest.raises(ConfigError, match="no value is given to sweep 'seed'"):
        gn.batch(missions / "*", out, "dr", sweep={"seed": []})
    with pytest.raises(DataError, match="no file or folder matches"):
        gn.batch(missions / "n*", out)
    with pytest.raises(ConfigError, match="workers is 0"):
        gn.batch(missions / "m0", out, workers=0)


def test_a_batch_does_not_overwrite_another(missions: Path, tmp_path: Path) -> None:
    (tmp_path / TABLE).mkdir()
    write_row(tmp_path / TABLE, row("m0"))
    with pytest.raises(OutputError, match="holds a batch already; --resume goes on with it"):
        gn.batch(missions / "m0", tmp_path, ["dr"])


def test_a_scheduler_that_does_not_answer(
    missions: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(import_module("gtsam_nav.batch.workers"), "WAIT_FOR_WORKER_S", 0.5)
    with pytest.raises(ConfigError, match="no scheduler answers at 'tcp:"):
        gn.batch(missions / "m0", tmp_path / "a", ["dr"], scheduler="tcp://127.0.0.1:9")
    with pytest.raises(ConfigError, match="give --workers or --scheduler"):
        gn.batch(missions / "m0", tmp_path / "b", scheduler="tcp://127.0.0.1:9", workers=2)


def test_progress_tells_rate_and_remaining_time() -> None:
    state = BatchProgress(done=12, total=64, failed=1, skipped=3, elapsed_s=240.0)
    assert (state.runs_per_min, state.remaining_s) == (3.0, 1040.0)
    assert str(state) == "12/64 runs, 3.0/min, 0:17:20 left, 1 failed, 3 done before"
    assert BatchProgress(0, 64, 0, 0, 0.0).remaining_s is None
