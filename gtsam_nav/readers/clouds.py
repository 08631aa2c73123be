"""3-D point clouds from files: .npy by NumPy, .ply and .pcd by Open3D.

A .npy holds (k, 3) or (k, 4) numbers: x, y, z in the sensor's axes and, as the fourth, the time of
each point after the cloud's stamp, s. In .ply and .pcd these times are the property ``t`` (float).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gtsam_nav.errors import DataError
from gtsam_nav.registration.packages import open3d
from gtsam_nav.series import Cloud, StoredCloud

SUFFIXES = (".npy", ".ply", ".pcd")
TIME_PROPERTY = "t"


def load(source: Path | Cloud | StoredCloud) -> Cloud:
    """A cloud that is in memory already, or the one that a place holds; see `read_cloud`."""
    if isinstance(source, Cloud):
        return source
    return read_cloud(source) if isinstance(source, Path) else source.read()


def read_cloud(path: Path) -> Cloud:
    """Read a cloud; points that are not finite are dropped, as sensors mark rays without echo so.

    Raises
    ------
    DataError
        Where the file is damaged, or of another kind.
    PackageError
        Where it is a .ply or .pcd and Open3D does not import.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise DataError(f"a cloud is one of: {', '.join(SUFFIXES)}", path)
    table = _read_npy(path) if suffix == ".npy" else _read_by_open3d(path)
    return cloud_of(table)


def cloud_of(table: NDArray[np.floating[Any]]) -> Cloud:
    """The finite points of a table (k, 3) or, with times, (k, 4) as a cloud."""
    table = table[np.all(np.isfinite(table), axis=1)]
    return Cloud(table[:, :3], table[:, 3] if table.shape[1] == 4 else None)


def cloud_table(cloud: Cloud) -> NDArray[np.floating[Any]]:
    """A cloud as the table that a .npy holds, shape (k, 3) or (k, 4)."""
    if cloud.offset_s is None:
        return cloud.points_s
    return np.column_stack([cloud.points_s, cloud.offset_s])


def _read_npy(path: Path) -> NDArray[np.floating[Any]]:
    try:
        table = np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError, SyntaxError) as error:
        raise DataError(f"cannot read the cloud: {' '.join(str(error).split())}", path) from error
    if not isinstance(table, np.ndarray) or table.dtype.kind != "f":
        raise DataError("a cloud holds floating-point numbers", path)
    if table.ndim != 2 or table.shape[1] not in (3, 4):
        raise DataError(
            f"a cloud has the shape (k, 3), or (k, 4) with each point's time; not {table.shape}",
            path,
        )
    return table


def _read_by_open3d(path: Path) -> NDArray[np.floating[Any]]:
    o3d = open3d(f"reading {path.name}")
    # a damaged file gives an empty cloud and a line on the terminal
    with o3d.utility.VerbosityContextManager(o3d.utility.VerbosityLevel.Error):
        read = o3d.t.io.read_point_cloud(str(path))
    if "positions" not in read.point or not len(read.point.positions):
        raise DataError("Open3D finds no points with x, y and z in it", path)
    columns = [read.point.positions.numpy()]
    if TIME_PROPERTY in read.point:
        columns.append(read.point[TIME_PROPERTY].numpy().reshape(-1, 1))
    return np.hstack(columns).astype(float)
