"""NEES and NIS against time, with the bounds of an honest estimator."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from gtsam_nav.evaluation.consistency import horizontal_nees
from gtsam_nav.evaluation.ensemble import EnsembleConsistency, ensemble_nis
from gtsam_nav.evaluation.matching import match
from gtsam_nav.evaluation.metrics import reference_series
from gtsam_nav.evaluation.plots.style import (
    INK,
    MUTED,
    add_legend,
    broken,
    label,
    method_colour,
    new_figure,
)
from gtsam_nav.frames import Array
from gtsam_nav.sensors.prediction import chi2_limit
from gtsam_nav.solution import Solution

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BINS = 60
"""Spans over which a mission's innovations are averaged."""

LEAST_NEES = 1e-3
"""Below it a logarithmic axis shows only luck."""


def mission_nees(solutions: Sequence[Solution]) -> Figure | None:
    """NEES on (n, e) of the methods against time; None where none has absolute positions."""
    drawn: list[tuple[str, Array, Array]] = []
    for solution in solutions:
        if solution.reference is None or not solution.georeferenced:
            continue
        series = reference_series(solution.reference)
        matched = match(solution.trajectory, series, solution.reference.xyz_b)
        nees = horizontal_nees(matched) if matched is not None else None
        if matched is not None and nees is not None and len(nees) == len(matched.t):
            t, floored = broken(matched.t, np.maximum(nees, LEAST_NEES))
            drawn.append((solution.method, t, floored))
    if not drawn:
        return None
    figure, (ax,) = new_figure(9.5, 3.2)
    for method, t, values in drawn:
        ax.semilogy(t, values, color=method_colour(method), linewidth=0.9, label=method)
    for probability in (0.025, 0.975):
        ax.axhline(chi2_limit(probability, 2), color=INK, linewidth=0.8, linestyle="--")
    label(ax, "mission time (s)", "NEES (n, e)")
    add_legend(ax)
    return figure


def mission_nis(solution: Solution) -> Figure | None:
    """Innovations of each sensor, averaged over spans of the mission; None without any."""
    if not solution.innovations:
        return None
    begin, end = solution.mission.span_s
    bin_s = max((end - begin) / BINS, 1e-3)
    found = {
        name: ensemble_nis([innovations], bin_s)
        for name, innovations in solution.innovations.items()
    }
    return ensemble_figure({solution.method: found})


def ensemble_figure(found: Mapping[str, Mapping[str, EnsembleConsistency]]) -> Figure:
    """One panel a quantity: the average of each method, and the 95 % bounds."""
    names = list(dict.fromkeys(name for quantities in found.values() for name in quantities))
    figure, axes = new_figure(9.5, 0.8 + 1.7 * len(names), rows=len(names), share_x=True)
    for ax, name in zip(axes, names, strict=True):
        for method, quantities in found.items():
            if name not in quantities:
                continue
            q = quantities[name]
            colour = method_colour(method)
            ax.plot(q.t, q.average / q.dof, color=colour, linewidth=1.0, label=method)
            ax.fill_between(
                q.t, q.lower95 / q.dof, q.upper95 / q.dof, color=colour, alpha=0.12, linewidth=0
            )
        ax.axhline(1.0, color=MUTED, linewidth=0.6)
        ax.set_ylim(bottom=0.0)
        label(ax, "mission time (s)" if ax is axes[-1] else "", name.replace("_", " "))
    add_legend(axes[0])
    return figure
