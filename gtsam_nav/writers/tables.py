"""Tables of numbers as CSV: one header, one format a column, fast both ways."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array

EXACT = "%r"
"""The shortest text that reads back as the same float64."""


def format_rows(columns: Sequence[Array], formats: Sequence[str], separator: str = ",") -> str:
    """Lines of text, one a row, each column in its %-format."""
    row = separator.join(formats) + "\n"
    values = np.column_stack(columns).ravel().tolist()
    return (row * len(columns[0])) % tuple(values)


def write_table(path: Path, columns: Mapping[str, tuple[Array, str]]) -> None:
    """Write numbers as CSV; columns map a name to values of shape (n,) and a %-format."""
    values, formats = zip(*columns.values(), strict=True)
    text = ",".join(columns) + "\n" + format_rows(values, formats)
    path.write_text(text, encoding="utf-8", newline="\n")


def write_records(path: Path, header: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Write mixed values as CSV; floats exactly, None and NaN as empty fields."""
    with path.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(["" if v is None or v != v else v for v in row] for row in rows)


def read_table(path: Path) -> dict[str, Array]:
    """Read numbers from CSV as arrays of shape (n,) by column name.

    Raises
    ------
    DataError
        Where the file is missing, or is not a table of numbers.
    """
    try:
        with path.open(encoding="utf-8") as stream:
            header = [name.strip() for name in stream.readline().split(",")]
            lines = [line for line in stream if line.strip()]
        values = np.loadtxt(lines, delimiter=",", ndmin=2) if lines else np.empty((0, len(header)))
    except FileNotFoundError as error:
        raise DataError("no such file", path) from error
    except (OSError, ValueError) as error:
        raise DataError(f"not a table of numbers: {error}", path) from error
    if values.shape[1] != len(header):
        raise DataError(f"{len(header)} column names over {values.shape[1]} columns", path)
    return {name: values[:, k] for k, name in enumerate(header)}
