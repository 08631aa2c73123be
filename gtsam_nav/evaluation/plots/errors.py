"""Position error against time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from gtsam_nav.evaluation.alignment import Aligned, align
from gtsam_nav.evaluation.consistency import total_covariance_ne
from gtsam_nav.evaluation.matching import Matched, match
from gtsam_nav.evaluation.metrics import reference_series
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

MOST_SAMPLES = 6000
"""Of the reference that are drawn; every k-th of a longer one."""


def position_errors(solution: Solution, window_s: Window = None) -> Figure | None:
    """Error north, east and horizontal against time, with three sigma.

    Without alignment, or after the SE(2) alignment where there are no absolute positions. The
    band is that of estimate and reference together. What lies outside the window is shaded.
    """
    found = _errors(solution)
    if found is None:
        return None
    matched, aligned, note = found
    sigma = None
    if matched.estimate.cov_pose_n is not None and not note:
        cov = total_covariance_ne(matched)
        sigma = np.sqrt(np.column_stack([cov[:, 0, 0], cov[:, 1, 1], cov[:, 0, 0] + cov[:, 1, 1]]))
    error = np.column_stack([aligned.error_n[:, :2], aligned.horizontal_m])
    colour = method_colour(solution.method)
    figure, axes = new_figure(9.5, 5.4, rows=3, share_x=True)
    for axis, (ax, name) in enumerate(zip(axes, ("north", "east", "horizontal"), strict=True)):
        if sigma is not None:
            _draw_band(ax, matched.t, 3.0 * sigma[:, axis], colour, signed=axis < 2)
        t, values = broken(matched.t, error[:, axis])
        ax.plot(t, values, color=colour, linewidth=1.0, label=f"error{note}")
        if axis < 2:
            ax.axhline(0.0, color=MUTED, linewidth=0.6)
        else:
            ax.set_ylim(bottom=0.0)
        _shade_outside(ax, matched.t, window_s)
        label(ax, "mission time (s)" if axis == 2 else "", f"{name} (m)")
    add_legend(axes[0])
    return figure


def horizontal_errors(solutions: Sequence[Solution], window_s: Window = None) -> Figure | None:
    """Horizontal error of all solutions against time."""
    found = [(s, errors) for s in solutions if (errors := _errors(s)) is not None]
    if not found:
        return None
    figure, (ax,) = new_figure(9.5, 3.2)
    for solution, (matched, aligned, note) in found:
        t, error = broken(matched.t, aligned.horizontal_m)
        ax.plot(
            t,
            error,
            color=method_colour(solution.method),
            linewidth=1.1,
            label=solution.method + note,
        )
    ax.set_ylim(bottom=0.0)
    _shade_outside(ax, found[0][1][0].t, window_s)
    label(ax, "mission time (s)", "horizontal error (m)")
    add_legend(ax)
    return figure


def _errors(solution: Solution) -> tuple[Matched, Aligned, str] | None:
    """Matched samples, their errors, and a note where these are after an alignment."""
    if solution.reference is None:
        return None
    series = reference_series(solution.reference)
    series = series.select(slice(None, None, 1 + len(series) // MOST_SAMPLES))
    matched = match(solution.trajectory, series, solution.reference.xyz_b)
    aligned = align(matched, "none" if solution.georeferenced else "se2") if matched else None
    if matched is None or aligned is None:
        return None
    return matched, aligned, "" if solution.georeferenced else " (SE(2)-aligned)"


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
