"""The map as points and as a picture."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import solutions
from matplotlib.image import imread

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array, ned_from_geodetic
from gtsam_nav.solution import SonarMap
from gtsam_nav.writers.point_map import LEAST_PIXEL_M, read_ply, write_map_image, write_ply


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


def dark_pixels(path: Path) -> Array:
    return np.argwhere(imread(path)[:, :, 0] < 0.9)


@pytest.mark.parametrize("geodetic", [False, True])
def test_every_dark_pixel_lies_on_an_echo(echoes: SonarMap, tmp_path: Path, geodetic: bool) -> None:
    origin = solutions.ORIGIN if geodetic else None
    write_map_image(echoes, origin, tmp_path / "map.png")
    xy = pixels_to_world(tmp_path / "map.pgw", dark_pixels(tmp_path / "map.png"))
    ne = xy[:, ::-1]
    if geodetic:
        ne = ned_from_geodetic(xy[:, 1], xy[:, 0], np.zeros(len(xy)), solutions.ORIGIN)[:, :2]
    nearest = [np.min(np.max(np.abs(echoes.points_n[:, :2] - point), axis=1)) for point in ne[::37]]
    assert len(nearest) > 20
    assert max(nearest) <= 0.5 * LEAST_PIXEL_M + 2e-3


def test_a_large_map_gets_larger_pixels(tmp_path: Path) -> None:
    far = SonarMap(
        points_n=np.array([[0.0, 0, 0], [5000.0, 40.0, 0]]),
        t=np.array([0.0, 1.0]),
        strength=np.array([200.0, 200.0]),
    )
    write_map_image(far, None, tmp_path / "map.png")
    assert max(imread(tmp_path / "map.png").shape) <= 4001
    step = float((tmp_path / "map.pgw").read_text().split()[0])
    assert step == pytest.approx(1.25)
