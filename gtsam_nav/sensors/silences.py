"""When a sensor says nothing."""

from __future__ import annotations

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.series import BoolArray

LEAST_SILENCE_S, USUAL_STEPS = 1.0, 3.0
"""Stamps fall silent over more than both: so long, and so many of their usual steps."""


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


def longest_step_s(t: Array) -> float:
    """Longest step between stamps (n,) that is no silence yet, s."""
    usual_s = float(np.median(np.diff(t))) if len(t) > 1 else 0.0
    return max(LEAST_SILENCE_S, USUAL_STEPS * usual_s)


def is_heard(stamps: Array, t: Array, longest_s: float) -> BoolArray:
    """Whether times (k,) lie between stamps (n,) no further apart than so, or as near to an end."""
    gap_s = np.concatenate([[0.0], np.diff(stamps), [0.0]])
    around = (gap_s[np.searchsorted(stamps, t, side)] for side in ("left", "right"))
    beyond_s = np.maximum(stamps[0] - t, t - stamps[-1])
    return np.asarray((np.minimum(*around) <= longest_s) & (beyond_s <= longest_s))
