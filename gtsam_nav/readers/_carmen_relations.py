"""Surveyed relations beside a CARMEN log: ``t1 t2  x y z  roll pitch yaw``, one a line.

The pose (m and rad, x ahead, y to port) at the scan stamped t2 in that at the scan stamped t1.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array
from gtsam_nav.mission import Relations
from gtsam_nav.readers._clock import nearest_of

ENDING = ".relations"
SAME_S = 0.01
"""Stamps that differ by less are of one scan."""


def read_relations(path: Path, sensor: str, stamps: Array) -> tuple[Relations | None, str]:
    """Relations between the scans of a log, and what is to be said of them.

    Parameters
    ----------
    path : Path
    sensor : str
        The scanner.
    stamps : ndarray, shape (n,)
        Of the scans, rising, as they stand in the log.

    Raises
    ------
    DataError
        Where the file is none of numbers.
    """
    try:
        rows = np.loadtxt(path, ndmin=2)
    except (ValueError, OSError) as error:
        raise DataError(f"not a file of relations: {error}", path) from error
    if rows.shape[1] != 8 or not np.all(np.isfinite(rows)):
        raise DataError("a relation is eight numbers: t1 t2 x y z roll pitch yaw", path)
    t = np.sort(rows[:, :2], axis=1)
    known = np.all(np.abs(stamps[nearest_of(stamps, t)] - t) < SAME_S, axis=1)
    known &= rows[:, 0] < rows[:, 1]
    lost = int(np.sum(~known))
    warning = f"{path.name}: {lost} of {len(t)} relations are of no two scans" if lost else ""
    if not np.any(known):
        return None, warning
    # y to starboard and yaw clockwise
    q = rows[known][:, [2, 3, 7]] * [1.0, -1.0, -1.0]
    return Relations(sensor, t[known], q), warning
