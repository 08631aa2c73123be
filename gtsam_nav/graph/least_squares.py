"""The batch solve: Gauss-Newton while it lowers the cost, Levenberg-Marquardt from where it fails.

The steps of the one are those of the other that are not damped, which cost it more to make.
"""

from __future__ import annotations

from typing import Any

import gtsam
import numpy as np

from gtsam_nav.errors import EstimationError
from gtsam_nav.graph.backend import first_lines

TOLERANCE = 1e-5
"""Share of the cost: a step that takes less off was the last."""
LEAST_GAIN = 5e-3
"""So was one that takes no more off as such: it moved nothing by a tenth of its sigma, and of
Gauss-Newton's steps each leaves far less than it took."""
MOST_STEPS = 100


def solve_batch(
    graph: Any, values: Any, is_stiff: bool = False, tolerance: float = TOLERANCE
) -> Any:
    """Least squares to convergence.

    Parameters
    ----------
    graph : gtsam.NonlinearFactorGraph
    values : gtsam.Values
        Start.
    is_stiff : bool
        Solve by QR at once; else only where Cholesky gives up.
    tolerance : float
        Share of the cost that is worth another step.

    Raises
    ------
    EstimationError
        Where the system is indeterminate or the result is not finite.
    """
    try:
        values, is_done = _gauss_newton(graph, values, _solver(is_stiff), tolerance)
    except RuntimeError:  # damped, or by QR, the system may be determined
        is_done = False
    if not is_done:
        values = _levenberg_marquardt(graph, values, is_stiff, tolerance)
    if not np.isfinite(graph.error(values)):
        raise EstimationError("the batch solve diverged")
    return values


def _solver(is_stiff: bool) -> str:
    return "MULTIFRONTAL_QR" if is_stiff else "MULTIFRONTAL_CHOLESKY"


def _gauss_newton(graph: Any, values: Any, solver: str, tolerance: float) -> tuple[Any, bool]:
    """The values of least cost on the way, and whether the cost fell until little was left."""
    parameters = gtsam.GaussNewtonParams()
    parameters.setLinearSolverType(solver)
    optimizer = gtsam.GaussNewtonOptimizer(graph, values, parameters)
    cost = optimizer.error()
    for _ in range(MOST_STEPS):
        optimizer.iterate()
        gain, least = cost - optimizer.error(), max(LEAST_GAIN, tolerance * cost)
        if gain > 0.0:
            # a copy: the optimizer's own die with its next step
            values, cost = gtsam.Values(optimizer.values()), optimizer.error()
        if abs(gain) <= least:
            return values, True
        if not gain > 0.0:
            return values, False
    return values, False


def _levenberg_marquardt(graph: Any, values: Any, is_stiff: bool, tolerance: float) -> Any:
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setLinearSolverType(_solver(is_stiff))
    parameters.setRelativeErrorTol(tolerance)
    try:
        return gtsam.LevenbergMarquardtOptimizer(graph, values, parameters).optimize()
    except RuntimeError as error:
        if not is_stiff:
            return _levenberg_marquardt(graph, values, True, tolerance)
        raise EstimationError(f"the batch solve failed: {first_lines(error)}") from error
