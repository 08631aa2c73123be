"""Sensors and sonar in one sparse system, of which the sonar's part changes at each iteration.

The sonar couples north, east and yaw of knots that are far apart in time; all else is a chain. What
lies between the knots is eliminated once. The knots' remaining states touch only their neighbours
in time: they are nodes of their own beside the planar poses, so that a cut through the area keeps
no more than the planar poses along it and the states where the track crosses it.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np

from gtsam_nav.errors import EstimationError
from gtsam_nav.frames import Array
from gtsam_nav.graph.dissection import fronts_of
from gtsam_nav.graph.elimination import Elimination, pattern_of
from gtsam_nav.graph.factors import X
from gtsam_nav.graph.multifrontal import Factor
from gtsam_nav.graph.problem import Problem
from gtsam_nav.graph.sensor_posterior import (
    UNDETERMINED,
    Constants,
    LinearSystem,
    constants_given,
    keyframes_of_columns,
    linearised,
)
from gtsam_nav.series import BoolArray, IntArray

MOST_BETWEEN = 8
"""Keyframes between knots that are eliminated together; of longer gaps some stay with the knots."""
PLANAR_PART = np.array([3, 4, 2])
"""North, east and yaw in a keyframe's tangent space, once that is turned into n."""


class KnotSystem:
    """A linearised graph, reduced to its knots and what else meets there: the outer variables.

    Parameters
    ----------
    graph : gtsam.NonlinearFactorGraph
        As for `linearised`.
    values : gtsam.Values
    keyframes : ndarray of int, shape (m,)
        The knots, in order.
    problem : Problem
    touching : scipy.sparse array, shape (3 m, 3 m)
        Positive wherever the sonar may tell something of a step (dn, de, dyaw) of two knots.

    Attributes
    ----------
    system : LinearSystem
    keys : set of int
        The knots' own.
    turn : scipy.sparse array, shape (N, N)
        Rotation of the knots' tangents from b to n.
    chain : Factor
        Elimination of the inner variables.
    right : ndarray, shape (N, 1 + p)
        Right-hand sides g and h as that left them.
    planar : ndarray of int, shape (3 m,)
        The knots' planar poses among the outer variables.

    Raises
    ------
    EstimationError
        Where the graph does not determine its variables.
    """

    def __init__(
        self, graph: Any, values: Any, keyframes: IntArray, problem: Problem, touching: Any
    ) -> None:
        self.system, H = linearised(graph, values, problem)
        self.keys = {X(k) for k in keyframes.tolist()}
        self.turn = _turned_into_n(self.system, keyframes)
        H = (self.turn @ H @ self.turn.T).tocsc()
        keyframe = keyframes_of_columns(self.system, len(problem.t))
        # a variable's covariance is wanted whole, whether its parts touch or not
        own = [np.arange(c.start, c.stop) for c in self.system.columns.values()]
        meeting = abs(H) + pattern_of(own, len(self.system.g))
        inner = _between(meeting, keyframe, keyframes, len(problem.t))
        inner_first = Elimination(meeting, *_components(meeting, inner))
        self.chain = _eliminated(H, inner_first)
        self._H = self.chain.remainder(H)
        self.right = self.chain.forward(self.turn @ np.column_stack([self.system.g, self.system.h]))
        starts = np.array([self.system.columns[X(k)].start for k in keyframes.tolist()])
        planar = (starts[:, None] + PLANAR_PART).ravel()
        self.planar = inner_first.place[planar] - inner_first.n_eliminated
        is_planar = np.zeros(self._H.shape[0], dtype=bool)
        is_planar[self.planar] = True
        left = inner_first.left_over
        node, node_keyframe = _nodes(keyframe[left], is_planar)
        places = np.array(
            [[*values.atNavState(X(k)).position()[:2], k] for k in range(len(problem.t))]
        )
        place = np.where(node_keyframe[:, None] >= 0, places[node_keyframe], np.nan)
        borders = pattern_of(inner_first.touched_left_over, len(left))
        meeting = meeting[left][:, left] + borders + self._among_outer(touching)
        self._elimination = Elimination(meeting, *fronts_of(meeting, node, place))

    def with_sonar(self, A: Any, gradient: Array, step: Array) -> JointPosterior:
        """The Gaussian that the sensors and the sonar make together.

        Parameters
        ----------
        A : scipy.sparse array, shape (3 m, 3 m)
            The sonar's information on a step (dn, de, dyaw) of the knots, where these touch.
        gradient : ndarray, shape (3 m,)
            The sonar alone would solve ``A (x - step) = gradient``.
        step : ndarray, shape (m, 3)
            From where the sensors were linearised to where the sonar was.
        """
        whole = self._H + self._among_outer(A)
        right = self.right[-whole.shape[0] :].copy()
        right[self.planar, 0] += gradient + A @ step.ravel()
        factor = _eliminated(whole.tocsc(), self._elimination)
        return JointPosterior(self, factor, factor.solve(right))

    def _among_outer(self, A: Any) -> Any:
        """A matrix over the planar poses as one over all outer variables."""
        from scipy.sparse import coo_array

        A, planar = A.tocoo(), self.planar.astype(np.int32)
        places = (planar[A.row], planar[A.col])
        return coo_array((A.data, places), shape=self._H.shape).tocsc()


