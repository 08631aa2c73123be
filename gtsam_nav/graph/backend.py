"""The growing graph: iSAM2 as the mission is read, batch once it is known."""

from __future__ import annotations

from typing import Any

import gtsam
import numpy as np

from gtsam_nav.errors import EstimationError
from gtsam_nav.frames import Array
from gtsam_nav.graph.factors import X
from gtsam_nav.graph.problem import Problem, SensorFactor
from gtsam_nav.graph.scan_matching import PlanarPose

RELINEARIZE_THRESHOLD = 0.05


def planar_rows(R_nb: Array) -> Array:
    """Map a NavState tangent (theta_b, rho_b, nu_b) to (dn, de, dyaw), shape (3, 9)."""
    S = np.zeros((3, 9))
    S[:2, 3:6] = R_nb[:2]
    S[2, :3] = R_nb[2]
    return S


def planar_pose(state: Any, cov: Array) -> PlanarPose:
    """Planar part of a NavState with its tangent covariance (9, 9)."""
    R_nb = state.attitude().matrix()
    S = planar_rows(R_nb)
    yaw = float(np.arctan2(R_nb[1, 0], R_nb[0, 0]))
    return PlanarPose(state.position()[:2], yaw, S @ cov @ S.T)


class Backend:
    """Incremental estimate of a problem's keyframes.

    Parameters
    ----------
    problem : Problem
    """

    def __init__(self, problem: Problem) -> None:
        parameters = gtsam.ISAM2Params()
        parameters.setRelinearizeThreshold(RELINEARIZE_THRESHOLD)
        parameters.relinearizeSkip = 1
        self.problem = problem
        self.entries: list[SensorFactor] = []
        self._isam = gtsam.ISAM2(parameters)
        self._new_factors = gtsam.NonlinearFactorGraph()
        self._new_values = gtsam.Values()
        self._last_state: Any = None

    def add_keyframe(self, k: int) -> None:
        """Queue keyframe k, predicted from the one before by the vehicle's own motion."""
        if k == 0:
            state = self.problem.initial_state(0)
        else:
            R_ab, p_a = self.problem.increment(k - 1, k)
            before = self._last_state
            R_nb = before.attitude().matrix() @ R_ab
            p_n = before.position() + before.attitude().matrix() @ p_a
            own = self.problem.initial_state(k)
            v_b = own.attitude().matrix().T @ own.velocity()
            state = gtsam.NavState(gtsam.Rot3(R_nb), p_n, R_nb @ v_b)
        self._new_values.insert(X(k), state)
        self._last_state = state
        for key, value in self.problem.new_values(k):
            self._new_values.insert(key, value)
        for entry in self.problem.factors[k]:
            self.add_factor(entry)

    def add_factor(self, entry: SensorFactor) -> None:
        """Queue one factor."""
        self.entries.append(entry)
        self._new_factors.add(entry.factor)

    def update(self) -> None:
        """Let iSAM2 take in what is queued."""
        try:
            self._isam.update(self._new_factors, self._new_values)
        except RuntimeError as error:
            raise EstimationError(f"iSAM2 failed: {str(error).strip().splitlines()[0]}") from error
        self._new_factors = gtsam.NonlinearFactorGraph()
        self._new_values = gtsam.Values()

    def state(self, k: int) -> Any:
        """Current estimate of keyframe k, from which the next one is predicted."""
        self._last_state = self._isam.calculateEstimateNavState(X(k))
        return self._last_state

    def peek(self, k: int) -> Any:
        """Current estimate of any keyframe, without predicting from it."""
        return self._isam.calculateEstimateNavState(X(k))

    def covariance(self, k: int) -> Array:
        """Marginal covariance (9, 9) of keyframe k in its tangent space."""
        return np.asarray(self._isam.marginalCovariance(X(k)))

    def joint_planar_covariance(self, a: int, b: int) -> Array:
        """Covariance (6, 6) of (dn, de, dyaw) of two keyframes."""
        marginal = self._isam.jointMarginalCovariance([X(a), X(b)])
        joint = np.block([[marginal.at(X(i), X(j)) for j in (a, b)] for i in (a, b)])
        S = np.zeros((6, 18))
        S[:3, :9] = planar_rows(self._isam.calculateEstimateNavState(X(a)).attitude().matrix())
        S[3:, 9:] = planar_rows(self._isam.calculateEstimateNavState(X(b)).attitude().matrix())
        return np.asarray(S @ joint @ S.T)

    def values(self) -> Any:
        """Current estimate of everything."""
        return self._isam.calculateEstimate()

    def graph(self, without: str | None = None) -> Any:
        """All factors so far, or all but those of one sensor."""
        graph = gtsam.NonlinearFactorGraph()
        for entry in self.entries:
            if entry.sensor != without:
                graph.add(entry.factor)
        return graph


def solve_batch(graph: Any, values: Any) -> Any:
    """Levenberg-Marquardt to convergence.

    Raises
    ------
    EstimationError
        Where the system is indeterminate or the result is not finite.
    """
    try:
        result = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    except RuntimeError as error:
        raise EstimationError(f"the batch solve failed: {str(error).strip()[:200]}") from error
    if not np.isfinite(graph.error(result)):
        raise EstimationError("the batch solve diverged")
    return result
