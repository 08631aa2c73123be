"""Occupancy from echoes: what the sonar saw through, what it saw, and what it never saw.

Each beam takes from the cells up to its first echo and gives to the cell of every echo, in log
odds: Hornung et al., *OctoMap: an efficient probabilistic 3D mapping framework based on octrees*,
Autonomous Robots 34, 2013, whose sensor model and limits these are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.series import BoolArray, IntArray
from gtsam_nav.solution import SonarMap
from gtsam_nav.sonar.motion import lies_inverted, placed_in_plane
from gtsam_nav.trajectory import Trajectory

LOG_ODDS_HIT, LOG_ODDS_MISS = 0.85, -0.4
LOG_ODDS_LIMITS = (-2.0, 3.5)
LEAST_CELL_M = 0.2
MOST_CELLS = 4000
"""Along a side; a larger map gets larger cells."""
SAME_BEAM_RAD = 1e-4
"""Echoes of one time that lie closer in bearing are of one beam."""


@dataclass(frozen=True)
class OccupancyGrid:
    """North-up cells.

    Attributes
    ----------
    probability : ndarray, shape (rows, columns)
        Of being occupied; the first row is the northernmost, NaN is what was never seen.
    first_ne : ndarray, shape (2,)
        North and east of the centre of the first cell, m.
    cell_m : float
    """

    probability: Array
    first_ne: Array
    cell_m: float


def occupancy_grid(echoes: SonarMap, trajectory: Trajectory, lever_b: Array) -> OccupancyGrid:
    """Occupancy of a map's cells.

    Parameters
    ----------
    echoes : SonarMap
        At least one echo, as the trajectory places them.
    trajectory : Trajectory
        Of the body's origin.
    lever_b : ndarray, shape (3,)
        The sonar in body coordinates, m.
    """
    from gtsam_nav.sonar._rays import count_rays

    ne = echoes.points_n[:, :2]
    # placed as its echoes are, or those of one beam would not lie in one direction
    inverted = lies_inverted(trajectory, echoes.t)
    levers_b = np.where(inverted[:, None], lever_b[:2] * [1.0, -1.0], lever_b[:2])
    sonar_ne = placed_in_plane(trajectory, echoes.t, levers_b)[:, :2]
    everything = np.concatenate([ne, sonar_ne])
    low, high = everything.min(axis=0), everything.max(axis=0)
    cell_m = max(LEAST_CELL_M, float(np.max(high - low)) / MOST_CELLS)
    corner, down_right = np.array([high[0], low[1]]), np.array([-1.0, 1.0])

    def cells(points_ne: Array) -> IntArray:
        return np.asarray(np.floor((points_ne - corner) * down_right / cell_m), dtype=np.int64)

    rows, columns = (cells(np.array([low[0], high[1]])) + 1).tolist()
    nearest = _nearest_of_beam(echoes.t, ne - sonar_ne)
    hits, misses = count_rays(cells(sonar_ne), cells(ne), nearest, rows, columns)
    log_odds = np.clip(LOG_ODDS_HIT * hits + LOG_ODDS_MISS * misses, *LOG_ODDS_LIMITS)
    probability = np.where(hits + misses > 0, 1.0 / (1.0 + np.exp(-log_odds)), np.nan)
    return OccupancyGrid(probability, corner + 0.5 * cell_m * down_right, cell_m)


def _nearest_of_beam(t: Array, ray_ne: Array) -> BoolArray:
    """Which echoes are the first of their beam, shape (k,)."""
    bearing = np.round(np.arctan2(ray_ne[:, 1], ray_ne[:, 0]) / SAME_BEAM_RAD)
    order = np.lexsort((np.hypot(*ray_ne.T), bearing, t))
    begins = np.ones(len(t), dtype=bool)
    begins[1:] = (np.diff(t[order]) > 0) | (np.diff(bearing[order]) != 0)
    nearest = np.zeros(len(t), dtype=bool)
    nearest[order] = begins
    return nearest
