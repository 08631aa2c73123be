"""Samples that only repeat the one before: a driver that publishes faster than it measures."""

from __future__ import annotations

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.mission import Rejection
from gtsam_nav.series import (
    AttitudeSeries,
    BoolArray,
    DvlSeries,
    GnssSeries,
    HeadingSeries,
    ImuSeries,
    Series,
)

MEASURED: dict[type[Series], tuple[str, ...]] = {
    ImuSeries: ("gyro_i", "accel_i"),
    DvlSeries: ("v_d",),
    GnssSeries: ("p_n", "v_n"),
    HeadingSeries: ("heading",),
    AttitudeSeries: ("roll", "pitch"),
}
"""What no two measurements have in common to the last digit; commands and coarse gauges do."""

REPEATED = "repeats the sample before"


def measured_columns(series: Series) -> list[Array]:
    """The columns that a repeated message repeats, (n,) each; none for other types."""
    names = MEASURED.get(type(series), ())
    values = [getattr(series, name) for name in names]
    valid = _told(series)
    told = [v[valid].reshape(-1, *v.shape[1:] or (1,)) for v in values if v is not None]
    return [column for v in told for column in v.T]


def repeats_of(series: Series) -> BoolArray | None:
    """Which of the samples that tell anything equal the one before; None for other types."""
    columns = measured_columns(series)
    if not columns:
        return None
    same = np.all([np.diff(column) == 0 for column in columns], axis=0)
    return np.concatenate([[False], same]) if len(columns[0]) else np.empty(0, dtype=bool)


def without_repeats(name: str, series: Series) -> tuple[Series, list[Rejection]]:
    """The series without the samples that repeat the one before, and these as rejections."""
    repeated = repeats_of(series)
    if repeated is None:
        return series, []
    drop = np.zeros(len(series), dtype=bool)
    drop[np.flatnonzero(_told(series))[repeated]] = True
    rejections = [
        Rejection(t=float(series.t[k]), sensor=name, index=int(series.row[k]), reason=REPEATED)
        for k in np.flatnonzero(drop)
    ]
    return series.select(~drop), rejections


def _told(series: Series) -> BoolArray:
    """The samples that hold a measurement: a DVL without lock reads zeros."""
    return series.valid if isinstance(series, DvlSeries) else np.ones(len(series), dtype=bool)
