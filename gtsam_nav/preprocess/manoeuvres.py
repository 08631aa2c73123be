"""Readings of a velocity that a gate refused, although no more than a manoeuvre lies behind them.

A gate expects changes as the motion model has them. A vehicle that speeds up for a few seconds goes
beyond it, and goes on being refused at its new speed, reading by reading, until the model allows
for so much. A spike is short, and a false echo begins with a jump: what is refused for longer, and
joins what was believed by steps that a vehicle can make, is neither.
"""

from __future__ import annotations

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.series import BoolArray

LONGEST_SPIKE_S = 1.0
FEWEST = 4
"""Readings refused on end that are more than spikes."""
HARDEST_M_S2 = 1.5
"""No vessel gains or loses speed faster for long."""
STEP_SIGMAS = 4.0


def in_manoeuvres(t: Array, v: Array, sigma: Array, refused: BoolArray) -> BoolArray:
    """Which refused readings are to be believed all the same.

    Parameters
    ----------
    t, v, sigma : ndarray, shape (n,)
        Times, one component of the velocity, m/s, and its white noise.
    refused : ndarray of bool, shape (n,)
    """
    believed = np.zeros(len(t), dtype=bool)
    if len(t) < 2:
        return believed
    bound = HARDEST_M_S2 * np.diff(t) + STEP_SIGMAS * np.hypot(sigma[1:], sigma[:-1])
    is_joined = np.abs(np.diff(v)) <= bound
    edges = np.flatnonzero(np.diff(np.concatenate([[False], refused, [False]])))
    for begin, end in edges.reshape(-1, 2).tolist():
        lasts = t[end - 1] - t[begin] >= LONGEST_SPIKE_S and end - begin >= FEWEST
        if lasts and begin and is_joined[begin - 1]:
            run = np.arange(begin, end)
            after = np.minimum(run, len(is_joined) - 1)
            believed[run] = is_joined[run - 1] & is_joined[after]
    return believed
