"""One run of a batch, as a worker carries it out: whatever happens ends as a row."""

from __future__ import annotations

import json
import logging
import os
import platform
import resource
import time
import traceback
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from gtsam_nav.batch.plan import PlannedRun
from gtsam_nav.batch.table import TABLE, RunRow, read_cause, row_path, write_row
from gtsam_nav.errors import GtsamNavError, OutputError

logger = logging.getLogger(__name__)

ATTEMPTS = ".attempts"
MOST_ATTEMPTS = 2
"""A mission whose worker dies is tried once more."""

WORKER_DIED = "worker died"
LOW_COVERAGE = "low coverage"


def carry_out(run: PlannedRun, out: Path) -> str | None:
    """Carry out a run and add its row to the table; a bad mission is a row too and never raises.

    A scheduler repeats a run whose worker died, also where it died after the run was done: that
    one is taken from the table. Which of the others have been tried often enough is known from
    files in ``out``, so that it does not depend on how the scheduler was set up.

    Returns
    -------
    str or None
        The row's ``cause``: what kind of failure it was, None for a good run.
    """
    stopwatch = Stopwatch.start()
    if row_path(out / TABLE, run.key).is_file():
        return read_cause(out / TABLE, run.key)
    attempt = _begin_attempt(run, out)
    if attempt > MOST_ATTEMPTS:
        row = died_row(run, MOST_ATTEMPTS, stopwatch)
    else:
        row = replace(_attempt(run, stopwatch), attempts=attempt)
    write_row(out / TABLE, row)
    return row.cause


@dataclass(frozen=True)
class Stopwatch:
    """Wall and processor time since it was started, s."""

    wall: float
    cpu: float

    @classmethod
    def start(cls) -> Stopwatch:
        return cls(time.perf_counter(), time.process_time())

    def row(self, run: PlannedRun, **rest: Any) -> RunRow:
        """The row of a run that has just ended."""
        return RunRow(
            key=run.key,
            mission=run.mission,
            path=str(run.path),
            method=run.method,
            sweep=run.sweep,
            parameters=json.dumps(run.parameters),
            config_sha256=run.config_sha256,
            folder=str(run.folder / run.method),
            worker=f"{platform.node()} {os.getpid()}",
            finished_utc=time.time(),
            wall_s=time.perf_counter() - self.wall,
            cpu_s=time.process_time() - self.cpu,
            # kibibytes on Linux
            worker_peak_mb=resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1.024e-3,
            **{"attempts": 1, **rest},
        )


def died_row(run: PlannedRun, attempts: int, stopwatch: Stopwatch) -> RunRow:
    """The row of a run under which workers died."""
    what = f"its worker died {attempts} times: killed, out of memory, or a crash in native code"
    return stopwatch.row(run, exit_code=1, cause=WORKER_DIED, error=what, attempts=attempts)


def _attempt(run: PlannedRun, stopwatch: Stopwatch) -> RunRow:
    try:
        return _estimate(run, stopwatch)
    except GtsamNavError as error:
        logger.debug("%s failed", run, exc_info=error)
        return stopwatch.row(
            run, exit_code=error.exit_code, cause=type(error).__name__, error=str(error)
        )
    except Exception as error:  # noqa: BLE001  one bad mission never stops the rest
        return stopwatch.row(
            run,
            exit_code=GtsamNavError.exit_code,
            cause=type(error).__name__,
            error=" ".join(str(error).split()),
            traceback=traceback.format_exc(),
        )


def _estimate(run: PlannedRun, stopwatch: Stopwatch) -> RunRow:
    from threadpoolctl import threadpool_limits

    from gtsam_nav.evaluation.comparison import comparison_row
    from gtsam_nav.evaluation.metrics import evaluate
    from gtsam_nav.methods import estimate
    from gtsam_nav.readers import open_mission
    from gtsam_nav.writers.run_folder import write_run
    from gtsam_nav.writers.run_record import RECORD, read_record

    # a worker is one core: threads of its own would take those of its neighbours
    with threadpool_limits(limits=1):
        begin = time.perf_counter()
        solution = estimate(open_mission(run.path, card=run.card), run.method, run.config)
        wall_s = time.perf_counter() - begin
        metrics = evaluate(solution, window_s=run.config.evaluation.window_s)
        folder = write_run(solution, run.config, run.folder, metrics=metrics, wall_s=wall_s)
    record = read_record(folder / RECORD)
    return stopwatch.row(
        run,
        exit_code=0,
        cause=LOW_COVERAGE if metrics.failed else None,
        sources=json.dumps(dict(record.sources)),
        versions=json.dumps(dict(record.versions)),
        mission_s=record.mission_s,
        figures=comparison_row(run.mission, metrics),
    )


def _begin_attempt(run: PlannedRun, out: Path) -> int:
    """Note in ``out`` that a run begins here; returns how often it has begun by now."""
    path = attempts_path(out, run.key)
    try:
        path.parent.mkdir(exist_ok=True)
        with path.open("a", encoding="utf-8") as stream:
            stream.write(f"{platform.node()} {os.getpid()}\n")
    except OSError as error:
        raise OutputError(f"{path}: cannot note that a run begins: {error}") from error
    return count_attempts(out, run.key)


def count_attempts(out: Path, key: str) -> int:
    """How often a run has been begun."""
    path = attempts_path(out, key)
    return len(path.read_text(encoding="utf-8").splitlines()) if path.exists() else 0


def attempts_path(out: Path, key: str) -> Path:
    """The file that has a line, host and process, for each time that a run was begun."""
    return out / ATTEMPTS / key
