"""Occupancy: cells that beams crossed, cells that echoed, cells that nobody saw."""

from __future__ import annotations

import numpy as np

from gtsam_nav.frames import quaternion_from_rpy
from gtsam_nav.solution import SonarMap
from gtsam_nav.sonar.echoes import Echoes
from gtsam_nav.sonar.occupancy import MOST_CELLS, OccupancyGrid, occupancy_grid
from gtsam_nav.sonar.preparation import sonar_map
from gtsam_nav.trajectory import Trajectory


def at_rest(north: float = 0.0, east: float = 0.0) -> Trajectory:
    return Trajectory(
        t=np.array([0.0, 100.0]),
        p_n=np.array([[north, east, 0.0]] * 2),
        q_nb_wxyz=np.array([[1.0, 0, 0, 0]] * 2),
    )


def map_of(*ne_t: tuple[float, float, float]) -> SonarMap:
    n, e, t = np.array(ne_t).T
    return SonarMap(np.column_stack([n, e, np.zeros(len(n))]), t, np.full(len(n), 200.0))


def cell_at(grid: OccupancyGrid, north: float, east: float) -> float:
    row = round((grid.first_ne[0] - north) / grid.cell_m)
    column = round((east - grid.first_ne[1]) / grid.cell_m)
    return float(grid.probability[row, column])


def test_a_wall_is_occupied_what_is_before_it_free_and_behind_it_unknown() -> None:
    wall = [(10.0, e, k / 10) for k, e in enumerate(np.tile(np.arange(-5.0, 5.0, 0.1), 3))]
    grid = occupancy_grid(map_of(*wall, (12.0, 0.0, 90.0)), at_rest(), np.zeros(3))
    assert cell_at(grid, 10.0, 2.0) > 0.9
    assert cell_at(grid, 5.0, 1.0) < 0.2
    assert np.isnan(cell_at(grid, 11.0, -4.0))


def test_only_the_first_echo_of_a_beam_is_seen_through_to() -> None:
    grid = occupancy_grid(map_of((20.0, 0.0, 1.0), (8.1, 0.0, 1.0)), at_rest(), np.zeros(3))
    assert cell_at(grid, 4.1, 0.0) < 0.5
    assert cell_at(grid, 8.1, 0.0) > 0.5
    assert np.isnan(cell_at(grid, 14.1, 0.0))
    assert cell_at(grid, 19.9, 0.0) > 0.5


def test_points_of_one_scan_are_beams_of_their_own() -> None:
    grid = occupancy_grid(map_of((20.0, 0.0, 1.0), (0.0, 8.0, 1.0)), at_rest(), np.zeros(3))
    assert cell_at(grid, 14.1, 0.0) < 0.5
    assert cell_at(grid, -0.1, 4.1) < 0.5


def test_beams_start_at_the_sonar() -> None:
    grid = occupancy_grid(map_of((10.0, 3.0, 1.0)), at_rest(), np.array([0.0, 3.0, 0.5]))
    assert cell_at(grid, 5.0, 3.0) < 0.5
    assert np.sum(grid.probability < 0.5) == 50


def test_the_sonar_of_an_inverted_vehicle_is_on_its_other_side() -> None:
    inverted = Trajectory(
        t=np.array([0.0, 100.0]),
        p_n=np.zeros((2, 3)),
        q_nb_wxyz=np.array([[0.0, 1.0, 0.0, 0.0]] * 2),
    )
    grid = occupancy_grid(map_of((10.0, -3.0, 1.0)), inverted, np.array([0.0, 3.0, 0.5]))
    assert cell_at(grid, 5.0, -3.0) < 0.5


def test_a_rolling_vehicle_does_not_see_through_walls() -> None:
    """Both echoes of each beam are placed as if the vehicle were level, and so is its sonar."""
    t, lever_b = np.arange(0.0, 20.0, 0.1), np.array([0.5, 0.0, 1.0])
    rpy = np.zeros((len(t), 3))
    rpy[:, 0] = np.radians(5.0) * np.sin(2 * np.pi * t / 5.0)
    rolling = Trajectory(t=t, p_n=np.zeros((len(t), 3)), q_nb_wxyz=quaternion_from_rpy(rpy))
    bearing = np.radians(np.linspace(-40.0, 40.0, len(t)))
    ray = np.stack([np.cos(bearing), np.sin(bearing)], axis=1)
    n = len(t)
    echoes = Echoes(
        t=np.tile(t, 2),
        beam=np.tile(np.arange(n), 2),
        xy_b=lever_b[:2] + np.concatenate([10.0 * ray, 20.0 * ray]),
        cov_b=np.tile(np.eye(2), (2 * n, 1, 1)),
        strength=np.full(2 * n, 200.0),
    )
    grid = occupancy_grid(sonar_map(echoes, rolling), rolling, lever_b)
    wall = [cell_at(grid, *xy) for xy in echoes.xy_b[:n]]
    assert min(wall) > 0.5


def test_a_large_map_gets_larger_cells() -> None:
    grid = occupancy_grid(map_of((5000.0, 40.0, 1.0)), at_rest(), np.zeros(3))
    assert max(grid.probability.shape) <= MOST_CELLS + 1
    assert grid.cell_m == 1.25


def odds_at(grid: OccupancyGrid, north: float, east: float) -> float:
    probability = cell_at(grid, north, east)
    return float(np.log(probability / (1.0 - probability)))


def test_odds_are_those_of_octomap_and_limited_to_its_confidence() -> None:
    seen = [(10.1, 0.1, k / 10) for k in range(20)]
    once, often = (
        occupancy_grid(map_of(*echoes), at_rest(0.1, 0.1), np.zeros(3))
        for echoes in (seen[:1], seen)
    )
    np.testing.assert_allclose([odds_at(once, 5.1, 0.1), odds_at(once, 10.1, 0.1)], [-0.4, 0.85])
    np.testing.assert_allclose([odds_at(often, 5.1, 0.1), odds_at(often, 10.1, 0.1)], [-2.0, 3.5])


def test_beams_of_one_time_are_told_apart_by_their_bearing() -> None:
    """A laser's neighbours, two degrees apart: both see through to their own echo."""
    ahead, aside = (20.0, 0.05, 1.0), (40.0, 40.0 * np.tan(np.radians(2.0)), 1.0)
    grid = occupancy_grid(map_of(ahead, aside), at_rest(), np.zeros(3))
    assert cell_at(grid, 30.1, 30.1 * np.tan(np.radians(2.0))) < 0.5
    assert cell_at(grid, 10.1, 0.05) < 0.5
