"""What a mission folder remembers of the samples that its source lost: ``rejections.csv``."""

from __future__ import annotations

import csv
import io
from pathlib import Path

from gtsam_nav.errors import DataError
from gtsam_nav.mission import Rejection
from gtsam_nav.readers._text import read_lines

REJECTIONS_FILE = "rejections.csv"
COLUMNS = ("t", "sensor", "index", "reason")


def read_rejections(folder: Path) -> list[Rejection]:
    """The rejections beside a mission's description; none where the file is not there.

    Raises
    ------
    DataError
        Where it is not what `gtsam_nav.writers.mission_folder` writes.
    """
    path = folder / REJECTIONS_FILE
    if not path.is_file():
        return []
    # the names of sensors may hold line breaks
    rows = csv.reader(io.StringIO("\n".join(read_lines(path)), newline=""))
    found: list[Rejection] = []
    try:
        if (header := tuple(next(rows, []))) != COLUMNS:
            raise DataError(
                f"the columns must be {', '.join(COLUMNS)}; they are {', '.join(header)[:200]}",
                path,
                1,
            )
        for row in filter(None, rows):
            t, sensor, index, reason = row
            found.append(Rejection(float(t or "nan"), sensor, int(index), reason))
    except (ValueError, csv.Error) as error:
        raise DataError(f"not a rejected sample: {error}", path, rows.line_num) from error
    return found
