"""The motion between 3-D clouds, by cloud odometry, as relative poses of keyframes."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from gtsam_nav.config import Config
from gtsam_nav.graph import factors
from gtsam_nav.graph.factors import X
from gtsam_nav.graph.problem import Problem
from gtsam_nav.odometry.cloud_track import CloudTrack
from gtsam_nav.trajectory import SAME_TIME_S


def cloud_keyframes(problem: Problem, track: CloudTrack) -> dict[int, int]:
    """Keyframe of each kept cloud that has one, by the cloud's index in the track.

    A cloud has none where something else was measured at nearly the same time, or nothing was.
    """
    t = np.array([cloud.t for cloud in track.key])
    nearest = problem.keyframe_nearest(t)
    same = np.abs(problem.t[nearest] - t) < SAME_TIME_S
    return {j: int(nearest[j]) for j in np.flatnonzero(same).tolist()}


def add(problem: Problem, track: CloudTrack, config: Config) -> None:
    """Relative poses of successive keyframes that have a cloud."""
    problem.rejections += track.rejections
    for (i, a), (j, b) in pairwise(cloud_keyframes(problem, track).items()):
        factor = factors.relative_pose(X(a), X(b), track.increment(i, j))
        problem.add(b, track.sensor, factor, config.graph.robust.clouds)
