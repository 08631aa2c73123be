"""The sonar map: points as PLY, and its occupancy as a north-up picture with a world file."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array, Origin, geodetic_from_ned
from gtsam_nav.solution import SonarMap
from gtsam_nav.sonar.occupancy import OccupancyGrid
from gtsam_nav.writers.frame import Frame, express_points

OCCUPIED, UNKNOWN, FREE = 0, 205, 254
"""Greys of the picture, as map servers have them."""
FREE_BELOW, OCCUPIED_ABOVE = 0.25, 0.65
"""Probabilities of being occupied beyond which a cell is said to be one or the other."""

PLY_POINT = np.dtype([("x", "<f8"), ("y", "<f8"), ("z", "<f8"), ("t", "<f8"), ("intensity", "u1")])


def _ply_header(n_points: int, frame: Frame) -> bytes:
    names = {"<f8": "double", "|u1": "uchar"}
    properties = [f"property {names[PLY_POINT[n].str]} {n}" for n in PLY_POINT.names or ()]
    lines = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment local {frame.upper()}, metres; t in mission seconds",
        f"element vertex {n_points}",
        *properties,
        "end_header",
    ]
    return ("\n".join(lines) + "\n").encode("ascii")


def write_ply(sonar_map: SonarMap, path: Path, frame: Frame = "ned") -> None:
    """Write the echoes as a binary PLY with x, y, z (m), t (s) and intensity (0..255)."""
    points = np.zeros(len(sonar_map.t), dtype=PLY_POINT)
    points["x"], points["y"], points["z"] = express_points(sonar_map.points_n, frame).T
    points["t"] = sonar_map.t
    points["intensity"] = np.clip(np.round(sonar_map.strength), 0, 255)
    path.write_bytes(_ply_header(len(points), frame) + points.tobytes())


def read_ply(path: Path) -> SonarMap:
    """Read what `write_ply` wrote in NED.

    Raises
    ------
    DataError
        Where the file is another kind of PLY, or cut short.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise DataError(f"cannot be read: {error}", path) from error
    header, end, body = content.partition(b"end_header\n")
    n_points = len(body) // PLY_POINT.itemsize
    if header + end != _ply_header(n_points, "ned") or len(body) % PLY_POINT.itemsize:
        raise DataError("not a map.ply of a run, or cut short", path)
    points = np.frombuffer(body, dtype=PLY_POINT)
    return SonarMap(
        points_n=np.column_stack([points["x"], points["y"], points["z"]]),
        t=points["t"].astype(float),
        strength=points["intensity"].astype(float),
    )


def write_map_image(grid: OccupancyGrid, origin: Origin | None, path: Path) -> None:
    """Write a north-up picture of the occupancy, and beside it the world file ``.pgw``.

    Black is occupied, white is free, grey is unknown. The world file is in degrees (WGS-84) where
    there is an origin, else in metres (x east, y north).
    """
    from PIL import Image

    grey = np.full(grid.probability.shape, UNKNOWN, dtype=np.uint8)
    grey[grid.probability < FREE_BELOW] = FREE
    grey[grid.probability > OCCUPIED_ABOVE] = OCCUPIED
    Image.fromarray(grey).save(path)
    path.with_suffix(".pgw").write_text(
        _world_file(grid.first_ne, grid.cell_m, origin), encoding="ascii", newline="\n"
    )


def _world_file(corner_ne: Array, pixel_m: float, origin: Origin | None) -> str:
    """Six lines: x and y of a step right, of a step down, and of the first pixel's centre."""
    ne = corner_ne + pixel_m * np.array([[0.0, 0.0], [0.0, 1.0], [-1.0, 0.0]])
    if origin is None:
        xy = ne[:, ::-1]
    else:
        latitude, longitude, _ = geodetic_from_ned(np.column_stack([ne, np.zeros(3)]), origin)
        xy = np.column_stack([longitude, latitude])
    right, down = xy[1] - xy[0], xy[2] - xy[0]
    return "".join(f"{value:.15g}\n" for value in (*right, *down, *xy[0]))
