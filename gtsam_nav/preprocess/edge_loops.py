"""Which edges of a mission close loops, before there are keyframes."""

from __future__ import annotations

import numpy as np

from gtsam_nav.mission import Mission
from gtsam_nav.preprocess.edge_motion import moves_by_edges

KEYFRAMES_S = 5.0
"""Keyframes of the graph are no farther apart where more than edges tells of the motion."""


def n_loops(mission: Mission) -> int:
    """How many edges join poses that do not follow each other: a pose of another edge lies between
    them, or they are so far apart that a keyframe does."""
    edges = mission.edges
    if edges is None:
        return 0
    place = np.unique(edges.t, return_inverse=True)[1].reshape(-1, 2)
    over_others = np.abs(np.diff(place, axis=1))[:, 0] > 1
    far = np.abs(np.diff(edges.t, axis=1))[:, 0] > KEYFRAMES_S
    return int(np.sum(over_others | (far & (not moves_by_edges(mission)))))
