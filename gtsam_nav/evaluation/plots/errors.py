"""Position error against time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from gtsam_nav.evaluation.histories import error_history
from gtsam_nav.evaluation.plots.style import (
    GRID,
    INK,
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

Window = tuple[float, float] | None


def position_errors(solution: Solution, window_s: Window = None) -> Figure | None:
    """Error north, east and horizontal against time, with three sigma.

    Without alignment, or after the SE(2) alignment where there are no absolute positions. The
    band is that of estimate and reference together. What lies outside the window is shaded.
    """
    found = error_history(solution)
    if found is None:
        return None
    sigma = found.sigma_m
    colour = method_colour(solution.method)
    figure, axes = new_figure(9.5, 5.4, rows=3, share_x=True)
    for axis, (ax, name) in enumerate(zip(axes, ("north", "east", "horizontal"), strict=True)):
        if sigma is not None:
            _draw_band(ax, found.t, 3.0 * sigma[:, axis], colour, signed=axis < 2)
        t, values = broken(found.t, found.error_m[:, axis])
        ax.plot(t, values, color=colour, linewidth=1.0, label=f"error{found.note}")
        if axis < 2:
            ax.axhline(0.0, color=MUTED, linewidth=0.6)
        else:
            ax.set_ylim(bottom=0.0)
        _shade_outside(ax, found.t, window_s)
        label(ax, "mission time (s)" if axis == 2 else "", f"{name} (m)")
    add_legend(axes[0])
    return figure


def horizontal_errors(solutions: Sequence[Solution], window_s: Window = None) -> Figure | None:
    """Horizontal error of all solutions against time."""
    found = [(s, errors) for s in solutions if (errors := error_history(s)) is not None]
    if not found:
        return None
    figure, (ax,) = new_figure(9.5, 3.2)
    for solution, errors in found:
        t, error = broken(errors.t, errors.error_m[:, 2])
        ax.plot(
            t,
            error,
            color=method_colour(solution.method),
            linewidth=1.1,
            label=solution.method + errors.note,
        )
    ax.set_ylim(bottom=0.0)
    _shade_outside(ax, found[0][1].t, window_s)
    label(ax, "mission time (s)", "horizontal error (m)")
    add_legend(ax)
    return figure


def _draw_band(ax: Axes, t: Array, three_sigma: Array, colour: str, signed: bool) -> None:
    t, top = broken(t, three_sigma)
    bottom = -top if signed else np.zeros_like(top)
    name = "±3 sigma of estimate and reference" if signed else "3 sigma"
    ax.fill_between(t, bottom, top, color=colour, alpha=0.15, linewidth=0, label=name)


def _shade_outside(ax: Axes, t: Array, window_s: Window) -> None:
    """Grey over what is not scored."""
    if window_s is None:
        return
    ax.set_xlim(float(t[0]), float(t[-1]))
    for begin, end in ((t[0], window_s[0]), (window_s[1], t[-1])):
        if begin < end:
            ax.axvspan(float(begin), float(end), color=GRID, alpha=0.6, linewidth=0, zorder=0)
            ax.annotate(
                "not scored",
                (float(begin + end) / 2, 0.97),
                xycoords=ax.get_xaxis_transform(),
                ha="center",
                va="top",
                fontsize=7,
                color=INK,
            )
