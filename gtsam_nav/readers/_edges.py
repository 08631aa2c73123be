"""Edges of planar pose graphs, whose axes are x forward and y to port, poses one a second."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from gtsam_nav.frames import Array, rotation_from_rpy
from gtsam_nav.mission import PoseEdges, Rejection
from gtsam_nav.preprocess.cleaning import tidy
from gtsam_nav.readers._table import read_table
from gtsam_nav.series import BoolArray, IntArray, OdometrySeries

TO_STARBOARD = np.array([1.0, -1.0, -1.0])
"""From x, y and theta, counter-clockwise, to forward, starboard and yaw."""
COV_COLUMNS = ("xx", "xy", "xw", "yy", "yw", "ww")
"""Of the covariance of forward, starboard and yaw: m^2, m rad and rad^2."""


def split_edges(
    ends: IntArray, steps: Array, cov: Array, odometry: Mapping[str, Array]
) -> tuple[PoseEdges | None, OdometrySeries | None, list[Rejection]]:
    """A graph's edges, and the odometry that those between neighbours are.

    Parameters
    ----------
    ends : ndarray of int, shape (n, 2)
        Places of the two poses in their order.
    steps : ndarray, shape (n, 3)
        x, y (m) and theta (rad, counter-clockwise) of the second in the axes of the first.
    cov : ndarray, shape (n, 3, 3)
        Along the axes of the second, as these files have it.
    odometry : mapping of str to ndarray
        Columns of an `OdometrySeries` of all edges, true of those between neighbours.

    Returns
    -------
    edges : PoseEdges or None
        None of a graph without loops: odometry says it all.
    series : OdometrySeries or None
    rejections : list of Rejection
        By the number of the edge.
    """
    apart = np.abs(ends[:, 1] - ends[:, 0])
    sound = np.all(np.isfinite(steps), axis=1) & _definite(cov)
    own = np.flatnonzero((apart <= 1) | ~sound)
    refused = {"joins a pose to itself": apart == 0, "says nothing finite": (apart > 1) & ~sound}
    series, rejections = tidy(
        OdometrySeries,
        "odometry",
        {name: column[own] for name, column in odometry.items()},
        refused={reason: mask[own] for reason, mask in refused.items()},
    )
    if series is not None:
        series = replace(series, row=own[series.row])
    rejections = [replace(r, index=int(own[r.index])) for r in rejections]
    loops = sound & (apart > 1)
    kept = sound & (apart > 0)
    edges = _edges(ends[kept], steps[kept], cov[kept]) if np.any(loops) else None
    return edges, series, rejections


def _definite(cov: Array) -> BoolArray:
    finite = np.all(np.isfinite(cov), axis=(1, 2))
    smallest = np.linalg.eigvalsh(np.where(finite[:, None, None], cov, -np.eye(3)))[:, 0]
    return np.asarray(smallest > 0)


def _edges(ends: IntArray, steps: Array, cov: Array) -> PoseEdges:
    turn = rotation_from_rpy(np.column_stack([np.zeros((len(steps), 2)), steps[:, 2]]))
    to_first = TO_STARBOARD[:, None] * turn
    return PoseEdges(
        t=ends.astype(float),
        q=steps * TO_STARBOARD,
        cov=to_first @ cov @ np.swapaxes(to_first, 1, 2),
    )


def read_edges(path: Path) -> tuple[PoseEdges | None, int]:
    """The edges that a mission folder holds, and how many of the file's are none.

    Raises
    ------
    DataError
        Where the file is malformed.
    """
    table = read_table(path, ("t_from", "t", "x", "y", "yaw_deg", *COV_COLUMNS))
    c = table.columns
    t = np.column_stack([c["t_from"], c["t"]])
    q = np.column_stack([c["x"], c["y"], np.radians(c["yaw_deg"])])
    cov = np.empty((len(t), 3, 3))
    upper, right = np.triu_indices(3)
    cov[:, upper, right] = cov[:, right, upper] = np.column_stack([c[n] for n in COV_COLUMNS])
    kept = np.all(np.isfinite(np.hstack([t, q])), axis=1) & _definite(cov) & (t[:, 0] != t[:, 1])
    edges = PoseEdges(t[kept], q[kept], cov[kept]) if np.any(kept) else None
    return edges, int(np.sum(~kept)) + (table.cut_stamp is not None)
