"""Figures with their spread over seeds, as text and as JSON."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Spread:
    """Mean, standard deviation and largest of a figure over n runs."""

    mean: float
    sd: float
    largest: float
    n: int

    @classmethod
    def of(cls, values: Sequence[float]) -> Spread:
        """The spread of some values."""
        v = np.asarray(values, dtype=float)
        return cls(
            float(v.mean()), float(v.std(ddof=1)) if len(v) > 1 else 0.0, float(v.max()), len(v)
        )

    def __str__(self) -> str:
        return f"{self.mean:.3g}" if self.n == 1 else f"{self.mean:.3g} ± {self.sd:.2g}"


@dataclass(frozen=True)
class Row:
    """One line: what it is of, the figures, and what was published; None where there is nothing."""

    label: str
    figures: tuple[Spread | None, ...]
    published: tuple[str, ...]


@dataclass(frozen=True)
class Table:
    """Figures of one system.

    Attributes
    ----------
    title : str
    columns : tuple of str
        Of the figures, with their unit.
    published_columns : tuple of str
    rows : tuple of Row
    note : str
        What a reader must know to compare.
    """

    title: str
    columns: tuple[str, ...]
    published_columns: tuple[str, ...]
    rows: tuple[Row, ...]
    note: str = ""

    def text(self) -> str:
        """The table in fixed columns."""
        published = tuple(f"published {c}" for c in self.published_columns)
        lines = [("", *self.columns, *published)]
        for row in self.rows:
            figures = tuple("-" if f is None else str(f) for f in row.figures)
            lines.append((row.label, *figures, *row.published))
        widths = [max(len(line[k]) for line in lines) for k in range(len(lines[0]))]
        body = "\n".join(
            "  ".join(
                cell.ljust(w) if k == 0 else cell.rjust(w)
                for k, (cell, w) in enumerate(zip(line, widths, strict=True))
            )
            for line in lines
        )
        return f"{self.title}\n{body}" + (f"\n{self.note}" if self.note else "")
