"""What the sensors other than the sonar say about the trajectory, as one Gaussian.

The graph is linearised once; the constant errors of the sensors, which are none of its variables,
are marginalised out of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import gtsam
import numpy as np

from gtsam_nav.errors import EstimationError
from gtsam_nav.frames import Array
from gtsam_nav.graph.backend import planar_rows
from gtsam_nav.graph.dissection import fronts_of
from gtsam_nav.graph.elimination import Elimination
from gtsam_nav.graph.factors import X
from gtsam_nav.graph.keys import index_of, letter_of
from gtsam_nav.graph.multifrontal import Factor
from gtsam_nav.graph.problem import RECEIVER_STRIDE, Problem
from gtsam_nav.series import IntArray

CALIBRATION = ("scale", "misalignment_rad")
"""The constant errors of the sensor of the velocity."""
TANGENTS = {
    "b": (6, slice(0, 6)),
    "m": (9, slice(2, 3)),
    "g": (9, slice(3, 6)),
    "l": (9, slice(3, 6)),
    "s": (9, slice(3, 4)),
}
"""Width of a kind of variable's tangent, and which part of it is free: a keyframe's whole."""
UNDETERMINED = "the sensors do not determine the trajectory"
PINNED, RIGHT_SIDE = -1, -2
"""Columns of GTSAM's own that are none of the system's."""


@dataclass(frozen=True)
class Constants:
    """Constant errors of the sensors: estimate and covariance, shapes (p,) and (p, p).

    They are scale and misalignment of the velocity, the problem's other constants, and its timing
    errors (what is left of them).
    """

    mean: Array
    cov: Array


@dataclass(frozen=True)
class LinearSystem:
    """Normal equations of a linearised graph, and of the constant errors D beside its variables.

    ``H x + h D = g`` and ``h' x + h_dd D = g_d``, the errors' prior included. H, the largest part,
    stands apart.

    Attributes
    ----------
    values : gtsam.Values
        Where the graph was linearised.
    columns : dict of int to slice
        Where each variable's free part stands in a step.
    g, h, h_dd, g_d : ndarray, shapes (N,), (N, p), (p, p) and (p,)
    """

    values: Any
    columns: dict[int, slice]
    g: Array
    h: Array
    h_dd: Array
    g_d: Array

    def retracted(self, step: Array) -> Any:
        """Values after a step, shape (N,)."""
        delta = gtsam.VectorValues()
        for key, own in self.columns.items():
            width, free = _tangent(key)
            whole = np.zeros(width)
            whole[free] = step[own]
            delta.insert(key, whole)
        return self.values.retract(delta)


def constants_given(system: LinearSystem, left: Array, x: Array, U: Array) -> Constants:
    """Constant errors by the Schur complement in them.

    The step of all variables is then ``H^-1 g - H^-1 h mean``; its covariance grows by
    ``H^-1 h cov h' H^-1``.

    Parameters
    ----------
    left, x, U : ndarray, shapes (N, p), (N,) and (N, p)
        Of which ``left' x = h' H^-1 g`` and ``left' U = h' H^-1 h``.
    """
    cov: Array = np.linalg.inv(system.h_dd - left.T @ U).astype(float)
    return Constants(cov @ (system.g_d - left.T @ x), cov)


def linearised(graph: Any, values: Any, problem: Problem) -> tuple[LinearSystem, Any]:
    """Linearise a graph that begins with the problem's own factors in their order, and the
    readings in use; its H, sparse (N, N), beside the rest."""
    columns, jacobian, b = whitened_jacobian(graph, values)
    effect, precision, prior_mean = _constant_errors(problem, values)
    both = min(len(b), len(effect))
    system = LinearSystem(
        values=values,
        columns=columns,
        g=jacobian.T @ b,
        h=jacobian[:both].T @ effect[:both],
        h_dd=effect.T @ effect + np.diag(precision),
        g_d=effect[:both].T @ b[:both] + precision * prior_mean,
    )
    return system, (jacobian.T @ jacobian).tocsc()


def whitened_jacobian(graph: Any, values: Any) -> tuple[dict[int, slice], Any, Array]:
    """A graph's derivative in the free parts of its variables, and its residuals.

    Returns
    -------
    columns : dict of int to slice
        As in `LinearSystem`.
    jacobian : scipy.sparse.csr_array, shape (rows, N)
        Without rows of zeros at the end.
    b : ndarray, shape (rows,)
        What a step is to make up for.
    """
    from scipy.sparse import coo_array

    columns, place = _columns(tuple(sorted(values.keys())))
    i, j, s = graph.linearize(values).sparseJacobian_()
    row, column = i.astype(np.int32) - 1, place.astype(np.int32)[j.astype(np.int32) - 1]
    b = np.zeros(int(row.max()) + 1)
    right, left = column == RIGHT_SIDE, column >= 0
    b[row[right]] = s[right]
    n = max(part.stop for part in columns.values())
    jacobian = coo_array((s[left], (row[left], column[left])), shape=(len(b), n))
    return columns, jacobian.tocsr(), b


@dataclass(frozen=True)
class SensorPosterior:
    """Gaussian of a linearised graph.

    Attributes
    ----------
    system : LinearSystem
    step : ndarray, shape (N,)
        Of all variables to the optimum.
    constants : Constants
    spread : ndarray, shape (N, p)
        Its product with its transpose is what the constant errors add to the covariance of all
        variables.
    planar_cov : ndarray, shape (3 m, 3 m)
        Of (dn, de, dyaw) of the keyframes asked for, constant errors included.
    """

    system: LinearSystem
    step: Array
    constants: Constants
    spread: Array
    planar_cov: Array

    def moved(self) -> Any:
        """Values at the optimum."""
        return self.system.retracted(self.step)


def sensor_posterior(
    graph: Any, values: Any, keyframes: IntArray, problem: Problem
) -> SensorPosterior:
    """Gaussian of a graph (see `linearised`) and the planar poses of given keyframes.

    Raises
    ------
    EstimationError
        Where the graph does not determine its variables.
    """
    from scipy.sparse.linalg import splu

    system, H = linearised(graph, values, problem)
    try:
        # least degree first: as good as the order of time on a chain, and where loops are closed
        factor = splu(
            H,
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
    except RuntimeError as error:
        raise EstimationError(UNDETERMINED) from error
    x, U = factor.solve(system.g), factor.solve(system.h)
    constants = constants_given(system, system.h, x, U)
    spread = np.asarray(U @ np.linalg.cholesky(constants.cov))
    selection = _planar_selection(system, keyframes)
    planar_spread = selection.T @ spread
    keyframe = keyframes_of_columns(system, len(problem.t))
    planar_cov = _of_inverse(H, keyframe, selection) + planar_spread @ planar_spread.T
    return SensorPosterior(system, x - U @ constants.mean, constants, spread, planar_cov)


def _of_inverse(H: Any, keyframe: IntArray, selection: Any) -> Array:
    """``selection' H^-1 selection``: all columns that it leaves out are eliminated first.

    Without closures time is all that joins keyframes, so that halves of it make narrow fronts.
    """
    from scipy.linalg import cholesky, solve_triangular

    if not selection.shape[1]:
        return np.empty((0, 0))
    kept = np.unique(selection.nonzero()[0])
    rest = np.setdiff1d(np.arange(H.shape[0]), kept)
    keyframe, node = np.unique(keyframe[rest], return_inverse=True)
    place = np.where(keyframe >= 0, keyframe, np.nan)[:, None]
    fronts, parent = fronts_of(H[rest][:, rest], node, place)
    try:
        order = Elimination(H, [rest[own] for own in fronts], parent)
        factor = Factor(H, order)
        L = cholesky(factor.remainder(H).toarray(), lower=True, check_finite=False)
    except np.linalg.LinAlgError as error:
        raise EstimationError(UNDETERMINED) from error
    W = solve_triangular(L, selection[kept].toarray(), lower=True, check_finite=False)
    return np.asarray(W.T @ W)


def keyframes_of_columns(system: LinearSystem, n_keyframes: int) -> IntArray:
    """Keyframe that each column belongs to, -1 for what belongs to none; shape (N,)."""
    keyframe = np.full(len(system.g), -1)
    for key, own in system.columns.items():
        k = keyframe_of(key)
        if k < n_keyframes:
            keyframe[own] = k
    return keyframe


def _planar_selection(system: LinearSystem, keyframes: IntArray) -> Any:
    """Derivative of (dn, de, dyaw) of some keyframes in a step, transposed; shape (N, 3 m)."""
    from scipy.sparse import coo_array

    keys = [X(k) for k in keyframes.tolist()]
    R_nb = [system.values.atNavState(key).attitude().matrix() for key in keys]
    entries = np.array([planar_rows(R).T for R in R_nb]).reshape(-1, 9, 3)
    first = np.array([system.columns[key].start for key in keys], dtype=np.int64)
    rows = np.broadcast_to((first[:, None] + np.arange(9))[:, :, None], entries.shape)
    columns = np.broadcast_to(np.arange(3 * len(keys)).reshape(-1, 1, 3), entries.shape)
    places = (rows.ravel(), columns.ravel())
    return coo_array((entries.ravel(), places), shape=(len(system.g), 3 * len(keys))).tocsc()


def _constant_errors(problem: Problem, values: Any) -> tuple[Array, Array, Array]:
    """Derivative of residuals in the constant errors, their prior's precision and mean.

    Of the problem's own factors, and with timing errors of the readings below them.
    """
    first_row, rows = problem.first_rows()
    effect = np.zeros((rows, len(CALIBRATION) + len(problem.constants)))
    effect[:, : len(CALIBRATION)] = _calibration_effect(problem, values, first_row, rows)
    for column, constant in enumerate(problem.constants, start=len(CALIBRATION)):
        for entry, derivative in constant.effect:
            row, gaussian = first_row[id(entry)], entry.gaussian
            weight = entry.weight_at(values)
            whitened = gaussian.noiseModel().whiten(derivative)
            effect[row : row + len(derivative), column] = np.sqrt(weight) * whitened
    sigma = np.append(problem.calibration_sigma, [constant.sigma for constant in problem.constants])
    mean = np.zeros(len(sigma))
    if problem.timing is not None:
        below = len(problem.timing.effect) - rows
        effect = np.hstack([np.pad(effect, ((0, below), (0, 0))), problem.timing.effect])
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
    if not problem.displacements:
        return effect
    p_a, R_ab = (
        np.array([getattr(d, of) for d in problem.displacements]) for of in ("p_a", "R_ab")
    )
    entries = [d.entry for d in problem.displacements]
    native = [entry.factor.linearize(values).jacobian()[0][3, 12:15] for entry in entries]
    # the native row is a rotation times the square root of weight and information
    root = np.linalg.norm(native, axis=1)
    turned = np.column_stack([-p_a[:, 1], p_a[:, 0], np.zeros(len(p_a))])
    moved = np.stack([p_a, turned], axis=2)
    first = np.array([first_row[id(entry)] for entry in entries])
    effect[first[:, None] + np.arange(3, 6)] = -root[:, None, None] * (
        np.swapaxes(R_ab, 1, 2) @ moved
    )
    return effect


def _tangent(key: int) -> tuple[int, slice]:
    """Width of a variable's tangent, and which part of it is free.

    Of a compass frame only the yaw is, of a GNSS error or a landmark only the position, of a range
    scale only the first component of that; the rest is pinned.
    """
    return TANGENTS.get(letter_of(key), (9, slice(0, 9)))


def free_part(key: int) -> slice:
    """Which components of a variable's tangent are free."""
    return _tangent(key)[1]


