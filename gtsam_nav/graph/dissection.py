"""Nested dissection: in which order to eliminate the variables of a spatial graph.

A cut across the area divides the nodes in two halves; those of one half that touch the other are
the separator, which is eliminated after what it separates (George 1973). Two scans share echoes
only where they were taken near each other, so that separators stay small. Where little but time
joins the nodes, as on a course that is sailed over and over, a cut in time is the narrowest.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.series import BoolArray, IntArray

LARGEST_UNDIVIDED = 24
"""So many nodes are eliminated at once: smaller matrices cost more in calls than in arithmetic."""


@dataclass
class Fronts:
    """Sets of nodes that are eliminated together, each before its parent.

    Attributes
    ----------
    nodes : list of ndarray of int
    parent : list of int
        Index of the front that takes in what is left of this one; -1 where there is none.
    """

    nodes: list[IntArray] = field(default_factory=list)
    parent: list[int] = field(default_factory=list)

    def add(self, nodes: IntArray, children: list[int]) -> int:
        """Append a front after its children; returns its index."""
        self.nodes.append(nodes)
        self.parent.append(-1)
        for child in children:
            self.parent[child] = len(self.nodes) - 1
        return len(self.nodes) - 1


def nested_dissection(adjacent: Any, place: Array, width: IntArray) -> Fronts:
    """Fronts of a graph whose nodes lie in the plane, and in time.

    Parameters
    ----------
    adjacent : scipy.sparse.csr_array, shape (n, n)
        Symmetric pattern, of positive integers.
    place : ndarray, shape (n, d)
        Coordinates, of which time may be one; all NaN for nodes that lie nowhere and touch nodes
        everywhere: they are eliminated last.
    width : ndarray of int, shape (n,)
        Number of variables of each node.
    """
    fronts = Fronts()
    placed = np.isfinite(place[:, 0])
    roots = _divide(np.flatnonzero(placed), adjacent, place, width, fronts)
    if not np.all(placed):
        fronts.add(np.flatnonzero(~placed), roots)
    return fronts


def fronts_of(matrix: Any, node: IntArray, place: Array) -> tuple[list[IntArray], list[int]]:
    """Columns of each front of a matrix, and each one's parent, as `Factor` takes them.

    Parameters
    ----------
    matrix : scipy.sparse array, shape (N, N)
        With an entry wherever columns touch each other.
    node : ndarray of int, shape (N,)
        Of each column: those of a node stay together.
    place : ndarray, shape (n, d)
        Of each node, as for `nested_dissection`.
    """
    from scipy.sparse import coo_array

    n = len(place)
    entries = matrix.tocoo()
    ones = np.ones(len(entries.row), dtype=np.int32)
    small = node.astype(np.int32)
    adjacent = coo_array((ones, (small[entries.row], small[entries.col])), shape=(n, n)).tocsr()
    width = np.bincount(node, minlength=n)
    fronts = nested_dissection(adjacent, place, width)
    by_node = np.split(np.argsort(node, kind="stable"), np.cumsum(width)[:-1])
    columns = [np.concatenate([by_node[k] for k in nodes.tolist()]) for nodes in fronts.nodes]
    return columns, fronts.parent


def _divide(
    nodes: IntArray, adjacent: Any, place: Array, width: IntArray, fronts: Fronts
) -> list[int]:
    """Add the fronts of some nodes; returns those that have no parent yet."""
    if len(nodes) == 0:
        return []
    if len(nodes) <= LARGEST_UNDIVIDED:
        return [fronts.add(nodes, [])]
    here = adjacent[nodes][:, nodes]
    cuts = [_separated(here, place[nodes, axis], width[nodes]) for axis in range(place.shape[1])]
    low, high, separator = min(cuts, key=lambda cut: int(width[nodes[cut[2]]].sum()))
    roots = _divide(nodes[low], adjacent, place, width, fronts)
    roots += _divide(nodes[high], adjacent, place, width, fronts)
    return [fronts.add(nodes[separator], roots)] if np.any(separator) else roots


def _separated(
    adjacent: Any, coordinate: Array, width: IntArray
) -> tuple[BoolArray, BoolArray, BoolArray]:
    """Two halves along a coordinate, and the narrower of what divides them."""
    high = np.zeros(len(coordinate), dtype=bool)
    high[np.argsort(coordinate, kind="stable")[len(coordinate) // 2 :]] = True
    borders = [side & (adjacent @ (~side).astype(np.int32) > 0) for side in (high, ~high)]
    separator = min(borders, key=lambda border: int(width[border].sum()))
    return ~high & ~separator, high & ~separator, separator
