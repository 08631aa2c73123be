"""Numbers from lines of text: fast, and errors name the line."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array
from gtsam_nav.readers._bytes import CUT_OFF
from gtsam_nav.readers._text import TRUNCATED
from gtsam_nav.series import BoolArray

Field = Callable[[str], float]


@dataclass(frozen=True)
class Rows:
    """Numbers of a text file.

    Attributes
    ----------
    values : ndarray, shape (n, k)
        An empty field is NaN.
    cut_stamp : float or None
        First field of a last line that was cut off or is otherwise damaged, as a loss of power
        leaves it (NaN where even that is missing); None where the file is whole.
    cut_line : int or None
        One-based number of that line in its file.
    archive_cut : bool
        Whether it is where a compressed file is cut off.
    begins_cut : bool
        Whether the first line lacks its beginning; its row is then NaN.
    """

    values: Array
    cut_stamp: float | None = None
    begins_cut: bool = False
    cut_line: int | None = None
    archive_cut: bool = False

    @property
    def first_cut(self) -> dict[str, BoolArray]:
        """The row of a first line that lacks its beginning, under its reason."""
        mask = np.zeros(len(self.values), dtype=bool)
        mask[:1] = self.begins_cut
        return {TRUNCATED: mask}


def is_number(text: str) -> bool:
    """Whether a field is a number."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def parse_rows(
    lines: Sequence[str],
    path: Path,
    names: Sequence[str],
    *,
    delimiter: str | None = None,
    first_line: int = 1,
    words: Mapping[str, Mapping[str, float]] | None = None,
    unread: frozenset[str] = frozenset(),
    may_begin_cut: bool = False,
) -> Rows:
    """Parse lines of numbers.

    Parameters
    ----------
    lines : sequence of str
    path : Path
        For messages.
    names : sequence of str
        What the fields of a line are.
    delimiter : str, optional
        Whitespace where absent.
    first_line : int
        One-based number of the first of the lines in its file.
    words : mapping, optional
        Words that a field may hold, with the numbers that they stand for.
    unread : frozenset of str
        Fields whose contents do not matter; they read as NaN.
    may_begin_cut : bool
        Whether the recording may have begun inside a line.

    Raises
    ------
    DataError
        Where a line is malformed. A last line that is, of several, is reported in the result
        instead.
    """
    if not any(line.strip() for line in lines):
        return Rows(np.empty((0, len(names))))
    fields = [_field_of((words or {}).get(name), name in unread) for name in names]
    special: dict[int | str, Field] = {
        k: field for k, field in enumerate(fields) if field is not _number
    }
    try:
        values: Array = np.loadtxt(
            lines, delimiter=delimiter, comments=None, ndmin=2, converters=special or None
        )
        if values.shape[1] == len(names):
            return Rows(values)
    except (ValueError, KeyError):
        pass  # the slow way finds out where and why
    begins_cut = may_begin_cut and _begins_cut(lines, fields, delimiter)
    if begins_cut:
        first = next(k for k, line in enumerate(lines) if line.strip())
        lines, first_line = lines[first + 1 :], first_line + first + 1
    rows = _parse_one_by_one(lines, path, names, fields, delimiter, first_line)
    if begins_cut:
        head = np.full((1, len(names)), np.nan)
        return replace(rows, values=np.concatenate([head, rows.values]), begins_cut=True)
    return rows


def number_columns(
    lines: Sequence[str], n_rows: int, names: Sequence[str], path: Path
) -> dict[str, Array]:
    """The first rows of a table of numbers by column, each of shape (n_rows,).

    Raises
    ------
    DataError
        Where there are fewer rows, or others.
    """
    rows = [line for line in lines[: 2 * n_rows + 10] if line.strip()][:n_rows]
    if not rows and n_rows == 0:
        return dict.fromkeys(names, np.empty(0))
    try:
        values: Array = np.loadtxt(rows, comments=None, ndmin=2)
    except ValueError as error:
        raise DataError(f"holds a point that is not of numbers: {error}", path) from error
    if values.shape != (n_rows, len(names)):
        raise DataError(
            f"holds {len(rows)} points of {n_rows}, or others than {', '.join(names)[:200]}", path
        )
    return dict(zip(names, values.T, strict=True))


def _begins_cut(lines: Sequence[str], fields: Sequence[Field], delimiter: str | None) -> bool:
    """Whether the first of several lines lacks its beginning."""
    filled = [line for line in lines if line.strip()]
    texts = filled[0].split(delimiter)
    if len(filled) < 2 or len(texts) > len(fields):
        return False
    if len(texts) < len(fields):
        return True
    try:
        fields[0](texts[0])
    except (ValueError, KeyError):
        return True
    return False


def _parse_one_by_one(
    lines: Sequence[str],
    path: Path,
    names: Sequence[str],
    fields: Sequence[Field],
    delimiter: str | None,
    first_line: int,
) -> Rows:
    filled = [k for k, line in enumerate(lines) if line.strip()]
    rows: list[list[float]] = []
    for k in filled:
        texts = lines[k].split(delimiter)
        try:
            rows.append(_row(texts, names, fields))
        except ValueError as error:
            # the only line may be cut short, but one that is otherwise odd tells of another format
            if k == filled[-1] and (rows or len(texts) < len(names)):
                return _cut(rows, texts, len(names), first_line + k)
            raise DataError(str(error), path, first_line + k) from error
    return Rows(np.array(rows).reshape(-1, len(names)))


def _row(texts: Sequence[str], names: Sequence[str], fields: Sequence[Field]) -> list[float]:
    """The numbers of one line; a ValueError says what is wrong with it."""
    if len(texts) != len(names):
        raise ValueError(f"{len(texts)} fields where {len(names)} are needed: {', '.join(names)}")
    row: list[float] = []
    for name, field, text in zip(names, fields, texts, strict=True):
        try:
            row.append(field(text))
        except (ValueError, KeyError) as error:
            date = ": stamps are seconds, not dates" * (name == "t" and ":" in text)
            what = f"{name} is '{text.strip()[:40]}', not a number{date}"
            raise ValueError(what) from error
    return row


def _cut(rows: list[list[float]], texts: Sequence[str], n_fields: int, line: int) -> Rows:
    try:
        # the only field of a cut line may be cut itself
        stamp = float(texts[0]) if len(texts) > 1 else np.nan
    except ValueError:
        stamp = np.nan
    return Rows(
        np.array(rows).reshape(-1, n_fields),
        cut_stamp=stamp,
        cut_line=line,
        archive_cut=texts == [CUT_OFF.decode()],
    )


def _field_of(words: Mapping[str, float] | None, unread: bool) -> Field:
    if unread:
        return lambda _: np.nan
    if words is not None:
        return lambda text: words[text.strip()]
    return _number


def _number(text: str) -> float:
    return float(text) if text.strip() else np.nan
