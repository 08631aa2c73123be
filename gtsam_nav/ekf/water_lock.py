"""What the water's own motion adds to dead reckoning while only it is tracked.

The filter takes the errors of its measurements for white. A current lasts: over a spell without
bottom lock it moves the track by one velocity all along, which averages out in no number of
samples, nor of DVLs: all track the same water. As in ``considered`` it is not estimated, and enters
the covariance.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gtsam_nav.ekf.constant_velocity import VELOCITY, Filtered
from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission
from gtsam_nav.sensors.dvl import water_spells
from gtsam_nav.sensors.noise import DvlNoise


def with_water_motion(
    filtered: Filtered, since_s: Array, mission: Mission, water_lock_after_s: float
) -> Filtered:
    """Records of the filter, with the covariance that the water's motion adds.

    Parameters
    ----------
    filtered : Filtered
    since_s : ndarray, shape (n,)
        From when on each record's covariance of the position counts.
    mission : Mission
    water_lock_after_s : float
        Longest absence of bottom lock that is bridged without water lock.
    """
    dvls = mission.of_type("dvl")
    if not dvls:
        return filtered
    P = filtered.P.copy()
    level = [VELOCITY.start, VELOCITY.start + 1]
    # one current, as strong as the most that a card states
    variance = max(DvlNoise.model_validate(dvl.noise).water_sigma_m_s for dvl in dvls) ** 2
    for first, last in water_spells(dvls, water_lock_after_s).tolist():
        moved_s = np.minimum(filtered.t, last) - np.maximum(since_s, first)
        added = variance * np.maximum(moved_s, 0.0) ** 2
        inside = (filtered.t >= first) & (filtered.t <= last)
        for k in (0, 1):
            P[:, k, k] += added
            P[inside, level[k], level[k]] += variance
    return replace(filtered, P=P)
