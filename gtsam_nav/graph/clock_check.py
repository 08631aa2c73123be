"""Whether a receiver's fixes, whose clock nobody doubts, seem late or early all the same.

One Gauss-Newton step of what `clocks` does where a mission asks for it: a constant timing error a
receiver, beside all states, from nothing known of it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy
from typing import Any

import numpy as np

from gtsam_nav.graph.backend import graph_of
from gtsam_nav.graph.problem import Problem
from gtsam_nav.graph.sensor_posterior import sensor_posterior
from gtsam_nav.graph.settling import Settled
from gtsam_nav.graph.timing import TimingError, timing_effect
from gtsam_nav.graph.weights import Weighed
from gtsam_nav.mission import Mission

UNKNOWN_S = 10.0
"""Spread of a timing error of which nothing is known."""
SUSPECT_SIGMAS, SUSPECT_S = 4.0, 0.1
"""A timing error that is smaller is not spoken of."""
CHI_MEDIAN_3_DOF = 1.538
"""Of the residuals of fixes that are as good as they say."""


def suspected_clocks(
    mission: Mission, problem: Problem, settled: Settled, values: Any, rows: Sequence[Weighed]
) -> Iterator[str]:
    """A warning for each receiver whose fixes seem to be off in time.

    Parameters
    ----------
    problem : Problem
        That estimates no timing errors.
    values : gtsam.Values
        The solution.
    rows : sequence of Weighed
        All measurements there: the sigmas grow with how badly a receiver's own fit.
    """
    receivers = [sensor.name for sensor in mission.of_type("gnss")]
    if not receivers or problem.timing is not None:
        return
    errors = tuple(TimingError(name, "gnss", "time_offset", UNKNOWN_S) for name in receivers)
    doubting = copy(problem)
    doubting.timing = timing_effect(
        problem, errors, np.zeros(len(errors)), settled.used_factors, values
    )
    graph = graph_of(problem.entries)
    graph.push_back(settled.factors)
    found = sensor_posterior(graph, values, np.empty(0, dtype=np.int64), doubting).constants
    offsets, sigmas = (of[-len(errors) :] for of in (found.mean, np.sqrt(np.diag(found.cov))))
    for name, offset_s, sigma_s in zip(receivers, offsets, sigmas, strict=True):
        own = [row.residual for row in rows if row.sensor == name and row.used]
        sigma_s *= max(1.0, float(np.median(own or [0.0])) / CHI_MEDIAN_3_DOF)
        if abs(offset_s) > max(SUSPECT_S, SUSPECT_SIGMAS * sigma_s):
            yield (
                f"'{name}' seems to be {abs(offset_s):.2f} s {'late' if offset_s < 0 else 'early'}"
                f" (sigma {sigma_s:.2f} s): its card may say time_offset: {{estimate: true}}"
            )
