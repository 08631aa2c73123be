"""Many missions at once, on Dask: what is planned, who does it, what came of it.

The package imports this module at once, since its name is also that of a function: it imports
nothing else before it is called.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gtsam_nav.errors import OutputError

if TYPE_CHECKING:
    import pandas as pd

    from gtsam_nav.batch.plan import PlannedRun
    from gtsam_nav.config import Config

REPORT = "report.html"


@dataclass(frozen=True)
class BatchProgress:
    """How far a batch has come.

    ``skipped`` runs were done before it began and are not among the ``total``.
    """

    done: int
    total: int
    failed: int
    skipped: int
    elapsed_s: float

    @property
    def runs_per_min(self) -> float:
        """Rate since the workers began."""
        return 60.0 * self.done / self.elapsed_s if self.elapsed_s > 0.0 else 0.0

    @property
    def remaining_s(self) -> float | None:
        """Time to the end at this rate; None before the first run has ended."""
        return (self.total - self.done) * self.elapsed_s / self.done if self.done else None

    def __str__(self) -> str:
        left = (
            ""
            if self.remaining_s is None
            else f", {timedelta(seconds=round(self.remaining_s))} left"
        )
        failed = f", {self.failed} failed" if self.failed else ""
        skipped = f", {self.skipped} done before" if self.skipped else ""
        return f"{self.done}/{self.total} runs, {self.runs_per_min:.1f}/min{left}{failed}{skipped}"


def batch(
    missions: Path | str | Iterable[Path | str],
    out: Path | str,
    methods: str | Sequence[str] = ("graph",),
    *,
    config: Config | None = None,
    card: Path | str | None = None,
    sweep: Mapping[str, Sequence[Any]] | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    resume: bool = False,
    progress: Callable[[BatchProgress], None] | None = None,
) -> pd.DataFrame:
    """Estimate many missions, each under every method and every combination of swept settings.

    A bad mission does not stop the others: its error is a row. Neither does a worker that dies:
    its mission is tried once more. A script that calls this needs the guard
    ``if __name__ == "__main__"``, since the workers import it.

    Parameters
    ----------
    missions : path or iterable of paths
        Missions, or glob patterns that match them.
    out : Path or str
        ``out/<mission>/[<sweep>/]<method>/`` is a run's folder, ``out/results.parquet`` the table
        (see `gtsam_nav.batch.table`), ``out/report.html`` the summary.
    methods : str or sequence of str
        Of `gtsam_nav.methods`; one at least.
    config : Config, optional
        Defaults that hold for every mission where absent.
    card : Path or str, optional
        A file whose section ``mission`` says of every mission what `gtsam_nav.open_mission` needs.
    sweep : mapping of str to sequence, optional
        Values to try by setting, as in ``{"graph.keyframe_interval_s": [0.5, 1.0]}``.
    workers : int, optional
        Local processes; one a core where absent.
    scheduler : str, optional
        Address of a Dask scheduler to use instead; its workers see the same files and have this
        package.
    resume : bool
        Go on with a batch: leave out the runs in its table that finished with the same
        configuration on the same input, by checksum. Runs that failed are done again.
    progress : callable, optional
        Told after each run.

    Returns
    -------
    pandas.DataFrame
        The table: one row a run; see `gtsam_nav.batch.table.RunRow` for its columns.

    Raises
    ------
    ConfigError
        For an unknown method or setting, none at all, or a scheduler that does not answer.
    DataError
        Where a pattern matches nothing.
    OutputError
        Where ``out`` cannot be written, or holds another batch.
    """
    import shutil

    from gtsam_nav.batch.plan import plan_runs
    from gtsam_nav.batch.summary import write_summary
    from gtsam_nav.batch.table import TABLE, compact
    from gtsam_nav.batch.work import ATTEMPTS
    from gtsam_nav.batch.workers import carry_out_all, connect
    from gtsam_nav.config import Config
    from gtsam_nav.methods import check_method
    from gtsam_nav.writers.atomic import missing_folders, remove_drafts, remove_empty

    names = [methods] if isinstance(methods, str) else methods
    for name in names:
        check_method(name)
    folder = Path(out).absolute()
    patterns = [missions] if isinstance(missions, Path | str) else missions
    planned = plan_runs(
        patterns,
        folder,
        names,
        config or Config(),
        sweep or {},
        None if card is None else Path(card),
    )
    made = missing_folders(folder / TABLE)
    done = _begin(folder, planned, resume)
    runs = [run for run in planned if run.key not in done]
    failed = 0
    try:
        if runs:
            with connect(workers, scheduler) as client:
                begin = time.perf_counter()
                for k, (_, cause) in enumerate(carry_out_all(client, runs, folder), start=1):
                    failed += cause is not None
                    if progress is not None:
                        elapsed_s = time.perf_counter() - begin
                        progress(BatchProgress(k, len(runs), failed, len(done), elapsed_s))
    finally:
        # also where it is interrupted: the workers are gone, and rows of what they finished stand
        shutil.rmtree(folder / ATTEMPTS, ignore_errors=True)
        remove_drafts(folder)
        remove_empty(made)
    frame = compact(folder)
    write_summary(frame, folder / REPORT)
    return frame


def _begin(out: Path, planned: Sequence[PlannedRun], resume: bool) -> Collection[str]:
    """Make the batch's folder ready; returns the keys of the runs that need not be done."""
    import shutil

    from gtsam_nav.batch.resume import finished_keys
    from gtsam_nav.batch.table import TABLE, compact, read_results
    from gtsam_nav.batch.work import ATTEMPTS

    try:
        (out / TABLE).mkdir(parents=True, exist_ok=True)
        shutil.rmtree(out / ATTEMPTS, ignore_errors=True)
    except OSError as error:
        raise OutputError(f"{out}: cannot write there: {error.strerror}") from error
    results = read_results(out)
    if len(results) and not resume:
        raise OutputError(f"{out}: holds a batch already; --resume goes on with it")
    done = finished_keys(results, planned)
    if len(results):
        compact(out, dropped={run.key for run in planned} - done)
    return done
