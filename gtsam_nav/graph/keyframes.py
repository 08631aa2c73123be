"""When the graph's states are: where something is measured, and often enough between."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise

import numpy as np

from gtsam_nav.frames import Array

MIN_SPACING_S = 0.05
"""Start and stop give way to an anchor that is nearer than this."""


def merged_anchors(
    times: Iterable[Array], min_spacing_s: float, stated: Array | None = None
) -> Array:
    """Times at which keyframes must be, from several lists; earlier lists come first.

    A time that is nearer than the spacing to one that is kept already is left out: what was
    measured then is carried to its neighbour. The stated ones are kept all.
    """
    kept = np.empty(0) if stated is None else np.unique(stated)
    for group in times:
        own = np.unique(group)
        if not len(kept) and np.all(np.diff(own) >= min_spacing_s):
            kept = own
            continue
        for t in own:
            i = int(np.searchsorted(kept, t))
            if all(abs(t - near) >= min_spacing_s for near in kept[max(i - 1, 0) : i + 1]):
                kept = np.insert(kept, i, t)
    return kept


def keyframe_times(start_s: float, stop_s: float, anchors: Array, interval_s: float) -> Array:
    """Keyframe times: start, stop, each anchor, and equal divisions of what is too long.

    Parameters
    ----------
    start_s, stop_s : float
    anchors : ndarray, shape (m,)
        Strictly increasing: scans' middles and the like.
    interval_s : float
        Longest spacing.
    """
    inner = anchors[(anchors >= start_s) & (anchors <= stop_s)]
    ends = [t for t in (start_s, stop_s) if np.all(np.abs(inner - t) >= MIN_SPACING_S)]
    marks = np.unique(np.concatenate([ends, inner]))
    pieces = [
        np.linspace(a, b, int(np.ceil((b - a) / interval_s)), endpoint=False)
        for a, b in pairwise(marks)
    ]
    return np.concatenate([*pieces, marks[-1:]])
