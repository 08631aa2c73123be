"""Heading: its error, or where the methods disagree; and the slow states, compass bias first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gtsam_nav.evaluation.metrics import reference_series
from gtsam_nav.evaluation.plots.style import (
    MUTED,
    add_legend,
    broken,
    foremost,
    label,
    method_colour,
    new_figure,
)
from gtsam_nav.frames import Array, rpy_from_rotation, wrap_angle
from gtsam_nav.mission import Mission
from gtsam_nav.series import HeadingSeries
from gtsam_nav.solution import Solution

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COMPASS = "#aab4be"
COMPASS_PREFIX = "heading"
MOST_READINGS = 6000


@dataclass(frozen=True)
class _Baseline:
    """The heading that the others are held against."""

    name: str
    t: Array
    yaw: Array

    def less(self, t: Array, yaw: Array) -> tuple[Array, Array]:
        """Times inside the baseline's span, and there the heading less the baseline's, deg."""
        inside = (t >= self.t[0]) & (t <= self.t[-1])
        own = np.interp(t[inside], self.t, np.unwrap(self.yaw))
        return t[inside], np.degrees(wrap_angle(yaw[inside] - own))


def heading_errors(solutions: Sequence[Solution]) -> Figure | None:
    """Heading of each method and of the compass, less the reference's.

    Where the reference has no heading the foremost solution stands in for it: then the figure
    shows where the others differ.
    """
    baseline = _reference_heading(solutions[0])
    others = list(solutions)
    if baseline is None:
        chosen = foremost(solutions)
        others = [s for s in solutions if s is not chosen]
        baseline = _Baseline(chosen.method, chosen.trajectory.t, chosen.trajectory.rpy[:, 2])
    compass = _compass(solutions[0].mission)
    if not others and compass is None:
        return None
    figure, (ax,) = new_figure(9.5, 3.0)
    if compass is not None:
        _draw_compass(ax, *baseline.less(*compass))
    for solution in others:
        trajectory = solution.trajectory
        t, error = broken(*baseline.less(trajectory.t, trajectory.rpy[:, 2]))
        ax.plot(
            t, error, color=method_colour(solution.method), linewidth=0.9, label=solution.method
        )
    ax.axhline(0.0, color=MUTED, linewidth=0.6)
    label(ax, "mission time (s)", f"heading less {baseline.name}'s (deg)")
    add_legend(ax, markerscale=4)
    return figure


def compass_bias(solution: Solution) -> Figure | None:
    """Estimated compass bias with three sigma.

    Where the reference has a heading, the compass's true error stands behind it.
    """
    names = [name for name in _slow_names(solution) if name.startswith(COMPASS_PREFIX)]
    if not names:
        return None
    truth, compass = _reference_heading(solution), _compass(solution.mission)
    figure, axes = new_figure(9.5, 0.6 + 2.4 * len(names), rows=len(names), share_x=True)
    for ax, name in zip(axes, names, strict=True):
        if truth is not None and compass is not None:
            _draw_compass(ax, *truth.less(*compass))
        _draw_slow_state(ax, solution, name)
        add_legend(ax, markerscale=4)
    label(axes[-1], "mission time (s)", axes[-1].get_ylabel())
    return figure


def slow_states(solution: Solution) -> Figure | None:
    """The other biases and slow states, each in its panel, with three sigma."""
    names = [name for name in _slow_names(solution) if not name.startswith(COMPASS_PREFIX)]
    if not names:
        return None
    columns = min(len(names), 3)
    rows = -(-len(names) // columns)
    figure, axes = new_figure(9.5, 0.6 + 1.8 * rows, rows=rows, columns=columns, share_x=True)
    for ax, name in zip(axes, names, strict=False):
        _draw_slow_state(ax, solution, name)
    for ax in axes[len(names) :]:
        ax.set_visible(False)
    for ax in axes[-columns:]:
        label(ax, "mission time (s)", ax.get_ylabel())
    add_legend(axes[0])
    return figure


def _slow_names(solution: Solution) -> list[str]:
    slow = solution.slow_states
    return [] if slow is None or not len(slow.t) else sorted(slow.columns)


def _draw_slow_state(ax: Axes, solution: Solution, name: str) -> None:
    slow = solution.slow_states
    assert slow is not None
    values, sigmas = slow.columns[name]
    quantity, factor = _in_degrees(name)
    colour = method_colour(solution.method)
    t, value, three_sigma = broken(slow.t, factor * values, 3.0 * factor * sigmas)
    band = value - three_sigma, value + three_sigma
    ax.fill_between(t, *band, color=colour, alpha=0.18, linewidth=0, label="±3 sigma")
    ax.plot(t, value, color=colour, linewidth=1.2, label="estimate")
    label(ax, "", quantity)


def _reference_heading(solution: Solution) -> _Baseline | None:
    if solution.reference is None:
        return None
    series = reference_series(solution.reference)
    return None if series.rpy is None else _Baseline("reference", series.t, series.rpy[:, 2])


def _compass(mission: Mission) -> tuple[Array, Array] | None:
    """Times and readings of the first compass as headings of the body."""
    sensor = mission.first("heading")
    if sensor is None or not isinstance(sensor.series, HeadingSeries):
        return None
    return sensor.series.t, sensor.series.heading - rpy_from_rotation(sensor.R_bs)[2]


def _draw_compass(ax: Axes, t: Array, error_deg: Array) -> None:
    step = 1 + len(t) // MOST_READINGS
    ax.plot(t[::step], error_deg[::step], ".", color=COMPASS, markersize=2, label="compass")


def _in_degrees(name: str) -> tuple[str, float]:
    """A column's name for people, and the factor to the unit that it names."""
    for ending, unit in (("_rad_s", "deg/s"), ("_rad", "deg")):
        if name.endswith(ending):
            return f"{name.removesuffix(ending).replace('_', ' ')}\n({unit})", 180.0 / np.pi
    for ending, unit in (("_m_s2", "m/s²"), ("_m_s", "m/s"), ("_m", "m"), ("_s", "s")):
        if name.endswith(ending):
            return f"{name.removesuffix(ending).replace('_', ' ')}\n({unit})", 1.0
    return name.replace("_", " "), 1.0
