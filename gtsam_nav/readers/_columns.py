"""The columns of a CSV file as those of a series."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array
from gtsam_nav.readers._table import Table
from gtsam_nav.readers.layout import GEODETIC_COLUMNS, LOCK_WORDS, NED_COLUMNS, Field
from gtsam_nav.series import BoolArray


def values_of(spec: Field, table: Table, noise: Any) -> Array | None:
    """One column of the series from the file, from the noise figures, or from its default."""
    n = len(table.columns["t"])
    names = spec.columns
    if spec.columns == NED_COLUMNS and table.has(GEODETIC_COLUMNS):
        return None
    present = [name for name in names if name in table.columns]
    if present and len(present) < len(names):
        lacking = ", ".join(name for name in names if name not in present)
        raise DataError(f"column {present[0]} is given without {lacking}", table.path)
    if present:
        values = np.column_stack([table.columns[name] for name in names])
    elif spec.noise:
        values = np.tile([getattr(noise, figure) for figure in spec.noise], (n, 1))
    elif spec.absent is not None:
        values = np.full((n, len(names)), spec.absent)
    else:
        return None
    values = values if len(names) > 1 else values[:, 0]
    return np.radians(values) if spec.degrees else values


def not_whole(layout: Sequence[Field], columns: Mapping[str, Array]) -> dict[str, BoolArray]:
    """Samples with a fraction where a whole number belongs, by reason."""
    return {
        f"fractional {spec.series}": np.isfinite(columns[spec.series])
        & (columns[spec.series] != np.floor(columns[spec.series]))
        for spec in layout
        if spec.integer
    }


def of_a_log(table: Table) -> Table:
    """Speeds through the water; those across the bow that a log does not measure are zero."""
    still = np.zeros(len(table.columns["t"]))
    water = np.full(len(still), LOCK_WORDS["water"])
    return replace(table, columns={"vy": still, "vz": still, **table.columns, "lock": water})
