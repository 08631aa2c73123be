"""What the sensors other than the sonar say about the planar keyframe poses, as one Gaussian.

The sonar couples north, east and yaw of keyframes that are far apart in time, which fills a sparse
solver's factors. All else is a chain. So the chain is solved sparsely, its planar marginal is kept
dense, the sonar's information is added there, and the rest of the state follows from it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import gtsam
import numpy as np

from gtsam_nav.errors import EstimationError
from gtsam_nav.frames import Array
from gtsam_nav.graph.backend import planar_rows
from gtsam_nav.graph.factors import X
from gtsam_nav.graph.problem import RECEIVER_STRIDE, Problem
from gtsam_nav.series import IntArray

CALIBRATION = ("scale", "misalignment_rad")
"""The constant errors of the sensor of the velocity."""


@dataclass(frozen=True)
class CalibrationPart:
    """Constant errors of the sensors, marginalised out of the trajectory.

    They are scale and misalignment of the velocity, the problem's other constants, and its timing
    errors (what is left of them); p in all.

    Attributes
    ----------
    mean, cov : ndarray, shapes (p,) and (p, p)
        Their estimate by the sensors other than the sonar.
    cross : ndarray, shape (p, m)
        Covariance with the planar poses.
    spread : ndarray, shape (N, p)
        Its product with its transpose is what they add to the covariance of all variables.
    """

    mean: Array
    cov: Array
    cross: Array
    spread: Array


@dataclass(frozen=True)
class SensorPosterior:
    """Gaussian of a linearised graph, reduced to the planar poses of some keyframes.

    Attributes
    ----------
    values : gtsam.Values
        Where the graph was linearised.
    columns : dict of int to slice
        Where each variable stands in a step.
    mean : ndarray, shape (N,)
        Step of all variables to the sensors' own optimum.
    planar_mean : ndarray, shape (m,)
        The same for (dn, de, dyaw) of the keyframes asked for.
    cross : ndarray, shape (N, m)
        Covariance of all variables with the planar ones.
    planar_cov : ndarray, shape (m, m)
    calibration : CalibrationPart
        What the velocity's constant errors add to all of these (they already contain it).
    """

    values: Any
    columns: dict[int, slice]
    mean: Array
    planar_mean: Array
    cross: Array
    planar_cov: Array
    calibration: CalibrationPart

    def step_given(self, planar: Array) -> Array:
        """Step of all variables, shape (N,), once the planar ones are known."""
        from scipy.linalg import cho_factor, cho_solve

        gain = cho_solve(cho_factor(self.planar_cov), planar - self.planar_mean)
        return np.asarray(self.mean + self.cross @ gain)

    def taken_by(self, A: Array) -> Array:
        """``W = A - A (P_p^-1 + A)^-1 A``: information A on the planar poses takes ``C W C'`` off a
        covariance whose cross covariance with them is C."""
        if not np.any(A):
            return np.zeros_like(self.planar_cov)
        total = np.linalg.inv(self.planar_cov) + A
        W = A - A @ np.linalg.solve(total, A)
        return np.asarray(0.5 * (W + W.T))

    def constants_given(self, planar: Array, A: Array) -> tuple[Array, Array]:
        """Constant errors and their covariance once the planar poses are known.

        Parameters
        ----------
        planar : ndarray, shape (m,)
            Their step, as for `step_given`.
        A : ndarray, shape (m, m)
            The information on them that this step rests on beside the sensors'.
        """
        part = self.calibration
        if not len(planar):
            return part.mean, part.cov
        gain = np.linalg.solve(self.planar_cov, planar - self.planar_mean)
        return part.mean + part.cross @ gain, part.cov - part.cross @ self.taken_by(
            A
        ) @ part.cross.T

    def retracted(self, step: Array) -> Any:
        """Values after a step."""
        delta = gtsam.VectorValues()
        for key, own in self.columns.items():
            width, free = _tangent(key)
            whole = np.zeros(width)
            whole[free] = step[own]
            delta.insert(key, whole)
        return self.values.retract(delta)


def sensor_posterior(
    graph: Any, values: Any, keyframes: IntArray, problem: Problem
) -> SensorPosterior:
    """Linearise a graph and reduce it to the planar poses of given keyframes.

    The graph begins with the problem's own factors in their order, and the readings in use.

    The constant errors D of the sensors are no variables of the graph: with h their coupling to its
    variables, ``H x + h D = g`` and ``h' x + (h_DD + Sigma_D^-1) D = g_D`` are solved by the Schur
    complement in D, a correction of their number's rank.

    Raises
    ------
    EstimationError
        Where the graph does not determine its variables.
    """
    from scipy.sparse import csc_array
    from scipy.sparse.linalg import splu

    columns, free = _columns(values)
    n = len(free)
    i, j, s = graph.linearize(values).sparseJacobian_()
    entries = (s, (i.astype(np.int64) - 1, j.astype(np.int64) - 1))
    # rows of zeros at the end have no entry
    rows = sum(graph.at(f).dim() for f in range(graph.size()))
    augmented = csc_array(entries, shape=(rows, int(j.max())))
    jacobian, b = augmented[:, free], augmented[:, [-1]].toarray()[:, 0]
    order = _order_in_time(columns)
    H = (jacobian.T @ jacobian).tocsc()[order][:, order]
    try:
        factor = splu(
            H, permc_spec="NATURAL", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
        )
    except RuntimeError as error:
        raise EstimationError("the sensors do not determine the trajectory") from error
    selection = np.zeros((n, 3 * len(keyframes)))
    for m, k in enumerate(keyframes.tolist()):
        R_nb = values.atNavState(X(k)).attitude().matrix()
        selection[columns[X(k)], 3 * m : 3 * m + 3] = planar_rows(R_nb).T
    effect, precision, prior_mean = _constant_errors(problem, values, rows)
    h, h_dd, g_d = jacobian.T @ effect, effect.T @ effect, effect.T @ b
    mean, cross, U = np.empty(n), np.empty_like(selection), np.empty_like(h)
    mean[order] = factor.solve((jacobian.T @ b)[order])
    cross[order] = factor.solve(selection[order])
    U[order] = factor.solve(h[order])
    cov_d: Array = np.linalg.inv(np.diag(precision) + h_dd - h.T @ U).astype(float)
    mean_d = cov_d @ (precision * prior_mean + g_d - h.T @ mean)
    mean -= U @ mean_d
    cross_d = -cov_d @ (U.T @ selection)
    cross -= U @ cross_d
    planar_cov = selection.T @ cross
    return SensorPosterior(
        values=values,
        columns=columns,
        mean=mean,
        planar_mean=selection.T @ mean,
        cross=cross,
        planar_cov=0.5 * (planar_cov + planar_cov.T),
        calibration=CalibrationPart(
            mean_d, cov_d, cross_d, np.asarray(U @ np.linalg.cholesky(cov_d))
        ),
    )


def _constant_errors(problem: Problem, values: Any, rows: int) -> tuple[Array, Array, Array]:
    """Derivative of all residuals in the constant errors, their prior's precision and mean."""
    effect = np.zeros((rows, len(CALIBRATION) + len(problem.constants)))
    first_row = problem.first_rows()
    effect[:, : len(CALIBRATION)] = _calibration_effect(problem, values, first_row, rows)
    for column, constant in enumerate(problem.constants, start=len(CALIBRATION)):
        for entry, derivative in constant.effect:
            row, gaussian = first_row[id(entry.factor)], entry.gaussian
            weight = entry.weight_at(values)
            whitened = gaussian.noiseModel().whiten(derivative)
            effect[row : row + len(derivative), column] = np.sqrt(weight) * whitened
    sigma = np.append(problem.calibration_sigma, [constant.sigma for constant in problem.constants])
    mean = np.zeros(len(sigma))
    if problem.timing is not None:
        below = rows - len(problem.timing.effect)
        effect = np.hstack([effect, np.pad(problem.timing.effect, ((0, below), (0, 0)))])
        sigma = np.append(sigma, problem.timing.sigma_s)
        mean = np.append(mean, -problem.timing.corrected_s)
    return effect, 1.0 / np.maximum(sigma, 1e-9) ** 2, mean


