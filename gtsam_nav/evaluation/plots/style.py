"""How all figures look: colours that the colour-blind can tell apart, thin grids, no boxes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gtsam_nav.evaluation.histories import line_starts
from gtsam_nav.frames import Array
from gtsam_nav.writers.atomic import replacing_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK = "#1d2733"
MUTED = "#6b7785"
GRID = "#e4e8ec"
REFERENCE = "#1d2733"
ACCEPTED = "#009e73"
REJECTED = "#9f1fdf"
_METHODS = {
    "graph": "#1f6fb2",
    "dr": "#e07b1a",
    "ins-ekf": "#532584",
    "pose-ekf": "#3ead80",
    "scan-match": "#9d433e",
    "landmark-ekf": "#a98ae2",
    "kiss": "#851313",  # far from graph's: scan-match, the nearest, needs a sonar and it a lidar
}

DPI = 130


def method_colour(method: str) -> str:
    """The colour of a method, the same in every figure and table."""
    return _METHODS.get(method, MUTED)


def new_figure(
    width_in: float, height_in: float, rows: int = 1, columns: int = 1, share_x: bool = False
) -> tuple[Figure, list[Axes]]:
    """A figure with its axes, row by row, in the house's style."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in), dpi=DPI, layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, sharex=share_x).ravel().tolist()
    for ax in axes:
        ax.tick_params(colors=MUTED, labelsize=8, length=3)
        ax.grid(color=GRID, linewidth=0.8)
        ax.set_axisbelow(True)
        ax.margins(x=0.01)
        for side, spine in ax.spines.items():
            spine.set_visible(side in ("left", "bottom"))
            spine.set_color("#b8c0c8")
    return figure, axes


def label(ax: Axes, x: str = "", y: str = "", title: str = "") -> None:
    """Axis labels and a title on the left."""
    ax.set_xlabel(x, color=INK, fontsize=9)
    ax.set_ylabel(y, color=INK, fontsize=9)
    if title:
        ax.set_title(title, loc="left", color=INK, fontsize=9.5, fontweight="bold")


def add_legend(ax: Axes, markerscale: float = 1.0, beside: bool = False) -> None:
    """A legend in one line above the axes, or in a column beside them; none where none is due."""
    handles, _ = ax.get_legend_handles_labels()
    if handles:
        ax.legend(
            loc="upper left" if beside else "lower left",
            bbox_to_anchor=(1.01, 1.0) if beside else (0.0, 1.0),
            borderaxespad=0.2,
            ncols=1 if beside else len(handles),
            frameon=False,
            fontsize=8,
            labelcolor=INK,
            markerscale=markerscale,
        )


def broken(t: Array, *values: Array) -> list[Array]:
    """Time and values with a NaN inside every silence, so that lines break there."""
    at = line_starts(t)
    return [np.insert(np.asarray(column, dtype=float), at, np.nan) for column in (t, *values)]


def save_png(figure: Figure, path: Path) -> Path:
    """Write a figure; the same figure gives the same bytes. Whole or not at all."""
    with replacing_file(path) as draft:
        # tight: legends and labels that stand beside the axes are not cut
        figure.savefig(draft, format="png", facecolor="white", bbox_inches="tight", pad_inches=0.15)
    return path
