"""CSV tables with a header."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array
from gtsam_nav.mission import Rejection
from gtsam_nav.readers._rows import is_number, parse_rows
from gtsam_nav.readers._text import TRUNCATED, read_lines

STAMPS = ("t", "t_from")
"""Columns of times."""


@dataclass(frozen=True)
class Table:
    """The columns of a CSV file that somebody asked for.

    ``unknown`` names the others; ``cut_stamp`` is the time of a last line that is damaged, NaN if
    that is not its first field, ``cut_line`` its number, and ``archive_cut`` says that the
    compressed file ends there.
    """

    path: Path
    columns: Mapping[str, Array]
    unknown: tuple[str, ...] = ()
    cut_stamp: float | None = None
    cut_line: int | None = None
    archive_cut: bool = False

    def has(self, names: Sequence[str]) -> bool:
        """Whether all of these columns are there."""
        return all(name in self.columns for name in names)

    def cut(self, sensor_name: str) -> list[Rejection]:
        """The rejection of a last line that was cut off."""
        return truncation(sensor_name, len(next(iter(self.columns.values()))), self.cut_stamp)


def truncation(sensor_name: str, n_samples: int, cut_stamp: float | None) -> list[Rejection]:
    """The rejection of a last line that was cut off, if it was."""
    if cut_stamp is None:
        return []
    return [Rejection(t=cut_stamp, sensor=sensor_name, index=n_samples, reason=TRUNCATED)]


def read_table(
    path: Path,
    required: Sequence[str],
    optional: Sequence[str] = (),
    *,
    words: Mapping[str, Mapping[str, float]] | None = None,
    instead: tuple[Sequence[str], Sequence[str]] | None = None,
    renamed: Mapping[str, str] | None = None,
    scale: Mapping[str, float] | None = None,
) -> Table:
    """Read a CSV file whose header names its columns in any order.

    Parameters
    ----------
    path : Path
        Plain or gzipped.
    required, optional : sequence of str
        Columns to read.
    words : mapping, optional
        Words that a column may hold, with the numbers that they stand for.
    instead : (sequence of str, sequence of str), optional
        Required columns, and others that may stand for them.
    renamed : mapping of str to str, optional
        What the header calls a column.
    scale : mapping of str to float, optional
        What the numbers of a column are multiplied by.

    Raises
    ------
    DataError
        Where the file is missing or empty, a column is missing, or a line is malformed.
    """
    lines = read_lines(path, whole=False)
    header = header_names(lines[0], path)
    places = _places(header, renamed or {}, path)
    names = list(places)
    needed = list(required)
    or_else = ""
    if instead is not None:
        usual, other = instead
        or_else = f" ({', '.join(other)} may stand for {', '.join(usual)})"
        is_other = {*other} <= {*names} and not {*usual} <= {*names}
        if is_other or sum(c in names for c in other) > sum(c in names for c in usual):
            needed = [name for name in needed if name not in usual] + list(other)
    missing = [name for name in needed if name not in names]
    if missing:
        raise DataError(
            f"column '{missing[0]}' is missing; needed are {', '.join(needed)}{or_else}; "
            f"the header names {', '.join(names)[:200]}{_hint(names, missing[0])}",
            path,
            1,
        )
    wanted = {*needed, *optional}
    labels = [_label(k, places, wanted) for k in range(len(header))]
    unknown = tuple(label for label in labels if label not in wanted)
    rows = parse_rows(
        lines[1:],
        path,
        labels,
        delimiter=",",
        first_line=2,
        words=words,
        unread=frozenset(unknown),
    )
    factors = scale or {}
    columns = {
        name: rows.values[:, k] * factors[name] if name in factors else rows.values[:, k]
        for name, k in places.items()
        if name in wanted
    }
    cut_stamp = rows.cut_stamp
    if cut_stamp is not None:
        unit = next((factors.get(name, 1.0) for name in STAMPS if places.get(name) == 0), np.nan)
        cut_stamp *= unit
    # a comma at the end of each line makes a column without a name
    unknown = tuple(filter(None, unknown))
    return Table(path, columns, unknown, cut_stamp, rows.cut_line, rows.archive_cut)


def _hint(names: Sequence[str], missing: str) -> str:
    """What is probably wrong with a header that lacks a column."""
    if names[0].startswith(("#", "%")):
        return ": the first line must be the header, and no comment"
    if all(is_number(name) for name in names):
        return ": these are numbers, a header is missing"
    if any(mark in name for name in names for mark in ";\t") or missing in names[0].split():
        return ": the fields must be separated by commas"
    if f'"{missing}"' in names:
        return ": without quotation marks"
    if missing in [name.lower() for name in names]:
        return ": capitals are other letters"
    return ""


def _places(header: Sequence[str], renamed: Mapping[str, str], path: Path) -> dict[str, int]:
    """Which column of the file each name is here, several maybe one; of a name that is another's,
    nobody's."""
    missing = [theirs for theirs in renamed.values() if theirs not in header]
    if missing:
        raise DataError(
            f"no column '{missing[0]}', as the map of columns says; the header names"
            f" {', '.join(header)[:200]}{_hint(header, missing[0])}",
            path,
            1,
        )
    places: dict[str, int] = {}
    for k, name in enumerate(header):
        unclaimed = f"{name} of the file" if name in renamed else name
        ours = [own for own, theirs in renamed.items() if theirs == name] or [unclaimed]
        places |= dict.fromkeys(ours, k)
    return places


def _label(column: int, places: Mapping[str, int], wanted: Collection[str]) -> str:
    """What a column is called here: by a name that is wanted, where one is."""
    names = [name for name, k in places.items() if k == column]
    return next((name for name in names if name in wanted), names[0])


def header_names(line: str, path: Path) -> list[str]:
    """Column names of a header line, each once."""
    if not line.strip():
        raise DataError("the file is empty; a header with the columns' names is needed", path)
    names = [name.strip() for name in line.split(",")]
    repeated = [name for k, name in enumerate(names) if name in names[:k]]
    if repeated:
        raise DataError(f"column '{repeated[0][:40]}' is named twice", path, 1)
    return names


def read_named_files(path: Path) -> tuple[Array, list[str], float | None]:
    """Stamps and file names of a CSV file with the columns t and file, and a cut line's stamp."""
    lines = read_lines(path)
    names = header_names(lines[0], path)
    if names != ["t", "file"]:
        raise DataError(f"the columns must be t, file; they are {', '.join(names)[:200]}", path, 1)
    stamps: list[float] = []
    files: list[str] = []
    filled = [k for k, line in enumerate(lines) if k > 0 and line.strip()]
    for k in filled:
        stamp, comma, name = lines[k].partition(",")
        if not (comma and name.strip()) and k == filled[-1]:
            return np.array(stamps), files, np.nan
        try:
            stamps.append(float(stamp) if stamp.strip() else np.nan)
        except ValueError as error:
            raise DataError(f"t is '{stamp[:40]}', not a number", path, k + 1) from error
        if not name.strip():
            raise DataError("the file's name is missing", path, k + 1)
        files.append(name.strip())
    return np.array(stamps), files, None
