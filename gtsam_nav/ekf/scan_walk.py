"""The walk of the dead reckoning from scan to scan, whose covariance starts anew at each.

What it adds up to, on the whole and by what lies within scans and between them.
"""

from __future__ import annotations

import numpy as np

from gtsam_nav.ekf.constant_velocity import YAW, Filtered
from gtsam_nav.ekf.distortion import Distortion
from gtsam_nav.frames import Array
from gtsam_nav.series import IntArray
from gtsam_nav.sonar.motion import PlanarMotion


def planar_motion(filtered: Filtered, record: IntArray, has_compass: bool) -> PlanarMotion:
    """The track for deskewing, with the usual growth of its displacement's variance."""
    ends = np.append(record[1:], len(filtered.t) - 1)
    elapsed = np.maximum(filtered.t[ends] - filtered.t[record], 1e-6)
    n, e, yaw = np.diagonal(filtered.P[ends], axis1=1, axis2=2)[:, [0, 1, YAW]].T
    position_growth = float(np.median((n + e) / (2 * elapsed)))
    # an absolute heading's error is drawn anew about every second, that of a turn grows
    yaw_growth = float(np.median(yaw if has_compass else yaw / elapsed))
    track = np.unwrap(filtered.x[:, YAW])
    return PlanarMotion(filtered.t, filtered.x[:, :2], track, position_growth, yaw_growth)


def way_variance(filtered: Filtered, record: IntArray) -> Array:
    """Of the way up to each record, along each axis, but for the compass's drift, shape (r,).

    A walk does not shrink: what a velocity that comes back tells of the way before counts there.
    """
    level = _level_variance(filtered)
    before = np.append(0.0, np.cumsum(level[record]))
    variance = before[np.searchsorted(record, np.arange(len(level)))] + level
    return np.asarray(np.minimum.accumulate(variance[::-1])[::-1])


def between_scans_variance(
    distorted: list[Distortion], filtered: Filtered, record: IntArray
) -> Array:
    """Of the walk to each scan from the one before what lies within neither, (n,), m^2."""
    first, last = np.array([0.5 * np.sum(d.ends**2, axis=(1, 2)) for d in distorted]).T
    walked = _level_variance(filtered)[record]
    return np.asarray(np.maximum(walked - first - np.append(0.0, last[:-1]), 0.0))


def _level_variance(filtered: Filtered) -> Array:
    return np.asarray(0.5 * (filtered.P[:, 0, 0] + filtered.P[:, 1, 1]))
