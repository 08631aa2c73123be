"""The growing graph: iSAM2 as the mission is read, and covariances once it is known."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeVar

import gtsam
import numpy as np

from gtsam_nav.errors import EstimationError
from gtsam_nav.frames import Array
from gtsam_nav.graph import factors
from gtsam_nav.graph.factors import B, X
from gtsam_nav.graph.problem import Problem, SensorFactor
from gtsam_nav.graph.readings import Reading, StateAt, made
from gtsam_nav.graph.robust import Robustness
from gtsam_nav.graph.scan_matching import PlanarPose

log = logging.getLogger(__name__)

T = TypeVar("T")

RELINEARIZE_TURN_RAD, RELINEARIZE_MOVE = 0.05, 0.5
"""iSAM2 linearises a state anew once it has turned so far, or moved (m, m/s): residuals bend with
turns, and are all but straight in positions."""
RELINEARIZE_BIAS = 0.05
RELINEARIZE_EVERY = 10
"""Updates after which all states are solved for, and looked at for that: it takes as long as the
mission is. Between them the latest ones are told by their marginals."""
JUMP = np.repeat([0.15, 1.5], 3)
"""Where the latest state has turned (rad) or moved (m) so far from its prediction, all states are
looked at next."""
LEAST_CHANGE = 0.01
"""iSAM2 follows a change of its estimate (m, m/s, rad) backward in time until it is smaller: the
latest states are solved for in any case."""
MOST_FRESH_STARTS = 10
"""Cholesky may find a system indeterminate that it solves in another order of elimination; each
fresh start takes as long as the mission is by then."""
DOUBTED = Robustness(kernel="cauchy")
"""Of readings that may be outliers: while they come in, none is judged for good."""


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
        self.problem = problem
        self._by_qr, self._fresh_starts = problem.is_stiff, 0
        self._isam = _isam2(self._by_qr)
        # a pose graph's closures bend it as a whole
        self._bends = self._has_jumped = problem.is_pose_graph
        self._new_factors = gtsam.NonlinearFactorGraph()
        self._new_values = gtsam.Values()
        self._new_readings: list[Reading] = []
        self._last_state: Any = None
        self._last_bias: Any = problem.bias

    def add_keyframe(self, k: int) -> None:
        """Queue keyframe k, predicted from the one before, with all that it brings."""
        if k == 0:
            state = self.problem.initial_state(0)
            for hint in self.problem.hints:
                self._new_factors.add(hint)
        else:
            self.problem.set_gravity(k, self._last_state)
            self.problem.integrate_at(k, self._last_bias)
            state = self.problem.predicted(k, self._last_state, self._last_bias)
        factors.insert(self._new_values, X(k), state)
        self._last_state = state
        for key, first in self.problem.variables[k]:
            # what is known of the bias already need not be linearised anew
            value = self._last_bias if key == B(k) else first(self._state_at)
            factors.insert(self._new_values, key, value)
        for entry in self.problem.brought(k):
            self.add_factor(entry)
        self._new_readings += self.problem.readings[k]

    def _state_at(self, key: int) -> Any:
        if self._new_values.exists(key):
            return self._new_values.atNavState(key)
        return self._nav_state(key)

    def _linearised_at(self, key: int) -> Any:
        """Where iSAM2 linearises a state that a reading is of: GTSAM's own factors are made so."""
        new = self._new_values.exists(key)
        return (self._new_values if new else self._isam.getLinearizationPoint()).atNavState(key)

    def add_factor(self, entry: SensorFactor) -> None:
        """Queue one factor."""
        self._new_factors.add(entry.at_first)

    def update(self) -> None:
        """Let iSAM2 take in what is queued."""
        readings, self._new_readings = self._new_readings, []
        self._new_factors.push_back(at_first(readings, self._linearised_at))
        anew, self._has_jumped = self._has_jumped, self._bends
        try:
            self._isam.update(self._new_factors, self._new_values, force_relinearize=anew)
        except RuntimeError as error:
            self._begin_anew(error)
        self._new_factors = gtsam.NonlinearFactorGraph()
        self._new_values = gtsam.Values()

    def _begin_anew(self, failure: RuntimeError) -> None:
        """Solve all that iSAM2 was given, the update it failed at included, in the order that suits
        it now; by QR from here on where that fails too, or was done too often."""
        failed, self._fresh_starts = self._isam, self._fresh_starts + 1
        for by_qr in (False, True) if self._fresh_starts <= MOST_FRESH_STARTS else (True,):
            if self._by_qr:
                break
            log.info("iSAM2 begins anew%s: %s", " by QR" * by_qr, first_lines(failure))
            self._isam, self._by_qr = _isam2(by_qr), by_qr
            try:
                self._isam.update(failed.getFactorsUnsafe(), failed.getLinearizationPoint())
            except RuntimeError as error:
                failure = error
            else:
                return
        raise EstimationError(f"iSAM2 failed: {first_lines(failure)}") from failure

    def _asked(self, question: Callable[[Any], T]) -> T:
        """iSAM2's answer, after a fresh start where it has none."""
        try:
            return question(self._isam)
        except RuntimeError as error:
            self._begin_anew(error)
            return self._asked(question)

    def latest(self, k: int) -> tuple[Any, Array]:
        """Current estimate of keyframe k, from which the next one is predicted, and its covariance
        (9, 9) in its tangent space."""
        key = X(k)
        marginal = self._marginal(key)
        self._last_state = self._by_marginal(key, marginal)
        begun = self._isam.getLinearizationPoint().atNavState(key)
        step = begun.localCoordinates(self._last_state)[:6]
        self._has_jumped |= bool((np.abs(step) > JUMP).any())
        if self.problem.uses_imu:
            self._last_bias = self._bias(B(k))
        if marginal is not None:
            return self._last_state, np.linalg.inv(marginal.information())
        return self._last_state, np.asarray(self._asked(lambda isam: isam.marginalCovariance(key)))

    def peek(self, k: int) -> Any:
        """Current estimate of any keyframe, without predicting from it."""
        return self._isam.calculateEstimateNavState(X(k))

    def _nav_state(self, key: int) -> Any:
        """Current estimate of one state: to solve for all of them takes as long as the mission."""
        return self._by_marginal(key, self._marginal(key))

    def _by_marginal(self, key: int, marginal: Any) -> Any:
        if marginal is None:
            return self._isam.calculateEstimateNavState(key)
        begun = self._isam.getLinearizationPoint().atNavState(key)
        return begun.retract(marginal.solve(gtsam.VectorValues()).at(key))

    def _bias(self, key: int) -> Any:
        """The same of an IMU's bias."""
        marginal = self._marginal(key)
        if marginal is None:
            return self._isam.calculateEstimateConstantBias(key)
        begun = self._isam.getLinearizationPoint().atConstantBias(key)
        return begun.retract(marginal.solve(gtsam.VectorValues()).at(key))

    def _marginal(self, key: int) -> Any:
        """A state's marginal, about where it was linearised; by Cholesky or not at all."""
        if self._by_qr:
            return None
        try:
            return self._isam.marginalFactor(key)
        except RuntimeError:
            return None

    def joint_planar_covariances(self, earlier: list[int], b: int) -> list[Array]:
        """Covariances (6, 6) of (dn, de, dyaw) of each of some keyframes and of keyframe b."""
        keys = [X(k) for k in (*earlier, b)]
        marginal = self._asked(lambda isam: isam.jointMarginalCovariance(keys))
        S = {k: planar_rows(self.peek(k).attitude().matrix()) for k in (*earlier, b)}

        def block(k: int, m: int) -> Array:
            return np.asarray(S[k] @ marginal.at(X(k), X(m)) @ S[m].T)

        return [np.block([[block(k, m) for m in (a, b)] for k in (a, b)]) for a in earlier]

    def values(self) -> Any:
        """Current estimate of everything."""
        return self._isam.calculateEstimate()


