"""The last solve of a pose graph in space: on the distance of SE(3), which NavStates do not have.

Each edge is made anew where the last solve led, with value and derivative of its logarithm there,
until the sum of squares, which is then exact, falls no more. Gauss-Newton alone would not do: the
residuals of such graphs may be large, and its steps then lead away from the optimum.
"""

from __future__ import annotations

import logging
from typing import Any

import gtsam
import numpy as np

from gtsam_nav.graph import factors
from gtsam_nav.graph.least_squares import solve_batch
from gtsam_nav.graph.problem import Problem
from gtsam_nav.graph.refinement import Refined
from gtsam_nav.graph.sensor_posterior import sensor_posterior

log = logging.getLogger(__name__)

MAX_ROUNDS = 10
TOLERANCE = 1e-6
"""Of each solve: where residuals are large, a step comes nearer by but a share."""
LEAST_GAIN, LEAST_COST = 1e-5, 1e-6
"""Share of the cost, were it no less than this, that a round must take off for another one to
follow."""


def refine_exactly(graph: Any, values: Any, problem: Problem) -> tuple[Any, Refined]:
    """The graph with its edges as they are at the solution, and the solution.

    Parameters
    ----------
    graph : gtsam.NonlinearFactorGraph
        Begins with the problem's own factors in their order.
    values : gtsam.Values
        Solution on NavStates' distance.
    """
    graph = _made_at(values, graph, problem)
    cost, gain, rounds = graph.error(values), np.inf, 0
    while gain > LEAST_GAIN and rounds < MAX_ROUNDS:
        moved = solve_batch(graph, values, tolerance=TOLERANCE)
        there = _made_at(moved, graph, problem)
        gain = (cost - there.error(moved)) / max(cost, LEAST_COST)
        if gain > 0.0:
            graph, values, cost = there, moved, there.error(moved)
        rounds += 1
    log.info("exact edges: %d rounds", rounds)
    posterior = sensor_posterior(graph, values, np.empty(0, dtype=np.int64), problem)
    return graph, Refined(values, posterior, rounds, gain <= LEAST_GAIN)


def _made_at(values: Any, graph: Any, problem: Problem) -> Any:
    """A copy of the graph with the edges made anew."""
    place = {id(entry): n for n, entry in enumerate(problem.entries)}
    made = gtsam.NonlinearFactorGraph(graph)
    for entry, make in problem.exact:
        factor = factors.robust(make(values.atNavState), entry.robustness)
        made.replace(place[id(entry)], factor)
    return made