def tangent_width(key: int) -> int:
    """Width of a variable's tangent."""
    return _tangent(key)[0]


@lru_cache(maxsize=2)  # the same variables are linearised several times
def _columns(keys: tuple[int, ...]) -> tuple[dict[int, slice], IntArray]:
    """Columns of each variable's free part, and which of them each of GTSAM's own is, if any.

    GTSAM has the keys in their order, and the right-hand side behind them.
    """
    columns, pieces, end = {}, [], 0
    for key in keys:
        width, free = _tangent(key)
        begin, end = end, end + free.stop - free.start
        columns[key] = slice(begin, end)
        pieces.append((free.start, free.stop - free.start, width - free.stop))
    before, kept, after = np.array(pieces).T
    place = np.full(int(np.sum(before + kept + after)) + 1, PINNED)
    first = np.cumsum(before + kept + after) - kept - after
    place[np.repeat(first - np.cumsum(kept) + kept, kept) + np.arange(end)] = np.arange(end)
    place[-1] = RIGHT_SIDE
    return columns, place


def keyframe_of(key: int) -> int:
    """Keyframe that a variable belongs to; beyond all of them for what belongs to none."""
    if letter_of(key) in "ls":
        return RECEIVER_STRIDE
    return index_of(key) % RECEIVER_STRIDE
