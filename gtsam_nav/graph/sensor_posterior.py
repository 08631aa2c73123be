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
from gtsam_nav.mission import IntArray


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
    """

    values: Any
    columns: dict[int, slice]
    mean: Array
    planar_mean: Array
    cross: Array
    planar_cov: Array

    def step_given(self, planar: Array) -> Array:
        """Step of all variables, shape (N,), once the planar ones are known."""
        from scipy.linalg import cho_factor, cho_solve

        gain = cho_solve(cho_factor(self.planar_cov), planar - self.planar_mean)
        return np.asarray(self.mean + self.cross @ gain)

    def retracted(self, step: Array) -> Any:
        """Values after a step."""
        delta = gtsam.VectorValues()
        for key, own in self.columns.items():
            delta.insert(key, step[own])
        return self.values.retract(delta)


def sensor_posterior(graph: Any, values: Any, keyframes: IntArray) -> SensorPosterior:
    """Linearise a graph and reduce it to the planar poses of given keyframes.

    Raises
    ------
    EstimationError
        Where the graph does not determine its variables.
    """
    from scipy.sparse import csc_array
    from scipy.sparse.linalg import splu

    columns = _columns(values)
    n = max(own.stop for own in columns.values())
    i, j, s = graph.linearize(values).sparseJacobian_()
    entries = (s, (i.astype(np.int64) - 1, j.astype(np.int64) - 1))
    augmented = csc_array(entries, shape=(int(i.max()), n + 1))
    jacobian, b = augmented[:, :n], augmented[:, [n]].toarray()[:, 0]
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
    mean, cross = np.empty(n), np.empty_like(selection)
    mean[order] = factor.solve((jacobian.T @ b)[order])
    cross[order] = factor.solve(selection[order])
    planar_mean, planar_cov = selection.T @ mean, selection.T @ cross
    planar_cov = 0.5 * (planar_cov + planar_cov.T)
    return SensorPosterior(values, columns, mean, planar_mean, cross, planar_cov)


def _columns(values: Any) -> dict[int, slice]:
    """Columns of each variable, in the order of keys that GTSAM linearises in."""
    columns, first = {}, 0
    for key in sorted(values.keys()):
        width = 6 if chr(gtsam.Symbol(key).chr()) == "b" else 9
        columns[key] = slice(first, first + width)
        first += width
    return columns


def _order_in_time(columns: dict[int, slice]) -> IntArray:
    """Columns with all variables of a keyframe together: the chain's factors then stay narrow."""
    by_time = sorted(columns, key=lambda key: (gtsam.Symbol(key).index(), key))
    return np.concatenate([np.arange(columns[key].start, columns[key].stop) for key in by_time])
