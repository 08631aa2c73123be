"""3-D point clouds from files: .npy, .ply and .pcd.

A .npy holds (k, 3) or (k, 4) numbers: x, y, z in the sensor's axes and, as the fourth, the time of
each point after the cloud's stamp, s. In .ply and .pcd these times are the property ``t``.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array
from gtsam_nav.readers._npz import NUMPY_FAULTS
from gtsam_nav.readers._pcd import read_pcd
from gtsam_nav.readers._ply import read_ply
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
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise DataError(f"a cloud is one of: {', '.join(SUFFIXES)}", path)
    if suffix == ".npy":
        return cloud_of(_read_npy(path))
    return cloud_of(_table(read_ply(path) if suffix == ".ply" else read_pcd(path), path))


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
    except NUMPY_FAULTS as error:
        raise DataError(f"cannot read the cloud: {' '.join(str(error).split())}", path) from error
    if not isinstance(table, np.ndarray) or table.dtype.kind != "f":
        raise DataError("a cloud holds floating-point numbers", path)
    if table.ndim != 2 or table.shape[1] not in (3, 4):
        raise DataError(
            f"a cloud has the shape (k, 3), or (k, 4) with each point's time; not {table.shape}",
            path,
        )
    return table


def _table(columns: Mapping[str, Array], path: Path) -> Array:
    missing = [axis for axis in "xyz" if axis not in columns]
    if missing:
        raise DataError(
            f"has points without {', '.join(missing)}; they have: {', '.join(columns) or '-'}", path
        )
    names = (*"xyz", TIME_PROPERTY) if TIME_PROPERTY in columns else (*"xyz",)
    return np.column_stack([columns[name] for name in names])
