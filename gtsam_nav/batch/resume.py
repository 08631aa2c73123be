"""Which runs of a batch are done already: same configuration, same input, and finished."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from gtsam_nav.batch.plan import PlannedRun
from gtsam_nav.errors import OutputError

if TYPE_CHECKING:
    import pandas as pd


def finished_keys(results: pd.DataFrame, planned: Iterable[PlannedRun]) -> set[str]:
    """Keys of the planned runs that finished and whose input is what it was.

    Raises
    ------
    OutputError
        Where a planned run would take the folder of a run on another mission.
    """

    @cache
    def checksum(path: str) -> str | None:
        try:
            with Path(path).open("rb") as stream:
                return hashlib.file_digest(stream, "sha256").hexdigest()
        except OSError:
            return None

    rows = results.set_index("key")
    path_of = dict(zip(results["folder"], results["path"], strict=True))
    finished = set()
    for run in planned:
        folder = run.folder / run.method
        if path_of.get(str(folder), str(run.path)) != str(run.path):
            raise OutputError(
                f"{folder} holds a run of {path_of[str(folder)]}; choose another --out"
            )
        if run.key not in rows.index or rows.at[run.key, "exit_code"] != 0:
            continue
        sources = json.loads(str(rows.at[run.key, "sources"]))
        if folder.is_dir() and all(checksum(name) == sha for name, sha in sources.items()):
            finished.add(run.key)
    return finished
