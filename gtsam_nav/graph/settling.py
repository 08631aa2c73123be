"""Which readings to believe: a robust start, then rejection and re-admission until nothing changes.

A reading is judged by what all others say of it: its residual, free of its own pull, against its
noise and their uncertainty together. For a whitened residual e and the whitened covariance M of
its prediction, with weight w in the solution, that is chi-square distributed as

``e' (I - w M)^-1 (I + M (I - w M)^-1)^-1 (I - w M)^-1 e``,

``e' (I - M)^-1 e`` where it was used and ``e' (I + M)^-1 e`` where it was not: one test for
rejection and for re-admission.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import gtsam
import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.graph import factors
from gtsam_nav.graph.backend import Covariances, solve_batch
from gtsam_nav.graph.factors import X
from gtsam_nav.graph.problem import Problem, Reading, SensorFactor
from gtsam_nav.graph.robust import CUTTING, Robustness
from gtsam_nav.mission import Rejection
from gtsam_nav.sensors.prediction import chi2_limit
from gtsam_nav.series import BoolArray

log = logging.getLogger(__name__)

START = Robustness(kernel="cauchy")
"""Of doubted readings in the robust start's last solve: gated ones, and those whose kernel cuts."""
TRUSTED = ("velocity",)
"""Least squares in the robust start: where the vehicle's motion may break, outliers break it."""
NARROWING = 4.0
"""By which the kernel's scale shrinks from one solve of the robust start to the next."""
MAX_ROUNDS = 12
STILL_M = 1e-3
"""Readings are made anew until no keyframe moves further."""
CLEAR_SHARE = 0.3
"""A reading in use whose residual alone stays below this share of its limit passes unexamined."""
LEAST_OWN_SHARE = 1e-3
"""A prediction that rests on the reading itself by more than all but this share says nothing."""


@dataclass(frozen=True)
class Settled:
    """Solution of the batch, and what became of its readings.

    Attributes
    ----------
    values : gtsam.Values
    used : tuple of Reading
    factors : gtsam.NonlinearFactorGraph
        Of the used readings, as they are at the solution.
    rejections : tuple of Rejection
    settled : bool
        Whether the rounds ended because nothing changed any more.
    """

    values: Any
    used: tuple[Reading, ...]
    factors: Any
    rejections: tuple[Rejection, ...]
    settled: bool

    @property
    def used_factors(self) -> tuple[tuple[Reading, Any], ...]:
        """The used readings, each with its factor."""
        made = [self.factors.at(i) for i in range(self.factors.size())]
        return tuple(zip(self.used, made, strict=True))


def settle(problem: Problem, entries: Sequence[SensorFactor], values: Any) -> Settled:
    """Solve a problem's batch with its readings, leaving out what is an outlier.

    Parameters
    ----------
    entries : sequence of SensorFactor
        Everything but the readings.
    values : gtsam.Values
        Start.
    """
    estimate, used = _Batch(problem, entries, at_first=True).robust_start(values)
    batch = _Batch(problem, entries)
    changed, rounds = True, 0
    while changed and rounds < MAX_ROUNDS:
        estimate = batch.solved(estimate, used)
        squared = batch.judged(estimate, batch.weights(estimate, used))
        verdict = ~batch.gated | (squared <= batch.limit)
        changed, used = bool(np.any(verdict != used)), verdict
        rounds += 1
        log.info("round %d: %d of %d readings rejected", rounds, np.sum(~used), len(used))
    readings = batch.readings
    return Settled(
        values=estimate.values,
        used=tuple(reading for reading, keep in zip(readings, used, strict=True) if keep),
        factors=batch.factors(estimate, used),
        rejections=tuple(
            readings[i].rejection(float(np.sqrt(squared[i]))) for i in np.flatnonzero(~used)
        ),
        settled=not changed,
    )


@dataclass(frozen=True)
class _Estimate:
    """Values, and the readings' Gaussian factors as they are there."""

    values: Any
    made: list[Any]

    @property
    def squared(self) -> Array:
        """Squared whitened residuals of the readings."""
        return np.array([float(np.sum(f.whitenedError(self.values) ** 2)) for f in self.made])


