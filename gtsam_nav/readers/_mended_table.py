"""What is plainly meant otherwise in a table of a mission folder, mended and said.

Sigmas of zero throughout are those of a driver that does not know better; stamps that fall back by
a day are seconds of the day, in a log that goes on past midnight.
"""

from __future__ import annotations

from collections.abc import Sequence
from collections.abc import Set as AbstractSet
from dataclasses import replace
from typing import Any

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.mission import Rejection, Sensor
from gtsam_nav.readers._table import Table
from gtsam_nav.readers.layout import Field

DAY_S, NEAR_S = 86_400.0, 3600.0
"""A day, and how near midnight the stamps on both sides of it lie."""
PAST_MIDNIGHT = (
    "has seconds of the day as stamps, and they pass midnight: those after it are taken for the"
    " next day's"
)


def mended(table: Table, noise: Any, layout: Sequence[Field]) -> tuple[Table, list[str]]:
    """The table as it is meant, and what is to be said of that.

    Parameters
    ----------
    table : Table
    noise : pydantic model or None
        The sensor's noise figures.
    layout : sequence of Field
    """
    columns, said = dict(table.columns), []
    usual = _usual_sigmas(table, noise, layout)
    if usual:
        figures = ", ".join(f"{column} {value:g}" for column, value in usual.items())
        said.append(
            f"has {', '.join(usual)} of zero throughout: the noise figures serve instead"
            f" ({figures})"
        )
        columns |= {column: np.full(len(columns["t"]), usual[column]) for column in usual}
    columns["t"], midnight = past_midnight(columns["t"])
    said += midnight
    return replace(table, columns=columns), said


def _usual_sigmas(table: Table, noise: Any, layout: Sequence[Field]) -> dict[str, float]:
    """The noise figures that stand for columns of sigmas."""
    return {
        column: getattr(noise, figure)
        for spec in layout
        for column, figure in zip(spec.columns, spec.noise, strict=False)
        if column in table.columns and _is_zero(table.columns[column])
    }


def _is_zero(column: Array) -> bool:
    """Whether a column holds zeros and nothing else that is finite."""
    return bool(np.any(column == 0.0) and np.all((column == 0.0) | ~np.isfinite(column)))


def past_midnight(t: Array) -> tuple[Array, list[str]]:
    """Stamps (n,) that go on past midnight, and what is to be said of that."""
    days = days_passed(t)
    return (t + DAY_S * days, [PAST_MIDNIGHT]) if np.any(days) else (t, [])


def onto_one_day(
    sensors: dict[str, Sensor], rejections: list[Rejection], passed: AbstractSet[str]
) -> list[str]:
    """Move sensors whose log begins after midnight, by a day, and say so.

    Of sensors ``passed`` the stamps go past that midnight, and the others' lie beside them only a
    day later.
    """
    crossing = [sensors[name].series.t for name in passed if name in sensors]
    said: list[str] = []
    for name, sensor in sensors.items():
        t = sensor.series.t
        early = bool(crossing) and t[0] > 0.0 and t[-1] < min(own[0] for own in crossing)
        if not early or t[0] + DAY_S > max(own[-1] for own in crossing):
            continue
        sensors[name] = replace(sensor, series=sensor.series.shift(DAY_S))
        rejections[:] = [replace(r, t=r.t + DAY_S * (r.sensor == name)) for r in rejections]
        said.append(
            f"sensor '{name}' begins after the midnight that others pass: its stamps, in seconds"
            " of the day, are taken for the next day's"
        )
    return said


def days_passed(t: Array) -> Array:
    """How many midnights stamps (n,) have passed, where they are seconds of the day; else zeros.

    Only what can be nothing else is taken for such: stamps within a day that fall back from its
    last hour to its first, and never otherwise by half a day. One that comes late, after
    midnight, is still the day's before.
    """
    none = np.zeros(len(t))
    known = np.flatnonzero(np.isfinite(t))
    stamps = t[known]
    step = np.diff(stamps)
    fell = step < -0.5 * DAY_S
    falls = np.flatnonzero(fell)
    if not len(falls) or np.min(stamps) < 0.0 or np.max(stamps) > DAY_S:
        return none
    if np.any(stamps[falls] < DAY_S - NEAR_S) or np.any(stamps[falls + 1] > NEAR_S):
        return none
    late = (step > 0.5 * DAY_S) & (stamps[:-1] < NEAR_S) & (stamps[1:] > DAY_S - NEAR_S)
    days = np.append(0, np.cumsum(fell.astype(int) - late))
    newest = np.maximum(np.searchsorted(known, np.arange(len(t)), side="right") - 1, 0)
    return np.asarray(days[newest], dtype=float)
