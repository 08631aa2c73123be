"""Dask workers: processes of our own, or those of a scheduler that runs already."""

from __future__ import annotations

import logging
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager
from multiprocessing import resource_tracker
from pathlib import Path
from typing import TYPE_CHECKING

from gtsam_nav.batch.plan import PlannedRun
from gtsam_nav.batch.table import TABLE, write_row
from gtsam_nav.batch.work import MOST_ATTEMPTS, Stopwatch, carry_out, count_attempts, died_row
from gtsam_nav.errors import ConfigError, GtsamNavError

if TYPE_CHECKING:
    from distributed import Client

WAIT_FOR_WORKER_S = 60
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
LOCAL = {
    # GTSAM holds Python's lock while it solves: a worker that is silent for minutes is at work
    "distributed.scheduler.worker-ttl": None,
    # warnings of a mission stand in its run.json
    "distributed.nanny.pre-spawn-environ": {
        **dict.fromkeys(THREADS, "1"),
        "DASK_LOGGING__GTSAM_NAV": "error",
    },
}
"""How Dask is set up where the workers are ours."""


@contextmanager
def connect(workers: int | None = None, scheduler: str | None = None) -> Iterator[Client]:
    """A client of as many local processes as wanted, or of the scheduler at an address.

    Parameters
    ----------
    workers : int, optional
        One a core where absent.
    scheduler : str, optional
        As in ``tcp://127.0.0.1:8786``; its workers see the same files.

    Raises
    ------
    ConfigError
        For less than one worker, for both a number and an address, where nothing answers at the
        address, or where it has no worker.
    """
    if scheduler is not None:
        if workers is not None:
            raise ConfigError("a scheduler has its own workers: give --workers or --scheduler")
        with _client_of(scheduler) as client:
            yield client
        return
    count = len(os.sched_getaffinity(0)) if workers is None else workers
    if count < 1:
        raise ConfigError(f"workers is {count}; at least one is needed")
    with _own_processes(count) as client:
        yield client


@contextmanager
def _own_processes(count: int) -> Iterator[Client]:
    import dask
    from distributed import Client, LocalCluster
    from distributed.system import MEMORY_LIMIT

    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    with (
        dask.config.set(LOCAL),
        _spared_by_ctrl_c() as all_started,
        LocalCluster(
            n_workers=count,
            threads_per_worker=1,
            memory_limit=MEMORY_LIMIT // count,
            host="127.0.0.1",
            dashboard_address="127.0.0.1:0",
            silence_logs=logging.CRITICAL,
        ) as cluster,
    ):
        all_started()
        with Client(cluster) as client:
            yield client


@contextmanager
def _spared_by_ctrl_c() -> Iterator[Callable[[], None]]:
    """Threads begun in here, and processes begun by those, never get SIGINT: a terminal sends it
    to the workers too, but the parent ends them. Ends early where what is yielded is called."""
    # begun in here by the first process, it would let SIGINT through again
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})

    def end() -> None:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)

    try:
        yield end
    finally:
        end()


@contextmanager
def _client_of(address: str) -> Iterator[Client]:
    from distributed import Client

    try:
        client = Client(address, timeout=WAIT_FOR_WORKER_S)
    except (OSError, ValueError, TimeoutError) as error:
        raise ConfigError(f"no scheduler answers at '{address}': {error}") from error
    with client:
        try:
            client.wait_for_workers(1, timeout=WAIT_FOR_WORKER_S)
        except TimeoutError as error:
            raise ConfigError(f"the scheduler at '{address}' has no worker") from error
        yield client


def carry_out_all(
    client: Client, runs: Sequence[PlannedRun], out: Path
) -> Iterator[tuple[PlannedRun, str | None]]:
    """Let the workers carry out the runs; yields each as it ends, with its cause of failure.

    Raises
    ------
    GtsamNavError
        Where the scheduler is lost.
    """
    from distributed import KilledWorker, as_completed

    stopwatch = Stopwatch.start()
    futures = client.map(carry_out, runs, out=out, pure=False)
    run_of = dict(zip(futures, runs, strict=True))
    ended = as_completed(futures)
    for future in ended:
        run = run_of.pop(future)
        try:
            cause: str | None = future.result()
        except KilledWorker:
            attempts = count_attempts(out, run.key)
            if attempts < MOST_ATTEMPTS:
                # it only waited where others' missions killed the worker
                again = client.submit(carry_out, run, out=out, pure=False)
                run_of[again] = run
                ended.add(again)
                continue
            row = died_row(run, attempts, stopwatch)
            write_row(out / TABLE, row)
            cause = row.cause
        except CancelledError as error:
            raise GtsamNavError(
                f"the scheduler is gone; --resume goes on with the {len(run_of) + 1} open runs"
            ) from error
        yield run, cause
