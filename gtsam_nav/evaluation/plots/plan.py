"""The plan view: where everybody says the vehicle went."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from gtsam_nav.evaluation.histories import ranked
from gtsam_nav.evaluation.metrics import reference_series
from gtsam_nav.evaluation.plots.landmarks import DrawnLandmarks, draw_landmarks, draw_survey
from gtsam_nav.evaluation.plots.style import (
    ACCEPTED,
    INK,
    REFERENCE,
    REJECTED,
    add_legend,
    broken,
    label,
    method_colour,
    new_figure,
)
from gtsam_nav.evaluation.tracks import Track, map_name, track_of
from gtsam_nav.evaluation.used_fixes import used_fixes
from gtsam_nav.frames import Array
from gtsam_nav.solution import Solution

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH_IN = 9.5
MOST_ECHOES = 60_000
"""Drawn at most; more only make the file larger."""
ECHO = "#93a3b1"
FIX = "#8a4fbf"


def plan_view(solutions: Sequence[Solution]) -> Figure:
    """Reference, trajectories, sonar map, loops by verdict, landmarks; north up, axes equal.

    The map, the loops and the landmarks are those of the foremost solution that has them. One
    without absolute positions is drawn after its SE(2) alignment, and the legend says so.
    """
    tracks = [track_of(solution) for solution in ranked(solutions)]
    chosen = tracks[0].solution
    truth = chosen.reference and reference_series(chosen.reference)
    owner = next((track for track in tracks if len(_echoes(track))), tracks[0])
    echoes = _echoes(owner)
    mapped = next((found for track in tracks if (found := _landmarks(track))), None)
    survey = chosen.mission.landmark_map
    paths = [track.path_n for track in tracks] + ([truth.p_n] if truth else [])
    paths += [survey.p_n] if survey and len(survey.id) else []
    paths += [mapped.landmarks.p_n] if mapped else []
    low, high = _extent(paths, echoes)
    north, east = (high - low).tolist()
    figure, (ax,) = new_figure(*_size_in(north, east))
    if len(echoes):
        ax.plot(
            echoes[:, 1],
            echoes[:, 0],
            ".",
            markersize=1.3,
            color=ECHO,
            alpha=0.45,
            label=f"{map_name(owner.solution.mission)} ({owner.solution.method})",
        )
    looped = next((track for track in tracks if track.solution.loops), None)
    if looped is not None:
        _draw_loops(ax, looped)
    _draw_fixes(ax, chosen)
    if survey:
        draw_survey(ax, survey)
    if truth:
        _draw_path(ax, truth.t, truth.p_n, "reference", REFERENCE, 1.0)
    for track in sorted(tracks, key=lambda track: track.solution is chosen):
        name = track.solution.method
        _draw_path(
            ax, track.solution.trajectory.t, track.path_n, name + track.note, method_colour(name)
        )
        if track.solution is chosen:
            n, e, _ = track.path_n[0]
            ax.plot(e, n, "o", color="white", markeredgecolor=INK, markersize=7, label="start")
    if mapped:
        draw_landmarks(ax, mapped)
    ax.set_xlim(low[1], high[1])
    ax.set_ylim(low[0], high[0])
    ax.set_aspect("equal", adjustable="box")
    label(ax, "east (m)", "north (m)")
    add_legend(ax, beside=north > east)
    return figure


def _landmarks(track: Track) -> DrawnLandmarks | None:
    """The track's landmarks where they are drawn; None without any."""
    found = track.solution.landmarks
    if found is None or not len(found.id):
        return None
    placed = replace(found, p_n=track.place(found.p_n), cov_n=track.R @ found.cov_n @ track.R.T)
    return DrawnLandmarks(placed, method_colour(track.solution.method))


def _echoes(track: Track) -> Array:
    """The track's sonar map where it is drawn, thinned; empty without one."""
    sonar_map = track.solution.sonar_map
    if sonar_map is None:
        return np.empty((0, 3))
    return track.place(sonar_map.points_n[:: 1 + len(sonar_map.t) // MOST_ECHOES])


def _draw_path(ax: Axes, t: Array, p_n: Array, name: str, colour: str, width: float = 1.5) -> None:
    _, n, e = broken(t, p_n[:, 0], p_n[:, 1])
    ax.plot(e, n, color=colour, linewidth=width, label=name)


def _extent(paths_n: Sequence[Array], echoes_n: Array) -> tuple[Array, Array]:
    """Corners (n, e) of what is drawn, with a margin; stray echoes don't count."""
    corners = [corner for path in paths_n for corner in (path.min(axis=0), path.max(axis=0))]
    if len(echoes_n):
        corners += list(np.percentile(echoes_n, [0.2, 99.8], axis=0))
    low, high = np.min(corners, axis=0)[:2], np.max(corners, axis=0)[:2]
    margin = max(0.04 * float(np.max(high - low)), 1.0)
    return low - margin, high + margin


def _size_in(north_m: float, east_m: float) -> tuple[float, float]:
    """Width and height that axes of equal scale fill, with room for the legend."""
    if north_m > east_m:
        return float(np.clip(2.2 + 8.0 * east_m / north_m, 5.5, WIDTH_IN)), 8.5
    return WIDTH_IN, float(np.clip(0.8 + (WIDTH_IN - 0.7) * north_m / east_m, 4.0, 9.0))


def _draw_fixes(ax: Axes, solution: Solution) -> None:
    """The GNSS fixes that the solution used."""
    _, p_n = used_fixes(solution)
    if len(p_n):
        n, e, _ = p_n.T
        ax.plot(e, n, ".", markersize=4, color=FIX, alpha=0.6, label="GNSS used")


def _draw_loops(ax: Axes, track: Track) -> None:
    from matplotlib.collections import LineCollection

    for verdict, colour, width, alpha in (
        ("rejected", REJECTED, 0.6, 0.35),
        ("accepted", ACCEPTED, 0.8, 0.6),
    ):
        loops = [loop for loop in track.solution.loops if loop.verdict == verdict]
        if not loops:
            continue
        ends = [track.at(np.array([getattr(x, key) for x in loops])).T for key in ("t_a", "t_b")]
        lines = LineCollection(
            list(np.stack(ends, axis=1)),
            colors=colour,
            linewidths=width,
            alpha=alpha,
            label=f"loops {verdict} ({len(loops)})",
        )
        ax.add_collection(lines)
