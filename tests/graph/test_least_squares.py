"""The batch solve: undamped where that leads down, damped where it does not."""

from __future__ import annotations

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import X

from gtsam_nav.errors import EstimationError
from gtsam_nav.frames import rotation_from_rpy
from gtsam_nav.graph import factors
from gtsam_nav.graph.factors import nav_state
from gtsam_nav.graph.least_squares import solve_batch

ORIGIN = np.zeros(3)


def states(*places_m: float) -> gtsam.Values:
    values = gtsam.Values()
    for k, place_m in enumerate(places_m):
        factors.insert(values, X(k), nav_state(np.eye(3), np.array([place_m, 0, 0]), ORIGIN))
    return values


def held_still(*, n: int, at_m: float = 0.0) -> gtsam.NonlinearFactorGraph:
    graph = gtsam.NonlinearFactorGraph()
    held = nav_state(np.eye(3), np.array([at_m, 0, 0]), ORIGIN)
    for k in range(n):
        graph.add(factors.start_prior(X(k), held, np.eye(3), np.ones(3), np.ones(3), 1.0))
    return graph


def test_without_kernels_two_steps_are_the_optimum() -> None:
    solved = solve_batch(held_still(n=3, at_m=2.0), states(0.0, 7.0, -50.0))
    for k in range(3):
        np.testing.assert_allclose(solved.atNavState(X(k)).position(), [2.0, 0, 0], atol=1e-9)


def test_where_an_undamped_step_leads_up_a_damped_one_leads_down() -> None:
    """An arm turns towards a fix far beyond its reach: Gauss-Newton turns it round several times.

    The cost is least where it points there, at half the square of the distance left.
    """
    start, held = gtsam.Values(), np.full(3, 1e-3)
    factors.insert(start, X(0), nav_state(rotation_from_rpy([0.0, 0.0, 1.0]), ORIGIN, ORIGIN))
    graph, upright = gtsam.NonlinearFactorGraph(), nav_state(np.eye(3), ORIGIN, ORIGIN)
    graph.add(factors.start_prior(X(0), upright, np.eye(3), np.full(3, 1e3), held, 1.0))
    graph.add(factors.gnss(X(0), np.array([20.0, 0, 0]), np.array([1.0, 0, 0]), np.ones(3)))
    undamped = gtsam.GaussNewtonOptimizer(graph, start)
    undamped.iterate()
    assert undamped.error() > graph.error(start)
    assert graph.error(solve_batch(graph, start)) == pytest.approx(0.5 * 19.0**2, rel=1e-3)


def test_what_does_not_fall_to_a_finite_cost_is_refused() -> None:
    with pytest.raises(EstimationError, match=r"diverged|failed"):
        solve_batch(held_still(n=1, at_m=np.nan), states(0.0))
