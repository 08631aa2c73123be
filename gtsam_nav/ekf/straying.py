"""How far a random walk strays while scans are taken.

The pose of a scan is that of all its beams, whose mean error of the way the scan takes over. At the
end of the scan the walk is elsewhere: from there on it leads to the next.
"""

from __future__ import annotations

import numpy as np

from gtsam_nav.frames import Array


def straying(t: Array, way_variance_m2: Array, beams_s: Array, frame_cov_turned: Array) -> Array:
    """Of all scans.

    Parameters
    ----------
    t : ndarray, shape (r,)
    way_variance_m2 : ndarray, shape (r,)
        Of the way up to each time, along each axis.
    beams_s : ndarray, shape (n, 2)
        When the first and the last beam of each scan came in.
    frame_cov_turned : ndarray, shape (n, 2, 2)
        Of what the heading's changes move a scan by as a whole, and no scan after it, m^2.

    Returns
    -------
    ndarray, shape (n, 4, 4)
        Covariance, m^2, of north and east at the end of each scan from its pose, and of this from
        the end of the scan before.
    """
    begin, end = beams_s.T
    middle, grown = 0.5 * (t[:-1] + t[1:]), np.diff(way_variance_m2)
    scan = np.searchsorted(end, middle)
    before_last = scan < len(end)
    scan, middle, grown = scan[before_last], middle[before_last], grown[before_last]
    # what a step of the walk adds is in all beams after it, a share of their mean
    passed = (middle - begin[scan]) / np.maximum(end - begin, 1e-9)[scan]
    passed = np.maximum(passed, 0.0)
    shares = np.stack([passed, 1.0 - passed], axis=1)
    walk = np.zeros((len(end), 2, 2))
    np.add.at(walk, scan, grown[:, None, None] * shares[:, :, None] * shares[:, None])
    stays = np.array([[1.0, -1.0], [-1.0, 1.0]])
    return np.asarray(np.kron(walk, np.eye(2)) + np.kron(stays, frame_cov_turned))
