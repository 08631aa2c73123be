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
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import gtsam
import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.graph import factors
from gtsam_nav.graph.block_covariances import joint_covariances
from gtsam_nav.graph.least_squares import solve_batch
from gtsam_nav.graph.problem import Problem, SensorFactor
from gtsam_nav.graph.readings import Reading, made
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
STILL_SIGMAS = 0.01
"""Readings are made anew until none tells anything else by more of its noise."""
FEW_BEYOND = 0.02
"""Where a larger share of the readings lies beyond its gates at the start, this may be bent."""
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


def settle(
    problem: Problem,
    entries: Sequence[SensorFactor],
    values: Any,
    believed: Collection[Reading] | None = None,
) -> Settled:
    """Solve a problem's batch with its readings, leaving out what is an outlier.

    Parameters
    ----------
    entries : sequence of SensorFactor
        Everything but the readings.
    values : gtsam.Values
        Start.
    believed : collection of Reading, optional
        Those that passed in another solution that is as near: it takes the robust start's place.
    """
    batch = _Batch(problem, entries)
    estimate = batch.at(values)
    if believed is not None:
        used = batch.among(believed)
    elif batch.explained(estimate):
        used = batch.pass_alone(estimate)
    else:
        estimate, used = _Batch(problem, entries, at_first=True).robust_start(estimate)
    changed, rounds, seen = True, 0, set[bytes]()
    while changed and rounds < MAX_ROUNDS:
        estimate = batch.solved(estimate, used)
        squared = batch.judged(estimate, batch.weights(estimate, used))
        verdict = ~batch.gated | (squared <= batch.limits(estimate))
        seen.add(used.tobytes())
        if verdict.tobytes() in seen:  # readings that refuse each other in turn all stay out
            verdict &= used
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
    under_kernels: dict[int, Any] = field(default_factory=dict)
    """Some of them under the readings' own kernels, once that was asked for."""

    @cached_property
    def _residuals(self) -> list[Array]:
        """Whitened, of each reading."""
        return [factor.whitenedError(self.values) for factor in self.made]

    @property
    def errors(self) -> Array:
        """Whitened residuals of the readings, one after the other."""
        return np.concatenate([np.empty(0), *self._residuals])

    @cached_property
    def squared(self) -> Array:
        """Squared whitened residuals of the readings."""
        return np.array([float(e @ e) for e in self._residuals])


@dataclass(frozen=True)
class _Rows:
    """The whitened rows of a reading that tell anything: ``A step = b`` for its variables."""

    keys: tuple[int, ...]
    A: Array
    b: Array


