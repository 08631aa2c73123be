"""When the graph's states are: at the middle of scans, and often enough between."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from gtsam_nav.frames import Array

MIN_SPACING_S = 0.05
"""Start and stop give way to a scan's middle that is nearer than this."""


def keyframe_times(start_s: float, stop_s: float, scan_times: Array, interval_s: float) -> Array:
    """Keyframe times: start, stop, each scan's middle, and equal divisions of what is too long.

    Parameters
    ----------
    start_s, stop_s : float
    scan_times : ndarray, shape (m,)
        Strictly increasing.
    interval_s : float
        Longest spacing.
    """
    inner = scan_times[(scan_times >= start_s) & (scan_times <= stop_s)]
    ends = [t for t in (start_s, stop_s) if np.all(np.abs(inner - t) >= MIN_SPACING_S)]
    anchors = np.unique(np.concatenate([ends, inner]))
    pieces = [
        np.linspace(a, b, int(np.ceil((b - a) / interval_s)), endpoint=False)
        for a, b in pairwise(anchors)
    ]
    return np.concatenate([*pieces, anchors[-1:]])


def thin_scans(scan_times: Array, min_spacing_s: float) -> Array:
    """Indices of scans at least a spacing apart, greedily from the first."""
    kept: list[int] = []
    for k, t in enumerate(scan_times):
        if not kept or t - scan_times[kept[-1]] >= min_spacing_s:
            kept.append(k)
    return np.array(kept, dtype=np.int64)
