"""The charts' data: what is drawn against time beside the plan."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from gtsam_nav.evaluation.histories import (
    compass_readings,
    error_history,
    for_people,
    heading_baseline,
    line_starts,
    reference_heading,
    slow_names,
)
from gtsam_nav.evaluation.page.columns import TIME_S, Document, every_nth, packed
from gtsam_nav.frames import Array
from gtsam_nav.solution import Solution

MOST_SAMPLES = 6000
"""Of a line; a screen is not wider."""
STEPS_OF_RANGE = 20_000
"""A chart's values are rounded to its range, band included, over this many."""
LEAST_SHARE = 1e-6
"""Of its values: finer changes are rounding."""


def charts_document(solutions: Sequence[Solution]) -> list[Document]:
    """Charts in the order in which they stand; a chart without data is left out."""
    charts = [_horizontal_errors(solutions), _headings(solutions)]
    for solution in solutions:
        charts += [*_position_errors(solution), *_slow_states(solution)]
    return [chart for chart in charts if chart["lines"]]


def _chart(title: str, unit: str, lines: Sequence[Document], from_zero: bool = False) -> Document:
    return {"title": title, "unit": unit, "from_zero": from_zero, "lines": list(lines)}


def _line(
    name: str, t: Array, values: Array, sigma: Array | None = None, method: str | None = None
) -> Document:
    """A line in its method's colour; one of no method is drawn as grey dots."""
    which = every_nth(len(t), MOST_SAMPLES)
    t, values = t[which], values[which]
    sigma = None if sigma is None else sigma[which]
    step = _step(values, sigma)
    line = {
        "name": name,
        "method": method,
        "starts": line_starts(t).tolist(),
        "t": packed(t, TIME_S),
        "values": packed(values, step),
    }
    if sigma is not None:
        line["three_sigma"] = packed(3.0 * sigma, step)
    return line


def _step(values: Array, sigma: Array | None) -> float:
    """What a line's values are rounded to."""
    if not len(values):
        return 1.0
    least = max(LEAST_SHARE * float(np.max(np.abs(values))), 1e-9)
    band = 0.0 if sigma is None else 3.0 * float(np.max(sigma))
    return max(float(np.ptp(values)), band, least) / STEPS_OF_RANGE


def _horizontal_errors(solutions: Sequence[Solution]) -> Document:
    lines = [
        _line(s.method + found.note, found.t, found.error_m[:, 2], method=s.method)
        for s in solutions
        if (found := error_history(s)) is not None
    ]
    return _chart("Horizontal error", "m", lines, from_zero=True)


def _position_errors(solution: Solution) -> Iterator[Document]:
    """North and east with three sigma of estimate and reference together."""
    found = error_history(solution)
    for axis, name in enumerate(("north", "east") if found else ()):
        assert found is not None
        sigma = None if found.sigma_m is None else found.sigma_m[:, axis]
        line = _line(f"error{found.note}", found.t, found.error_m[:, axis], sigma, solution.method)
        yield _chart(f"{solution.method}: error {name}", "m", [{**line, "band_about_zero": True}])


def _headings(solutions: Sequence[Solution]) -> Document:
    """Heading of each method and of the compass, less the reference's or the foremost's."""
    baseline, others = heading_baseline(solutions)
    compass = compass_readings(solutions[0].mission)
    lines = [] if compass is None else [_line("compass", *baseline.less(*compass))]
    lines += [
        _line(s.method, *baseline.less(s.trajectory.t, s.trajectory.yaw), method=s.method)
        for s in others
    ]
    return _chart(f"Heading less {baseline.name}'s", "deg", lines)


def _slow_states(solution: Solution) -> Iterator[Document]:
    """Each bias with three sigma; behind the compass's its true error, where that is known."""
    slow = solution.slow_states
    truth, compass = reference_heading(solution), compass_readings(solution.mission)
    for name in slow_names(solution):
        assert slow is not None
        quantity, unit, factor = for_people(name)
        values, sigmas = slow.columns[name]
        lines = []
        if name == "heading_bias_rad" and truth is not None and compass is not None:
            lines.append(_line("compass", *truth.less(*compass)))
        lines.append(_line("estimate", slow.t, factor * values, factor * sigmas, solution.method))
        yield _chart(f"{solution.method}: {quantity}", unit, lines)
