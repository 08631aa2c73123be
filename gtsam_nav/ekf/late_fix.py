"""A dead-reckoned track whose one fix came late: carried back from where it was taken."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission
from gtsam_nav.preprocess.alignment import PUNCTUAL_S, Alignment, start_fix
from gtsam_nav.trajectory import Trajectory


def through_late_fix(track: Trajectory, mission: Mission, start: Alignment) -> Trajectory:
    """The track moved through its fix, where that was not the start's.

    Its uncertainty is the fix's, and what dead reckoning adds until then and until each time: as
    if these were independent, which is more than what lies between the two. A depth that is
    measured stays.
    """
    fix = start_fix(mission) if mission.initial.p_n is None and start.heading_known else None
    if fix is None or fix.t - start.t <= PUNCTUAL_S:
        return track
    assert track.cov_pose_n is not None
    k = int(np.argmin(np.abs(track.t - fix.t)))
    carried = np.stack([np.interp(fix.t, track.t, axis) for axis in track.p_n.T])
    off = carried + track.R_nb[k] @ fix.lever_b - fix.p_n
    axes = slice(2 if mission.first("depth") is not None else 3)
    p_n, cov = track.p_n.copy(), track.cov_pose_n.copy()
    p_n[:, axes] -= off[axes]
    reckoned: Array = cov[:, axes, axes] - np.diag(start.sigma_p[axes] ** 2)
    cov[:, axes, axes] = reckoned + reckoned[k] + np.diag(fix.sigma[axes] ** 2)
    return replace(track, p_n=p_n, cov_pose_n=cov)