def graph_of(entries: Iterable[SensorFactor]) -> Any:
    """Factors under their kernels as a graph."""
    graph = gtsam.NonlinearFactorGraph()
    for entry in entries:
        graph.add(entry.factor)
    return graph


def at_first(readings: Sequence[Reading], state_at: StateAt) -> Any:
    """The factors of readings at present states, under the kernels that they have at first."""
    graph = gtsam.NonlinearFactorGraph()
    for reading, factor in zip(readings, made(readings, state_at), strict=True):
        robustness = DOUBTED if reading.is_gated else reading.robustness.at_first
        graph.add(factors.robust(factor, robustness))
    return graph


def first_lines(error: RuntimeError) -> str:
    """What GTSAM says, less its explanations."""
    return " ".join(str(error).strip().split("\n\n")[0].split())


def _isam2(is_stiff: bool) -> Any:
    parameters = gtsam.ISAM2Params()
    thresholds = gtsam.ISAM2ThresholdMap()
    for kind in "xmgls":
        thresholds.insert((kind, np.repeat([RELINEARIZE_TURN_RAD, RELINEARIZE_MOVE], [3, 6])))
    thresholds.insert(("b", np.full(6, RELINEARIZE_BIAS)))
    parameters.setRelinearizeThreshold(thresholds)
    parameters.relinearizeSkip = 1 if is_stiff else RELINEARIZE_EVERY
    parameters.setOptimizationParams(gtsam.ISAM2GaussNewtonParams(LEAST_CHANGE))
    if is_stiff:
        parameters.setFactorization("QR")
    return gtsam.ISAM2(parameters)


class Covariances:
    """Marginal covariances of a graph's variables, by QR where Cholesky gives up on any of them.

    Parameters
    ----------
    graph : gtsam.NonlinearFactorGraph
    values : gtsam.Values
        Where to linearise.
    is_stiff : bool
        Whether to go by QR at once.
    """

    def __init__(self, graph: Any, values: Any, is_stiff: bool = False) -> None:
        self._graph, self._values = graph, values
        self._by_qr: Any = None
        self._by_cholesky: Any = None
        if not is_stiff:
            try:
                self._by_cholesky = gtsam.Marginals(graph, values)
            except RuntimeError:
                self._by_cholesky = None

    def joint(self, keys: list[int]) -> Array:
        """Joint covariance of some variables, in their order.

        Raises
        ------
        EstimationError
            Where the graph does not determine its variables.
        """
        if self._by_cholesky is not None:
            try:
                return _joint(self._by_cholesky, keys)
            except RuntimeError:
                self._by_cholesky = None
        try:
            if self._by_qr is None:
                self._by_qr = _isam2(is_stiff=True)
                self._by_qr.update(self._graph, self._values)
            return _joint(self._by_qr, keys)
        except RuntimeError as error:
            raise EstimationError(f"no covariance: {first_lines(error)}") from error


def _joint(marginals: Any, keys: list[int]) -> Array:
    if len(keys) == 1:
        return np.asarray(marginals.marginalCovariance(keys[0]))
    joint = marginals.jointMarginalCovariance(keys)
    return np.block([[joint.at(a, b) for b in keys] for a in keys])
