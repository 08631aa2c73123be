"""When each sensor spoke, fell silent, or was not believed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gtsam_nav.evaluation.plots.style import INK, MUTED, REJECTED, label, new_figure
from gtsam_nav.frames import Array
from gtsam_nav.mission import Sensor
from gtsam_nav.series import DvlSeries
from gtsam_nav.solution import Solution

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

GAP_PERIODS = 5.0
"""Silence of more sampling periods is a gap."""
LEAST_GAP_S = 1.0
BAR = "#7fa8c9"
REFERENCE_BAR = "#b9bec4"


def sensor_timeline(solution: Solution) -> Figure | None:
    """A bar a sensor, broken at its gaps; red where a measurement was not used. None of none."""
    sensors = [s for s in solution.mission.sensors.values() if len(s.series)]
    if solution.reference is not None:
        sensors.append(solution.reference)
    if not sensors:
        return None
    figure, (ax,) = new_figure(9.5, 0.9 + 0.36 * len(sensors))
    for row, sensor in enumerate(sensors):
        spans = spans_without_gaps(sensor.series.t)
        colour = REFERENCE_BAR if sensor is solution.reference else BAR
        ax.broken_barh([(a, b - a) for a, b in spans], (row - 0.3, 0.6), color=colour, linewidth=0)
        unused = _unused_times(solution, sensor)
        if len(unused):
            ax.vlines(unused, row - 0.3, row + 0.3, color=REJECTED, linewidth=0.7)
        _annotate(ax, row, sensor, len(spans) - 1, len(unused))
    ax.set_yticks(range(len(sensors)), [_name(s, solution) for s in sensors])
    ax.tick_params(axis="y", length=0, labelcolor=INK)
    ax.set_ylim(len(sensors) - 0.5, -0.5)
    ax.grid(visible=False, axis="y")
    label(ax, "mission time (s)")
    return figure


def spans_without_gaps(t: Array) -> list[tuple[float, float]]:
    """First and last time of each stretch without a gap of more than five sampling periods."""
    if len(t) < 2:
        return [(float(t[0]), float(t[0]))] if len(t) else []
    steps = np.diff(t)
    gaps = np.flatnonzero(steps > max(GAP_PERIODS * float(np.median(steps)), LEAST_GAP_S))
    firsts, lasts = np.concatenate([[0], gaps + 1]), np.concatenate([gaps, [len(t) - 1]])
    return list(zip(t[firsts].tolist(), t[lasts].tolist(), strict=True))


def _unused_times(solution: Solution, sensor: Sensor) -> Array:
    """Times of rejected measurements, and of DVL samples that carry no velocity."""
    times = [r.t for r in solution.rejections if r.sensor == sensor.name and np.isfinite(r.t)]
    if isinstance(sensor.series, DvlSeries):
        times += sensor.series.t[~sensor.series.valid].tolist()
    return np.unique(times)


def _name(sensor: Sensor, solution: Solution) -> str:
    if sensor.simulated:
        return f"{sensor.name}\n(simulated)"
    return f"{sensor.name}\n(scored on)" if sensor is solution.reference else sensor.name


def _annotate(ax: Axes, row: int, sensor: Sensor, n_gaps: int, n_unused: int) -> None:
    n = len(sensor.series)
    span = float(sensor.series.t[-1] - sensor.series.t[0])
    parts = [f"{n:,}".replace(",", " ")]
    if span > 0:
        parts.append(f"{(n - 1) / span:.3g} Hz")
    if n_gaps:
        parts.append(f"{n_gaps} gap{'s' * (n_gaps > 1)}")
    if n_unused:
        parts.append(f"{n_unused} unused")
    ax.annotate(
        " · ".join(parts), (1.01, row), xycoords=ax.get_yaxis_transform(), va="center",
        fontsize=7.5, color=MUTED, annotation_clip=False,
    )  # fmt: skip
