"""What is plainly meant otherwise in a table of a mission folder, mended and said.

Sigmas of zero throughout are those of a driver that does not know better; stamps that fall back by
a day are seconds of the day, in a log that goes on past midnight.
"""

from __future__ import annotations

from collections.abc import Sequence
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
    "seconds of the day are the stamps of {}, and they pass midnight: those after it are taken for"
    " the next day's"
)
BEGUN_AFTER = (
    "the stamps of {} begin after the midnight that others pass: seconds of the day, they are taken"
    " for the next day's"
)
OVERLAP = 0.9
"""Share of a log that must lie beside the others' on the day that it is taken for."""
POWER_UP_S = 1.0
"""Stamps that begin so soon, or within two of their steps, count from when a sensor was on."""


def mended(table: Table, noise: Any, layout: Sequence[Field]) -> tuple[Table, list[str], bool]:
    """The table as it is meant, what is to be said of that, and whether it passes midnight.

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
    lacking = np.nan if table.cut_stamp is None else table.cut_stamp
    stamps, passed = past_midnight(np.append(columns["t"], lacking))
    columns["t"] = stamps[:-1]
    cut_stamp = None if table.cut_stamp is None else float(stamps[-1])
    return replace(table, columns=columns, cut_stamp=cut_stamp), said, passed


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


def onto_one_day(
    sensors: dict[str, Sensor], rejections: list[Rejection], passed: Sequence[str]
) -> list[str]:
    """Move sensors whose log begins after midnight, by a day, and say so.

    Of sensors ``passed`` the stamps go past that midnight, and the others' lie beside them only a
    day later.
    """
    crossing = [sensors[name].series.t for name in passed if name in sensors]
    if not crossing:
        return []
    begin, end = min(float(t[0]) for t in crossing), max(float(t[-1]) for t in crossing)
    late = [
        name for name, sensor in sensors.items() if _is_of_the_next_day(sensor.series.t, begin, end)
    ]
    for name in late:
        sensors[name] = replace(sensors[name], series=sensors[name].series.shift(DAY_S))
    rejections[:] = [replace(r, t=r.t + DAY_S * (r.sensor in late)) for r in rejections]
    return [BEGUN_AFTER.format(_listed(late))] if late else []


def _is_of_the_next_day(t: Array, begin: float, end: float) -> bool:
    """Whether stamps lie beside a span a day later, neither now nor counted from power-up."""
    first, last = float(t[0]), float(t[-1])
    step = float(np.median(np.diff(t))) if len(t) > 1 else 0.0
    if last >= begin or first <= max(POWER_UP_S, 2 * step):
        return False
    beside = np.mean((t + DAY_S >= begin) & (t + DAY_S <= end))
    return bool(beside >= OVERLAP)


def said_of_midnight(passed: Sequence[str]) -> list[str]:
    """What is said of sensors whose stamps pass midnight."""
    return [PAST_MIDNIGHT.format(_listed(passed))] if passed else []


def _listed(names: Sequence[str]) -> str:
    return ", ".join(f"'{name}'" for name in names)


def past_midnight(t: Array) -> tuple[Array, bool]:
    """Stamps (n,) that go on past midnight, and whether they do."""
    days = days_passed(t)
    return t + DAY_S * days, bool(np.any(days))


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