class _Batch:
    """A problem with all of its readings; ``at_first`` under the kernels of a robust start."""

    def __init__(
        self, problem: Problem, entries: Sequence[SensorFactor], *, at_first: bool = False
    ) -> None:
        self.problem = problem
        self.graph = gtsam.NonlinearFactorGraph()
        for entry in entries:
            start = entry.gaussian if entry.sensor in TRUSTED else entry.at_first
            self.graph.add(start if at_first else entry.factor)
        self.readings = problem.all_readings
        self.gated = np.array([reading.is_gated for reading in self.readings], dtype=bool)
        cuts = np.array([r.robustness.kernel in CUTTING for r in self.readings], dtype=bool)
        self.doubted = self.gated | cuts
        self.cuts = bool(np.any(cuts)) or any(e.robustness.kernel in CUTTING for e in entries)
        # a limit is known once somebody asks how many rows a reading tells; no less than of one
        self._least = np.array([self._limit(i, 1) for i in range(len(self.readings))])
        self._limits = np.where(self.gated, np.nan, np.inf)
        self.weighs = np.array([r.robustness.kernel != "none" for r in self.readings], dtype=bool)

    def at(self, values: Any) -> _Estimate:
        """The readings made anew at given values."""
        return _Estimate(values, made(self.readings, values.atNavState))

    def factors(
        self, estimate: _Estimate, used: BoolArray, doubted: Robustness | None = None
    ) -> Any:
        """Factors of used readings under their own kernels, or the doubted ones under another."""
        graph = gtsam.NonlinearFactorGraph()
        known = estimate.under_kernels if doubted is None else {}
        for i in np.flatnonzero(used).tolist():
            if i not in known:
                known[i] = factors.robust(estimate.made[i], self._robustness(i, doubted))
            graph.add(known[i])
        return graph

    def weights(
        self, estimate: _Estimate, used: BoolArray, doubted: Robustness | None = None
    ) -> Array:
        """Weight of each reading in such a solution: zero for what is not used."""
        norms = np.sqrt(estimate.squared)
        weights = np.ones(len(self.readings))
        differ = self.weighs if doubted is None else self.weighs | self.doubted
        for i in np.flatnonzero(differ & used).tolist():
            weights[i] = factors.weight(self._robustness(i, doubted), float(norms[i]))
        return np.asarray(used * weights)

    def _robustness(self, i: int, doubted: Robustness | None) -> Robustness:
        return doubted if doubted is not None and self.doubted[i] else self.readings[i].robustness

    def among(self, believed: Collection[Reading]) -> BoolArray:
        """Which readings are to be used: those believed, and those that have no gate."""
        ids = {id(reading) for reading in believed}
        known = np.array([id(reading) in ids for reading in self.readings], dtype=bool)
        return np.asarray(~self.gated | known)

    def pass_alone(self, estimate: _Estimate) -> BoolArray:
        """Which readings pass their gates by their residuals alone, or have none."""
        return np.asarray(~self.gated | (estimate.squared <= self.limits(estimate)))

    def explained(self, estimate: _Estimate) -> bool:
        """Whether an estimate, found under kernels, leaves but few readings beyond their gates.

        Where outliers have bent it, it contradicts what is good. Kernels that cut need a solution
        nearer than that.
        """
        passing = self.pass_alone(estimate)[self.gated]
        return not self.cuts and bool(np.sum(~passing) <= FEW_BEYOND * len(passing))

    def robust_start(self, estimate: _Estimate) -> tuple[_Estimate, BoolArray]:
        """Solve under a Cauchy kernel that narrows from a width that lets every reading in.

        Returns
        -------
        estimate : _Estimate
        used : ndarray of bool
            Which readings pass their gates there.
        """
        everything = np.ones(len(self.readings), dtype=bool)
        scale = float(np.sqrt(np.max(estimate.squared[self.doubted], initial=0.0)))
        while True:
            scale = max(START.scale, scale / NARROWING)
            kernel = START.model_copy(update={"threshold": scale})
            estimate = self._solved_once(estimate, everything, kernel)
            if scale == START.scale:
                break
        weight = self.weights(estimate, everything, START)
        return estimate, ~self.gated | (
            self.judged(estimate, weight, START) <= self.limits(estimate)
        )

    def solved(self, estimate: _Estimate, used: BoolArray) -> _Estimate:
        """Solve with Gaussian readings, made anew until that moves nothing any more."""
        change, rounds = np.inf, 0
        while change > STILL_SIGMAS and rounds < MAX_ROUNDS:
            before = estimate
            estimate = self._solved_once(estimate, used)
            stale = _Estimate(estimate.values, before.made)
            change = float(np.max(np.abs(estimate.errors - stale.errors), initial=0.0))
            rounds += 1
        return estimate

    def _solved_once(
        self, estimate: _Estimate, used: BoolArray, doubted: Robustness | None = None
    ) -> _Estimate:
        self.problem.set_all_gravity(estimate.values)
        whole = gtsam.NonlinearFactorGraph(self.graph)
        whole.push_back(self.factors(estimate, used, doubted))
        return self.at(solve_batch(whole, estimate.values, self.problem.is_stiff))

    def judged(
        self, estimate: _Estimate, weight: Array, doubted: Robustness | None = None
    ) -> Array:
        """Squared normalised residual of each gated reading by all others.

        Where the residual alone decides, the prediction's covariance is not computed: it can only
        raise that of a reading in use, and lower that of another.
        """
        squared = np.where(self.gated, estimate.squared, 0.0)
        examined = squared > np.where(weight > 0.0, CLEAR_SHARE, 1.0) * self.limits(estimate)
        rows = {i: _rows(estimate, i) for i in np.flatnonzero(examined).tolist()}
        groups = sorted({own.keys for own in rows.values()})
        whole = gtsam.NonlinearFactorGraph(self.graph)
        whole.push_back(self.factors(estimate, weight > 0, doubted))
        found = joint_covariances(whole, estimate.values, groups, self.problem.is_stiff)
        covariance = dict(zip(groups, found, strict=True))
        for i, own in rows.items():
            M = own.A @ covariance[own.keys] @ own.A.T
            squared[i] = _by_all_others(own.b, M, float(weight[i]))
        return squared

    def limits(self, estimate: _Estimate) -> Array:
        """Of the squared normalised residual of each gated reading; infinite for others.

        Of one that is clearly below, no more than what is a limit at least.
        """
        near = np.isnan(self._limits) & (estimate.squared > CLEAR_SHARE * self._least)
        for i in np.flatnonzero(near).tolist():
            self._limits[i] = self._limit(i, len(_rows(estimate, i).b))
        return np.where(np.isnan(self._limits), self._least, self._limits)

    def _limit(self, i: int, rows: int) -> float:
        probability = self.readings[i].robustness.gate_probability
        return np.inf if probability is None else chi2_limit(probability, rows)


def _rows(estimate: _Estimate, i: int) -> _Rows:
    """What a reading tells."""
    linear = estimate.made[i].linearize(estimate.values)
    A, b = linear.jacobian()
    tells = np.any(A != 0.0, axis=1)
    return _Rows(tuple(linear.keys()), A[tells], b[tells])


def _by_all_others(e: Array, M: Array, weight: float) -> float:
    """See the module's docstring; M's eigenvalues are those of how much a reading predicts
    itself."""
    share, axes = np.linalg.eigh(0.5 * (M + M.T))
    own = np.maximum(1.0 - weight * share, LEAST_OWN_SHARE)
    along = axes.T @ e
    return float(np.sum(along**2 / (own * (own + share))))
