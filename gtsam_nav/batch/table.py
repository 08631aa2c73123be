"""The table of a batch: a Parquet data set that grows by whole rows and is readable at any time.

A run's row is a file of its own until the batch ends; then all are put into one file. Each file
appears under its name at once (written beside it, then renamed), so that a batch that is killed
leaves every finished row, and no half one. ``pandas.read_parquet(DIR / "results.parquet")`` reads
it whether the batch has ended or not.
"""

from __future__ import annotations

import os
import time
from collections.abc import Collection
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args, get_type_hints

from gtsam_nav.errors import DataError, OutputError
from gtsam_nav.evaluation.comparison import ComparisonRow
from gtsam_nav.writers.atomic import replacing_file

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa

TABLE = "results.parquet"


@dataclass(frozen=True, kw_only=True)
class RunRow:
    """What became of one run; None where it cannot be told.

    Attributes
    ----------
    key : str
        Checksum of mission path, method and configuration: one row each.
    mission, path, method : str
    sweep : str
        The swept settings as text.
    parameters : str
        The same as a JSON object.
    config_sha256 : str
        Of the resolved configuration.
    sources : str or None
        JSON object: SHA-256 of each file that was read.
    versions : str or None
        JSON object: version of each package.
    folder : str
        The run's folder, where it finished.
    exit_code : int
        What ``gtsam-nav run`` ends with: 0 done, 3 bad data, 4 the estimator failed, 1 a bug.
    cause : str or None
        Kind of failure; None for a good run. A run that finished but covers too little of its
        reference has ``low coverage``.
    error, traceback : str or None
        The message; and where it came from, of an error that nobody foresaw.
    attempts : int
        More than one where a worker died.
    worker : str
        Host and process.
    finished_utc : float
        POSIX seconds.
    wall_s, cpu_s : float
        From opening the mission to the last result written.
    mission_s : float or None
        Span of the mission's sensors.
    worker_peak_mb : float
        Most memory that the worker has held since it started, MB (1e6 bytes).
    figures : ComparisonRow or None
        The scores; columns of their own in the table.
    """

    key: str
    mission: str
    path: str
    method: str
    sweep: str
    parameters: str
    config_sha256: str
    sources: str | None = None
    versions: str | None = None
    folder: str
    exit_code: int
    cause: str | None = None
    error: str | None = None
    traceback: str | None = None
    attempts: int
    worker: str
    finished_utc: float
    wall_s: float
    cpu_s: float
    mission_s: float | None = None
    worker_peak_mb: float
    figures: ComparisonRow | None = None

    def to_record(self) -> dict[str, Any]:
        """The row as flat columns."""
        record = asdict(self)
        figures = record.pop("figures") or {}
        return record | {name: figures.get(name) for name in FIGURES}


# wall_s is the run's own; failed is among the causes
FIGURES = tuple(f.name for f in fields(ComparisonRow) if f.name not in {"name", "wall_s", "failed"})
"""Columns that hold scores."""


def schema() -> pa.Schema:
    """The table's columns and their types."""
    import pyarrow as pa

    types = {int: pa.int64(), float: pa.float64(), str: pa.string()}

    def column(hint: Any) -> pa.DataType:
        return next((types[part] for part in (hint, *get_args(hint)) if part in types), pa.string())

    hints = get_type_hints(RunRow)
    del hints["figures"]
    figures = get_type_hints(ComparisonRow)
    hints |= {name: figures[name] for name in FIGURES}
    return pa.schema([(name, column(hint)) for name, hint in hints.items()])


def write_row(table: Path, row: RunRow) -> None:
    """Add a run's row, replacing an earlier one that has not been compacted."""
    import pyarrow as pa

    _write(row_path(table, row.key), pa.Table.from_pylist([row.to_record()], schema=schema()))


def row_path(table: Path, key: str) -> Path:
    """The file of a run's row until the table is compacted."""
    return table / f"{key}.parquet"


def read_cause(table: Path, key: str) -> str | None:
    """The ``cause`` in a row that `write_row` wrote."""
    import pyarrow.parquet as pq

    cause: str | None = pq.read_table(row_path(table, key), columns=["cause"])["cause"][0].as_py()
    return cause


def read_results(out: Path) -> pd.DataFrame:
    """The table of a batch's folder, finished or not: the newest row of each run.

    Raises
    ------
    DataError
        Where the folder holds none.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = out / TABLE
    if not table.is_dir():
        raise DataError(f"not a batch's folder: it has no {TABLE}", out)
    columns = schema()
    try:
        rows = pq.read_table(table, schema=columns) if _files(table) else columns.empty_table()
    except (OSError, pa.ArrowException) as error:
        raise DataError(f"cannot read the results: {error}", table) from error
    frame: pd.DataFrame = rows.to_pandas()
    newest = frame.sort_values("finished_utc").drop_duplicates("key", keep="last")
    return newest.sort_values(["mission", "sweep", "method"], ignore_index=True)


def compact(out: Path, dropped: Collection[str] = ()) -> pd.DataFrame:
    """Put all rows into one file, but those whose keys are to be dropped; returns them."""
    import pyarrow as pa

    table = out / TABLE
    files = _files(table)
    frame = read_results(out)
    frame = frame[~frame["key"].isin(list(dropped))].reset_index(drop=True)
    rows = pa.Table.from_pandas(frame, schema=schema(), preserve_index=False)
    _write(table / f"rows-{time.time_ns()}.parquet", rows)
    # should the batch be killed here, the older copies are equal and the reader takes one of each
    for path in files:
        path.unlink()
    return frame


def _files(table: Path) -> list[Path]:
    return sorted(table.glob("[!.]*.parquet"))


def _write(path: Path, rows: pa.Table) -> None:
    import pyarrow.parquet as pq

    # a dot hides it from whoever reads the table meanwhile
    try:
        with replacing_file(path) as draft, draft.open("wb") as stream:
            pq.write_table(rows, stream)
            stream.flush()
            os.fsync(stream.fileno())
    except OSError as error:
        raise OutputError(f"{path}: cannot write the row: {error}") from error
