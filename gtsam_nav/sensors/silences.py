"""When a sensor says nothing."""

from __future__ import annotations

import numpy as np

from gtsam_nav.frames import Array


def silent_spells(t: Array, from_s: float, to_s: float, longest_s: float) -> Array:
    """First and last moment of each spell within a span, longer than so, without a stamp.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Stamps, s, increasing.

    Returns
    -------
    ndarray, shape (k, 2)
    """
    marks = np.concatenate([[from_s], t[(t > from_s) & (t < to_s)], [to_s]])
    long = np.flatnonzero(np.diff(marks) > longest_s)
    return np.column_stack([marks[long], marks[long + 1]])
