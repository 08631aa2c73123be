"""Heading: its error, or where the methods disagree; and the slow states, compass bias first."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from gtsam_nav.evaluation.histories import (
    COMPASS_PREFIX,
    compass_readings,
    for_people,
    heading_baseline,
    reference_heading,
    slow_names,
)
from gtsam_nav.evaluation.plots.style import (
    MUTED,
    add_legend,
    broken,
    label,
    method_colour,
    new_figure,
)
from gtsam_nav.frames import Array
from gtsam_nav.solution import Solution

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COMPASS = "#aab4be"
MOST_READINGS = 6000


def heading_errors(solutions: Sequence[Solution]) -> Figure | None:
    """Heading of each method and of the compass, less the reference's.

    Where the reference has no heading the foremost solution stands in for it: then the figure
    shows where the others differ.
    """
    baseline, others = heading_baseline(solutions)
    compass = compass_readings(solutions[0].mission)
    if not others and compass is None:
        return None
    figure, (ax,) = new_figure(9.5, 3.0)
    if compass is not None:
        _draw_compass(ax, *baseline.less(*compass))
    for solution in others:
        trajectory = solution.trajectory
        t, error = broken(*baseline.less(trajectory.t, trajectory.yaw))
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
    names = [name for name in slow_names(solution) if name.startswith(COMPASS_PREFIX)]
    if not names:
        return None
    truth, compass = reference_heading(solution), compass_readings(solution.mission)
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
    names = [name for name in slow_names(solution) if not name.startswith(COMPASS_PREFIX)]
    if not names:
        return None
    columns = min(len(names), 3)
    rows = -(-len(names) // columns)
    figure, axes = new_figure(9.5, 0.6 + 1.8 * rows, rows=rows, columns=columns, share_x=True)
    for ax, name in zip(axes, names, strict=False):
        _draw_slow_state(ax, solution, name)
    for ax in axes[len(names) :]:
        ax.set_visible(False)
    for ax in axes[max(len(names) - columns, 0) : len(names)]:  # the lowest of each column
        label(ax, "mission time (s)", ax.get_ylabel())
        ax.tick_params(labelbottom=True)
    add_legend(axes[0])
    return figure


def _draw_slow_state(ax: Axes, solution: Solution, name: str) -> None:
    slow = solution.slow_states
    assert slow is not None
    values, sigmas = slow.columns[name]
    quantity, unit, factor = for_people(name)
    colour = method_colour(solution.method)
    t, value, three_sigma = broken(slow.t, factor * values, 3.0 * factor * sigmas)
    band = value - three_sigma, value + three_sigma
    ax.fill_between(t, *band, color=colour, alpha=0.18, linewidth=0, label="±3 sigma")
    ax.plot(t, value, color=colour, linewidth=1.2, label="estimate")
    label(ax, "", f"{quantity}\n({unit})" if unit else quantity)


def _draw_compass(ax: Axes, t: Array, error_deg: Array) -> None:
    step = 1 + len(t) // MOST_READINGS
    ax.plot(t[::step], error_deg[::step], ".", color=COMPASS, markersize=2, label="compass")
