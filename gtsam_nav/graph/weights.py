"""What the kernels and gates left of each sensor's measurements at the solution."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gtsam_nav.graph import factors
from gtsam_nav.graph.problem import Problem, SensorFactor
from gtsam_nav.graph.readings import Reading, made
from gtsam_nav.mission import Rejection
from gtsam_nav.solution import RobustWeights

WEIGHTLESS = 0.01
"""A measurement of which the kernel leaves a smaller share is as good as left out."""


@dataclass(frozen=True, slots=True)
class Weighed:
    """A measurement at the solution.

    Attributes
    ----------
    sensor, kind : str
        ``kind`` tells apart what one sensor measures.
    index : int
        As in `Rejection`; of what rests on many samples, its keyframe.
    kernel : str
    doubted : bool
        Whether it stands under a kernel or a gate.
    used : bool
        Whether the gate let it in.
    t, residual, weight : float
        Time, residual in standard deviations, and the share of its information that counts.
    """

    sensor: str
    kind: str
    index: int
    kernel: str
    doubted: bool
    used: bool
    t: float
    residual: float
    weight: float


def weighed(
    problem: Problem,
    matches: Sequence[tuple[float, SensorFactor]],
    used: Collection[Reading],
    values: Any,
) -> list[Weighed]:
    """All measurements that can be told from what is merely known beforehand.

    Parameters
    ----------
    matches : sequence of (float, SensorFactor)
        Scan matches with their times.
    used : collection of Reading
        Of the problem's readings, those that were believed.
    values : gtsam.Values
        The solution.
    """
    believed = {id(reading) for reading in used}
    rows = list(_of_entries(problem, matches, values))
    readings = problem.all_readings
    for reading, factor in zip(readings, made(readings, values.atNavState), strict=True):
        e, kernel = _norm(factor, values), reading.robustness.kernel
        is_used = id(reading) in believed
        rows.append(
            Weighed(
                reading.sensor,
                reading.reason,
                reading.index,
                kernel,
                reading.is_gated or kernel != "none",
                is_used,
                reading.t,
                e,
                factors.weight(reading.robustness, e) if is_used else 0.0,
            )
        )
    return rows


def _of_entries(
    problem: Problem, matches: Sequence[tuple[float, SensorFactor]], values: Any
) -> Iterator[Weighed]:
    timed = [
        (float(problem.t[k]), k, entry)
        for k, brought in enumerate(problem.factors)  # the IMU's have no kernel
        for entry in brought
    ]
    timed += [(t, -1, entry) for t, entry in matches]  # these have an index
    for t, k, entry in timed:
        kernel = entry.robustness.kernel
        if kernel == "none" and entry.index is None:
            continue
        e = _norm(entry.gaussian, values)
        weight = factors.weight(entry.robustness, e)
        index = k if entry.index is None else entry.index
        yield Weighed(entry.sensor, "", index, kernel, kernel != "none", True, t, e, weight)


def _norm(factor: Any, values: Any) -> float:
    e = factor.whitenedError(values)
    return math.sqrt(e @ e)


def robust_weights(rows: Sequence[Weighed]) -> dict[str, RobustWeights]:
    """Weights by sensor of all that stands under a kernel or a gate."""
    by_sensor: dict[str, list[Weighed]] = {}
    for row in rows:
        if row.doubted:
            by_sensor.setdefault(row.sensor, []).append(row)
    weights = {}
    for sensor, own in by_sensor.items():
        t, residual, weight = np.array([(row.t, row.residual, row.weight) for row in own]).T
        order = np.argsort(t, kind="stable")
        kernels = ", ".join(dict.fromkeys(row.kernel for row in own))
        weights[sensor] = RobustWeights(kernels, t[order], residual[order], weight[order])
    return weights


def weightless(rows: Sequence[Weighed]) -> Iterator[Rejection]:
    """What passed its gate, or has none, and was then left next to nothing by its kernel."""
    for row in rows:
        if row.used and row.weight < WEIGHTLESS:
            reason = f"no weight under its kernel ({row.kernel})"
            yield Rejection(row.t, row.sensor, row.index, reason, row.residual)
