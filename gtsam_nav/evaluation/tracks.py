"""Where a solution is drawn: at the reference's antenna, aligned where it has no absolute place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtsam_nav.evaluation.alignment import align
from gtsam_nav.evaluation.matching import match
from gtsam_nav.evaluation.metrics import reference_series
from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission
from gtsam_nav.solution import Solution
from gtsam_nav.trajectory import Trajectory


@dataclass(frozen=True)
class Track:
    """A solution as drawn: its path at the reference's antenna, moved by R, p where need be.

    Attributes
    ----------
    solution : Solution
    R, p : ndarray, shape (3, 3) and (3,)
        From the solution's frame to the drawing's.
    lever_b : ndarray, shape (3,)
        The antenna in body coordinates, m.
    path_n : ndarray, shape (n, 3)
        At the times of the solution's trajectory, m.
    note : str
        What is said of it beside the method's name.
    """

    solution: Solution
    R: Array
    p: Array
    lever_b: Array
    path_n: Array
    note: str

    def place(self, points_n: Array) -> Array:
        """Points of the solution's frame where they are drawn, shape (k, 3)."""
        return points_n @ self.R.T + self.p

    def path_of(self, trajectory: Trajectory) -> Array:
        """Another trajectory of the solution as its own is drawn, shape (m, 3)."""
        return self.place(trajectory.at_lever_arm(self.lever_b).p_n)

    def at(self, t: Array) -> Array:
        """East and north of the path at times, each of the shape of t."""
        own = self.solution.trajectory.t
        return np.stack([np.interp(t, own, self.path_n[:, axis]) for axis in (1, 0)])


def track_of(solution: Solution) -> Track:
    """A solution as drawn; one without absolute positions after its SE(2) alignment."""
    R, p, lever_b, note = np.eye(3), np.zeros(3), np.zeros(3), ""
    reference = solution.reference
    if reference is not None:
        lever_b = reference.xyz_b
        if not solution.georeferenced:
            matched = match(solution.trajectory, reference_series(reference), lever_b)
            aligned = align(matched, "se2") if matched else None
            if aligned is not None:
                R, p, note = aligned.R, aligned.p, " (SE(2)-aligned)"
    path_n = solution.trajectory.at_lever_arm(lever_b).p_n @ R.T + p
    return Track(solution, R, p, lever_b, path_n, note)


def map_name(mission: Mission) -> str:
    """What a map is made of."""
    if mission.first("beams") is not None:
        return "sonar map"
    return "map of the clouds" if mission.first("clouds") is not None else "map of the scans"
