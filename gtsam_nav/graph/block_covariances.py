"""Joint covariances of many small groups of variables, in one pass over the graph.

GTSAM's own joint covariances each take a path through the whole Bayes tree. All those of variables
that a single factor may join are entries of the inverse within fronts (see `multifrontal`), and
cost about one factorisation together.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.graph.backend import Covariances
from gtsam_nav.graph.dissection import fronts_of
from gtsam_nav.graph.elimination import Elimination, pattern_of
from gtsam_nav.graph.factors import X
from gtsam_nav.graph.keys import letter_of
from gtsam_nav.graph.multifrontal import Factor
from gtsam_nav.graph.sensor_posterior import (
    free_part,
    keyframe_of,
    tangent_width,
    whitened_jacobian,
)
from gtsam_nav.series import IntArray

FEW = 50
"""So few groups are answered sooner by GTSAM's own, whose time for each grows with the graph."""


def joint_covariances(
    graph: Any, values: Any, groups: Sequence[tuple[int, ...]], is_stiff: bool = False
) -> list[Array]:
    """Joint covariance of each group of variables, in their order.

    Parameters
    ----------
    graph : gtsam.NonlinearFactorGraph
    values : gtsam.Values
        Where to linearise.
    groups : sequence of tuple of int
        Keys; the groups are small and many.
    is_stiff : bool
        As for `solve_batch`: by QR, one by one as where they are few.

    Raises
    ------
    EstimationError
        Where the graph does not determine its variables.
    """
    if not groups:
        return []
    if not is_stiff and len(groups) > FEW:
        try:
            return _by_fronts(graph, values, groups)
        except np.linalg.LinAlgError:
            pass  # where these pivots fail, QR or nothing will do
    one_by_one = Covariances(graph, values, is_stiff)
    return [one_by_one.joint(list(keys)) for keys in groups]


def _by_fronts(graph: Any, values: Any, groups: Sequence[tuple[int, ...]]) -> list[Array]:
    columns, jacobian, _ = whitened_jacobian(graph, values)
    own = {key: np.arange(part.start, part.stop) for key, part in columns.items()}
    wanted = [np.concatenate([own[key] for key in keys]) for keys in groups]
    H = (jacobian.T @ jacobian).tocsc()
    meeting = abs(H) + pattern_of(wanted, H.shape[0])
    fronts = fronts_of(meeting, *_nodes(columns, values))
    factor = Factor(H, Elimination(meeting, *fronts))
    found = factor.covariances(wanted)
    return [_whole_tangents(keys, cov) for keys, cov in zip(groups, found, strict=True)]


def _nodes(columns: dict[int, slice], values: Any) -> tuple[IntArray, Array]:
    """Node of each column, and the place of each node.

    What belongs to a keyframe is one node there; a landmark is one where it lies, at no time.
    """
    ids = {key: key if _is_landmark(key) else keyframe_of(key) for key in columns}
    number = {name: n for n, name in enumerate(dict.fromkeys(ids.values()))}
    node = np.empty(max(part.stop for part in columns.values()), dtype=np.int64)
    place = np.full((len(number), 3), np.nan)
    for key, part in columns.items():
        node[part] = number[ids[key]]
        if _is_landmark(key):
            place[number[key], :2] = values.atNavState(key).position()[:2]
        elif key == X(ids[key]):
            place[number[ids[key]]] = (*values.atNavState(key).position()[:2], ids[key])
    return node, place


def _is_landmark(key: int) -> bool:
    return letter_of(key) == "l"


def _whole_tangents(keys: tuple[int, ...], cov: Array) -> Array:
    """A covariance of free parts among the whole tangents, of which the rest is pinned."""
    first = np.cumsum([0, *(tangent_width(key) for key in keys)])
    free = [np.arange(tangent_width(key))[free_part(key)] for key in keys]
    at = np.concatenate([own + start for own, start in zip(free, first, strict=False)])
    whole = np.zeros((first[-1], first[-1]))
    whole[np.ix_(at, at)] = cov
    return whole
