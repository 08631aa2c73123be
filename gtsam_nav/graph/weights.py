"""What the kernels and gates left of each sensor's measurements at the solution."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from typing import Any

import numpy as np

from gtsam_nav.graph import factors
from gtsam_nav.graph.problem import Problem, Reading, SensorFactor
from gtsam_nav.solution import RobustWeights

FEWEST, CONTRADICTION = 20, 3.0
"""So many measurements whose median lies at so many standard deviations are not merely noisy."""

_Weighed = tuple[str, str, float, float, float]
"""Sensor, kernel, time, normalised residual and weight."""


def robust_weights(
    problem: Problem,
    matches: Sequence[tuple[float, SensorFactor]],
    used: Collection[Reading],
    values: Any,
) -> dict[str, RobustWeights]:
    """Weights by sensor of all that stands under a kernel or a gate.

    Parameters
    ----------
    matches : sequence of (float, SensorFactor)
        Scan matches with their times.
    used : collection of Reading
        Of the problem's readings, those that were believed.
    values : gtsam.Values
        The solution.
    """
    rows: dict[str, list[_Weighed]] = {}
    for row in _all_weighed(problem, matches, {id(reading) for reading in used}, values):
        rows.setdefault(row[0], []).append(row)
    weights = {}
    for sensor, own in rows.items():
        t, residual, weight = np.array([row[2:] for row in own]).T
        order = np.argsort(t, kind="stable")
        kernels = ", ".join(dict.fromkeys(row[1] for row in own))
        weights[sensor] = RobustWeights(kernels, t[order], residual[order], weight[order])
    return weights


def _all_weighed(
    problem: Problem,
    matches: Sequence[tuple[float, SensorFactor]],
    used: set[int],
    values: Any,
) -> Iterator[_Weighed]:
    entries = [
        (float(problem.t[k]), entry)
        for k, brought in enumerate(problem.factors)
        for entry in brought
    ]
    for t, entry in (*entries, *matches):
        if entry.robustness.kernel != "none":
            e, weight = _norm(entry.gaussian, values), entry.weight_at(values)
            yield entry.sensor, entry.robustness.kernel, t, e, weight
    for brought in problem.readings:
        for reading in brought:
            if reading.is_gated or reading.robustness.kernel != "none":
                e = _norm(reading.make(values.atNavState), values)
                weight = factors.weight(reading.robustness, e) if id(reading) in used else 0.0
                yield reading.sensor, reading.robustness.kernel, reading.t, e, weight


def _norm(factor: Any, values: Any) -> float:
    return float(np.linalg.norm(factor.whitenedError(values)))


def contradictions(weights: dict[str, RobustWeights]) -> Iterator[str]:
    """Warnings of sensors that most of the time say something else than the solution."""
    for sensor, own in weights.items():
        if len(own.t) < FEWEST:
            continue
        rejected, median = int(np.sum(own.weight == 0.0)), float(np.median(own.residual))
        if 2 * rejected > len(own.t):
            yield (
                f"'{sensor}' and the other sensors contradict each other: {rejected} of"
                f" {len(own.t)} measurements were left out"
            )
        elif median > CONTRADICTION:
            yield (
                f"'{sensor}' and the other sensors contradict each other: half of its residuals"
                f" are above {median:.1f} standard deviations"
            )