class JointPosterior:
    """What sensors and sonar know together.

    Parameters
    ----------
    knots : KnotSystem
    factor : Factor
        Of the outer variables.
    solution : ndarray, shape (n, 1 + p)
        Of these, for g and for h.

    Attributes
    ----------
    constants : Constants
    """

    def __init__(self, knots: KnotSystem, factor: Factor, solution: Array) -> None:
        self._knots, self._factor, self._outer = knots, factor, solution
        inner, outer = np.split(knots.right, [len(knots.right) - len(solution)])
        h = np.concatenate([inner[:, 1:], outer[:, 1:]])
        x = np.concatenate([inner, solution])
        self.constants: Constants = constants_given(knots.system, h, x[:, 0], x[:, 1:])

    @property
    def planar(self) -> Array:
        """Step (dn, de, dyaw) of the knots, shape (m, 3)."""
        x, U = self._outer[:, 0], self._outer[:, 1:]
        return np.asarray((x - U @ self.constants.mean)[self._knots.planar].reshape(-1, 3))

    def moved(self) -> Any:
        """Values at the optimum."""
        step = self._all[:, 0] - self._all[:, 1:] @ self.constants.mean
        return self._knots.system.retracted(step)

    @cached_property
    def _all(self) -> Array:
        """Solution of all variables in the graph's own frames, shape (N, 1 + p)."""
        y = self._knots.right.copy()
        y[-len(self._outer) :] = self._outer
        return np.asarray(self._knots.turn.T @ self._knots.chain.backward(y))

    def covariances(self, keys: Sequence[int]) -> list[Array]:
        """Marginal covariances of variables' free parts, constant errors included."""
        chain, columns = self._knots.chain, self._knots.system.columns
        place, n_inner = chain.elimination.place, chain.elimination.n_eliminated
        own = [np.arange(columns[key].start, columns[key].stop) for key in keys]
        is_outer = [bool(np.all(place[c] >= n_inner)) for c in own]
        borders = chain.elimination.touched_left_over
        wanted = [place[c] - n_inner for c, outer in zip(own, is_outer, strict=True) if outer]
        found = self._factor.covariances(borders + wanted)
        of_outer = iter(found[len(borders) :])
        of_inner = iter(
            chain.covariances(
                [c for c, outer in zip(own, is_outer, strict=True) if not outer],
                found[: len(borders)],
            )
        )
        spread = self._all[:, 1:] @ np.linalg.cholesky(self.constants.cov)
        covariances = []
        for key, c, outer in zip(keys, own, is_outer, strict=True):
            cov = next(of_outer if outer else of_inner)
            if key in self._knots.keys:
                R_nb = self._knots.system.values.atNavState(key).attitude().matrix()
                turn = np.kron(np.eye(3), R_nb)
                cov = turn.T @ cov @ turn
            cov = cov + spread[c] @ spread[c].T
            covariances.append(0.5 * (cov + cov.T))
        return covariances


def _turned_into_n(system: LinearSystem, keyframes: IntArray) -> Any:
    """Orthogonal matrix that turns the knots' tangents (theta, rho, nu) from b to n."""
    from scipy.sparse import coo_array

    n = len(system.g)
    starts = np.array([system.columns[X(k)].start for k in keyframes.tolist()])
    R_nb = np.array(
        [system.values.atNavState(X(k)).attitude().matrix() for k in keyframes.tolist()]
    )
    first = (starts[:, None] + np.array([0, 3, 6])).ravel()
    rows = np.repeat(first[:, None] + np.arange(3), 3, axis=1).ravel()
    across = np.tile(first[:, None] + np.arange(3), (1, 3)).ravel()
    rest = np.flatnonzero(np.bincount(rows, minlength=n) == 0)
    entries = np.concatenate([np.repeat(R_nb, 3, axis=0).ravel(), np.ones(len(rest))])
    places = (np.concatenate([rows, rest]), np.concatenate([across, rest]))
    return coo_array((entries, places), shape=(n, n)).tocsr()


def _between(H: Any, keyframe: IntArray, knots: IntArray, n_keyframes: int) -> BoolArray:
    """Columns that lie between knots and touch nothing beyond these; shape (N,)."""
    every = np.arange(n_keyframes)
    before = np.concatenate([[-1], knots])[np.searchsorted(knots, every, side="right")]
    outer = (every - before) % (MOST_BETWEEN + 1) == 0
    stretch = np.where(outer[keyframe] | (keyframe < 0), -1, np.cumsum(outer)[keyframe])
    entries = H.tocoo()
    a, b = stretch[entries.row], stretch[entries.col]
    beyond = (a >= 0) & (b >= 0) & (a != b)
    inner = stretch >= 0
    inner[entries.row[beyond]] = False
    return np.asarray(inner)


def _components(H: Any, inner: BoolArray) -> tuple[list[IntArray], list[int]]:
    """Inner columns that hang together, none having a parent."""
    from scipy.sparse.csgraph import connected_components

    own = np.flatnonzero(inner)
    count, label = connected_components(H[own][:, own], directed=False)
    order = np.argsort(label, kind="stable")
    sizes = np.bincount(label, minlength=count)
    return np.split(own[order], np.cumsum(sizes)[:-1]) if count else [], [-1] * count


def _nodes(keyframe: IntArray, is_planar: BoolArray) -> tuple[IntArray, IntArray]:
    """Node of each column, and each node's keyframe: planar poses apart from all else."""
    code = np.where(keyframe < 0, -1, 2 * keyframe + is_planar)
    codes, node = np.unique(code, return_inverse=True)
    return node, codes // 2


def _eliminated(matrix: Any, elimination: Elimination) -> Factor:
    try:
        return Factor(matrix, elimination)
    except np.linalg.LinAlgError as error:
        raise EstimationError(UNDETERMINED) from error
