"""Fixed-interval smoothing of a filter's history.

Rauch, Tung and Striebel, *Maximum likelihood estimates of linear dynamic systems*, AIAA Journal
3(8), 1965, written for errors: what the filter at each node is wrong by, as all later measurements
see it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.series import IntArray


class FilterNode(Protocol):
    """What the smoother needs of the filter at one time; see `error_state.Node`."""

    @property
    def P(self) -> Array: ...  # noqa: N802

    @property
    def P_predicted(self) -> Array: ...  # noqa: N802

    @property
    def Phi(self) -> Array: ...  # noqa: N802

    @property
    def correction(self) -> Array: ...


def smooth(
    nodes: Sequence[FilterNode],
    compose: Callable[[Array, Array], Array] = np.add,
    carried: Sequence[IntArray] | None = None,
) -> tuple[Array, Array]:
    """Errors of the filtered states, and covariances of the smoothed ones.

    Parameters
    ----------
    nodes : sequence of FilterNode
        In the order of time; n errors each.
    compose : callable
        The error that is two errors, one after the other; their sum where the errors add.
    carried : sequence of ndarray of int, optional
        By number, the errors of each node that later measurements may put right: all where absent.
        The others stay as filtered, and are taken to be independent of these.

    Returns
    -------
    error : ndarray, shape (k, n)
        To be put right in each node's filtered state.
    P : ndarray, shape (k, n, n)
    """
    size = len(nodes[-1].correction)
    error, P = np.zeros((len(nodes), size)), np.empty((len(nodes), size, size))
    P[-1] = nodes[-1].P
    for k in range(len(nodes) - 2, -1, -1):
        node, then = nodes[k], nodes[k + 1]
        own = np.arange(size) if carried is None else carried[k]
        block = np.ix_(own, own)
        G = _gain(node.P[block], then.Phi[block], then.P_predicted[block])
        error[k, own] = G @ compose(then.correction, error[k + 1])[own]
        smoothed = node.P[block] + G @ (P[k + 1] - then.P_predicted)[block] @ G.T
        P[k] = node.P
        P[k, own], P[k, :, own] = 0.0, 0.0
        P[k][block] = 0.5 * (smoothed + smoothed.T)
    return error, P


def _gain(P: Array, Phi: Array, P_predicted: Array) -> Array:
    """``P Phi' P_predicted^-1``, scaled since the errors' units lie far apart."""
    spread = np.sqrt(np.diag(P_predicted))
    scale = np.where(spread > 0, spread, 1.0)
    whitened, right = P_predicted / np.outer(scale, scale), (Phi @ P) / scale[:, None]
    try:
        gain = np.linalg.solve(whitened, right)
    except np.linalg.LinAlgError:  # an error that is known exactly
        gain = np.linalg.lstsq(whitened, right, rcond=None)[0]
    return np.asarray(gain.T / scale)
