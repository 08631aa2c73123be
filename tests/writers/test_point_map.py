"""The map as points and as a picture."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import solutions
from PIL import Image

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array, ned_from_geodetic
from gtsam_nav.solution import SonarMap
from gtsam_nav.sonar.occupancy import LEAST_CELL_M, OccupancyGrid, occupancy_grid
from gtsam_nav.trajectory import Trajectory
from gtsam_nav.writers.point_map import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    read_ply,
    write_map_image,
    write_ply,
)


@pytest.fixture(scope="module")
def echoes() -> SonarMap:
    sonar_map = solutions.graph_solution().sonar_map
    assert sonar_map is not None
    return sonar_map


def test_ply_round_trip(echoes: SonarMap, tmp_path: Path) -> None:
    write_ply(echoes, tmp_path / "map.ply")
    back = read_ply(tmp_path / "map.ply")
    np.testing.assert_array_equal(back.points_n, echoes.points_n)
    np.testing.assert_array_equal(back.t, echoes.t)
    np.testing.assert_array_equal(back.strength, echoes.strength)


def test_ply_in_enu(echoes: SonarMap, tmp_path: Path) -> None:
    write_ply(echoes, tmp_path / "map.ply", "enu")
    body = (tmp_path / "map.ply").read_bytes().partition(b"end_header\n")[2]
    east, north, up = np.frombuffer(body[:24], dtype="<f8")
    assert (north, east, -up) == tuple(echoes.points_n[0])
    with pytest.raises(DataError, match=r"map\.ply"):
        read_ply(tmp_path / "map.ply")


def test_a_cut_ply_is_a_data_error(echoes: SonarMap, tmp_path: Path) -> None:
    write_ply(echoes, tmp_path / "map.ply")
    content = (tmp_path / "map.ply").read_bytes()
    (tmp_path / "map.ply").write_bytes(content[:-5])
    with pytest.raises(DataError, match="cut short"):
        read_ply(tmp_path / "map.ply")


def pixels_to_world(path: Path, row_column: Array) -> Array:
    """World x, y of pixel centres by the six lines of a world file."""
    a, d, b, e, c, f = map(float, path.read_text().split())
    row, column = row_column.T
    return np.column_stack([a * column + b * row + c, d * column + e * row + f])


def pixels_of(path: Path, grey: int) -> Array:
    """Rows and columns of the pixels of a grey."""
    with Image.open(path) as picture:
        assert picture.mode == "L"
        return np.argwhere(np.asarray(picture) == grey)


def standing_at(ne: tuple[float, float]) -> Trajectory:
    """Level at a point, north ahead, for longer than any map here took."""
    return Trajectory(
        t=np.array([0.0, 1e4]),
        p_n=np.array([[*ne, 0.0]] * 2),
        q_nb_wxyz=np.array([[1.0, 0, 0, 0]] * 2),
    )


@pytest.mark.parametrize("geodetic", [False, True])
def test_every_occupied_pixel_lies_on_an_echo(
    echoes: SonarMap, tmp_path: Path, geodetic: bool
) -> None:
    origin = solutions.ORIGIN if geodetic else None
    grid = occupancy_grid(echoes, standing_at((0.0, 0.0)), np.zeros(3))
    write_map_image(grid, origin, tmp_path / "map.png")
    occupied = pixels_of(tmp_path / "map.png", OCCUPIED)
    xy = pixels_to_world(tmp_path / "map.pgw", occupied)
    ne = xy[:, ::-1]
    if geodetic:
        ne = ned_from_geodetic(xy[:, 1], xy[:, 0], np.zeros(len(xy)), solutions.ORIGIN)[:, :2]
    nearest = [np.min(np.max(np.abs(echoes.points_n[:, :2] - point), axis=1)) for point in ne[::37]]
    assert len(nearest) > 20
    assert max(nearest) <= 0.5 * LEAST_CELL_M + 2e-3


def test_the_picture_says_free_unknown_and_occupied(tmp_path: Path) -> None:
    probability = np.array([[0.1, 0.5, np.nan], [0.24, 0.66, 1.0]])
    grid = OccupancyGrid(probability, first_ne=np.array([20.0, -3.0]), cell_m=0.5)
    write_map_image(grid, None, tmp_path / "map.png")
    for grey, expected in (
        (FREE, [[0, 0], [1, 0]]), (UNKNOWN, [[0, 1], [0, 2]]), (OCCUPIED, [[1, 1], [1, 2]]),
    ):  # fmt: skip
        np.testing.assert_array_equal(pixels_of(tmp_path / "map.png", grey), expected)
    assert pixels_to_world(tmp_path / "map.pgw", np.array([[1, 2]])).tolist() == [[-2.0, 19.5]]