class _Batch:
    """A problem with all of its readings; ``at_first`` under the kernels of a robust start."""

    def __init__(
        self, problem: Problem, entries: Sequence[SensorFactor], *, at_first: bool = False
    ) -> None:
        self.problem = problem
        self.graph = gtsam.NonlinearFactorGraph()
        for entry in entries:
            start = entry.gaussian if entry.sensor in TRUSTED else entry.at_first
            self.graph.push_back(start if at_first else entry.factor)
        self.readings = [reading for brought in problem.readings for reading in brought]
        self.gated = np.array([reading.is_gated for reading in self.readings], dtype=bool)
        cuts = np.array([r.robustness.kernel in CUTTING for r in self.readings], dtype=bool)
        self.doubted = self.gated | cuts
        self.limit = np.full(len(self.readings), np.inf)

    def at(self, values: Any) -> _Estimate:
        """The readings made anew at given values."""
        made = [reading.make(values.atNavState) for reading in self.readings]
        return _Estimate(values, made)

    def factors(
        self, estimate: _Estimate, used: BoolArray, doubted: Robustness | None = None
    ) -> Any:
        """Factors of used readings under their own kernels, or the doubted ones under another."""
        graph = gtsam.NonlinearFactorGraph()
        for i in np.flatnonzero(used).tolist():
            graph.push_back(factors.robust(estimate.made[i], self._robustness(i, doubted)))
        return graph

    def weights(
        self, estimate: _Estimate, used: BoolArray, doubted: Robustness | None = None
    ) -> Array:
        """Weight of each reading in such a solution: zero for what is not used."""
        norms = np.sqrt(estimate.squared).tolist()
        weights = [factors.weight(self._robustness(i, doubted), e) for i, e in enumerate(norms)]
        return np.asarray(used * np.array(weights))

    def _robustness(self, i: int, doubted: Robustness | None) -> Robustness:
        return doubted if doubted is not None and self.doubted[i] else self.readings[i].robustness

    def robust_start(self, values: Any) -> tuple[_Estimate, BoolArray]:
        """Solve under a Cauchy kernel that narrows from a width that lets every reading in.

        Returns
        -------
        estimate : _Estimate
        used : ndarray of bool
            Which readings pass their gates there.
        """
        estimate = self.at(values)
        everything = np.ones(len(self.readings), dtype=bool)
        scale = float(np.sqrt(np.max(estimate.squared[self.doubted], initial=0.0)))
        while True:
            scale = max(START.scale, scale / NARROWING)
            kernel = START.model_copy(update={"threshold": scale})
            estimate = self._solved_once(estimate, everything, kernel)
            if scale == START.scale:
                break
        weight = self.weights(estimate, everything, START)
        return estimate, ~self.gated | (self.judged(estimate, weight, START) <= self.limit)

    def solved(self, estimate: _Estimate, used: BoolArray) -> _Estimate:
        """Solve with Gaussian readings, made anew until that moves nothing any more."""
        moved, rounds = np.inf, 0
        while moved > STILL_M and rounds < MAX_ROUNDS:
            before = self._positions(estimate.values)
            estimate = self._solved_once(estimate, used)
            moved = float(np.max(np.abs(self._positions(estimate.values) - before)))
            rounds += 1
        return estimate

    def _solved_once(
        self, estimate: _Estimate, used: BoolArray, doubted: Robustness | None = None
    ) -> _Estimate:
        for k in range(1, len(self.problem.t)):
            self.problem.set_gravity(k, estimate.values.atNavState(X(k - 1)))
        whole = gtsam.NonlinearFactorGraph(self.graph)
        whole.push_back(self.factors(estimate, used, doubted))
        return self.at(solve_batch(whole, estimate.values, self.problem.is_stiff))

    def _positions(self, values: Any) -> Array:
        return np.array([values.atNavState(X(k)).position() for k in range(len(self.problem.t))])

    def judged(
        self, estimate: _Estimate, weight: Array, doubted: Robustness | None = None
    ) -> Array:
        """Squared normalised residual of each gated reading by all others; fills in the limits.

        Where the residual alone decides, the prediction's covariance is not computed: it can only
        raise that of a reading in use, and lower that of another.
        """
        whole = gtsam.NonlinearFactorGraph(self.graph)
        whole.push_back(self.factors(estimate, weight > 0, doubted))
        covariances = Covariances(whole, estimate.values, self.problem.is_stiff)
        squared = np.zeros(len(self.readings))
        for i in np.flatnonzero(self.gated).tolist():
            linear = estimate.made[i].linearize(estimate.values)
            A, b = linear.jacobian()
            rows = np.any(A != 0.0, axis=1)
            probability = self.readings[i].robustness.gate_probability
            assert probability is not None
            squared[i] = float(b @ b)
            self.limit[i] = chi2_limit(probability, int(np.sum(rows)))
            clear = CLEAR_SHARE if weight[i] > 0.0 else 1.0
            if squared[i] > clear * self.limit[i]:
                P = covariances.joint(list(linear.keys()))
                squared[i] = _by_all_others(b[rows], A[rows] @ P @ A[rows].T, float(weight[i]))
        return squared


def _by_all_others(e: Array, M: Array, weight: float) -> float:
    """See the module's docstring; M's eigenvalues are those of how much a reading predicts
    itself."""
    share, axes = np.linalg.eigh(0.5 * (M + M.T))
    own = np.maximum(1.0 - weight * share, LEAST_OWN_SHARE)
    along = axes.T @ e
    return float(np.sum(along**2 / (own * (own + share))))