def _calibration_effect(
    problem: Problem, values: Any, first_row: dict[int, int], rows: int
) -> Array:
    """Of scale and misalignment of the velocity on all residuals.

    The displacement's residual is ``R_ab' (R_a' (p_b - p_a) - (1 + scale) Rz(misalignment) p_ab)``.
    """
    effect = np.zeros((rows, len(CALIBRATION)))
    for d in problem.displacements:
        A, _ = d.entry.factor.linearize(values).jacobian()
        # the native row is a rotation times the square root of weight and information
        root = float(np.linalg.norm(A[3, 12:15]))
        turned = np.array([-d.p_a[1], d.p_a[0], 0.0])
        row = first_row[id(d.entry.factor)] + 3
        effect[row : row + 3] = -root * d.R_ab.T @ np.column_stack([d.p_a, turned])
    return effect


def _tangent(key: int) -> tuple[int, slice]:
    """Width of a variable's tangent, and which part of it is free.

    Of a compass frame only the yaw is, of a GNSS error or a landmark only the position, of a range
    scale only the first component of that; the rest is pinned.
    """
    kind = chr(gtsam.Symbol(key).chr())
    if kind == "b":
        return 6, slice(0, 6)
    parts = {"m": slice(2, 3), "g": slice(3, 6), "l": slice(3, 6), "s": slice(3, 4)}
    return 9, parts.get(kind, slice(0, 9))


def free_part(key: int) -> slice:
    """Which components of a variable's tangent are free."""
    return _tangent(key)[1]


def tangent_width(key: int) -> int:
    """Width of a variable's tangent."""
    return _tangent(key)[0]


def _columns(values: Any) -> tuple[dict[int, slice], IntArray]:
    """Columns of each variable's free part, and where these stand in GTSAM's own order of keys."""
    columns, kept, first, first_kept = {}, [], 0, 0
    for key in sorted(values.keys()):
        width, free = _tangent(key)
        index = np.arange(width)[free]
        columns[key] = slice(first_kept, first_kept + len(index))
        kept.append(first + index)
        first, first_kept = first + width, first_kept + len(index)
    return columns, np.concatenate(kept)


def _order_in_time(columns: dict[int, slice]) -> IntArray:
    """Columns with all variables of a keyframe together: the chain's factors then stay narrow.

    Landmarks and range scales, which tie keyframes of all times, come last.
    """

    def place(key: int) -> tuple[bool, int, int]:
        symbol = gtsam.Symbol(key)
        return chr(symbol.chr()) in "ls", symbol.index() % RECEIVER_STRIDE, key

    by_time = sorted(columns, key=place)
    return np.concatenate([np.arange(columns[key].start, columns[key].stop) for key in by_time])
