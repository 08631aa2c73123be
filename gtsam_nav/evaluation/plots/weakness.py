"""How unsure the position is along the longest axis of its error ellipse."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from gtsam_nav.evaluation.plots.style import add_legend, broken, label, method_colour, new_figure
from gtsam_nav.evaluation.weakness import MajorAxis, weak_stretches
from gtsam_nav.solution import Solution

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def position_sigma(solutions: Sequence[Solution]) -> Figure | None:
    """Sigma along the longest axis against time, weak stretches shaded in the method's colour."""
    known = [(s, axis) for s in solutions if (axis := MajorAxis.of(s.trajectory)) is not None]
    if not known:
        return None
    figure, (ax,) = new_figure(9.5, 3.0)
    for solution, axis in known:
        colour = method_colour(solution.method)
        t, sigma = broken(solution.trajectory.t, axis.sigma_m)
        ax.plot(t, sigma, color=colour, linewidth=1.0, label=solution.method)
        for stretch in weak_stretches(solution):
            ax.axvspan(stretch.begin_s, stretch.end_s, color=colour, alpha=0.12, linewidth=0)
    ax.set_ylim(bottom=0.0)
    label(ax, "mission time (s)", "sigma along the longest axis (m)")
    add_legend(ax)
    return figure
