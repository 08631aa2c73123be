"""Loop closures: which pairs were tried, and what became of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gtsam_nav.evaluation.plots.style import (
    ACCEPTED,
    GRID,
    REJECTED,
    add_legend,
    label,
    new_figure,
)
from gtsam_nav.solution import Solution

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def loop_verdicts(solution: Solution) -> Figure | None:
    """Candidates by the times of their scans, and by overlap and offset, coloured by verdict."""
    if not solution.loops:
        return None
    figure, (times, matches) = new_figure(9.5, 3.6, columns=2)
    last = max(loop.t_b for loop in solution.loops)
    times.plot([0, last], [0, last], color=GRID, linewidth=1.0)
    for verdict, colour, marker in (("rejected", REJECTED, "x"), ("accepted", ACCEPTED, "o")):
        loops = [loop for loop in solution.loops if loop.verdict == verdict]
        name = f"{verdict} ({len(loops)})"
        columns = np.array([(x.t_a, x.t_b, x.score, np.hypot(x.dx_m, x.dy_m)) for x in loops])
        t_a, t_b, score, offset = columns.reshape(-1, 4).T
        for ax, x, y in ((times, t_b, t_a), (matches, offset, score)):
            ax.scatter(x, y, c=colour, marker=marker, s=16, alpha=0.75, linewidths=0.9, label=name)
    label(times, "time of the new scan (s)", "time of the old scan (s)")
    label(matches, "distance between the scans (m)", "share of points that paired")
    add_legend(times)
    return figure
