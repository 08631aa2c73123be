"""The edges of a mission folder: one CSV table, of edges in the plane or in space.

What the plane leaves out are columns more: ``z``, ``roll_deg``, ``pitch_deg``, and the covariances
that they have with each other and with the rest.
"""

from __future__ import annotations

from itertools import combinations_with_replacement
from pathlib import Path

import numpy as np

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array, rotation_from_rpy, rpy_from_rotation
from gtsam_nav.mission import Rejection
from gtsam_nav.pose_edges import EDGES, PoseEdges
from gtsam_nav.readers._edges import NOT_FINITE, ONTO_ITSELF
from gtsam_nav.readers._matrices import definite, symmetric, turn_first, upper_triangle
from gtsam_nav.readers._table import STAMPS, read_table


def _covariances(axes: str) -> tuple[str, ...]:
    """Names of a covariance's upper triangle, row by row."""
    return tuple(a + b for a, b in combinations_with_replacement(axes, 2))


COV_COLUMNS, SPATIAL_COV_COLUMNS = _covariances("xyw"), _covariances("xyzuvw")
"""Of shift forward, to starboard and down and of turn about these (``u``, ``v``, ``w``), all along
the axes at t_from: m^2, m rad and rad^2."""
PLACE, ANGLES = ("x", "y", "z"), ("roll_deg", "pitch_deg", "yaw_deg")
COLUMNS = ("t_from", "t", "x", "y", "yaw_deg", *COV_COLUMNS)
MORE_IN_SPACE = (
    *("z", "roll_deg", "pitch_deg"),
    *(name for name in SPATIAL_COV_COLUMNS if name not in COV_COLUMNS),
)


def read_edges(path: Path, stamp_s: float) -> tuple[PoseEdges | None, list[Rejection]]:
    """The edges that a mission folder holds, and those of the file's that are none.

    Parameters
    ----------
    path : Path
    stamp_s : float
        Unit of the file's stamps, s.

    Raises
    ------
    DataError
        Where the file is malformed.
    """
    table = read_table(path, COLUMNS, MORE_IN_SPACE, scale=dict.fromkeys(STAMPS, stamp_s))
    c = table.columns
    missing = [name for name in MORE_IN_SPACE if name not in c]
    in_space = len(missing) < len(MORE_IN_SPACE)
    if in_space and missing:
        raise DataError(f"edges in space need the columns {', '.join(missing)} too", path)
    t = np.column_stack([c["t_from"], c["t"]])
    places, angles = PLACE[: 2 + in_space], ANGLES[0 if in_space else 2 :]
    names, size = (SPATIAL_COV_COLUMNS, 6) if in_space else (COV_COLUMNS, 3)
    p = np.column_stack([c[name] for name in places])
    rpy = np.radians(np.column_stack([c[name] for name in angles]))
    cov = symmetric(np.column_stack([c[name] for name in names]), size)
    sound = np.all(np.isfinite(np.hstack([t, p, rpy])), axis=1) & definite(cov)
    kept = sound & (t[:, 0] != t[:, 1])
    rejections = [
        Rejection(float(t[k, 1]), EDGES, k, ONTO_ITSELF if sound[k] else NOT_FINITE)
        for k in np.flatnonzero(~kept).tolist()
    ]
    rejections += table.cut(EDGES)
    t, p, rpy, cov = t[kept], p[kept], rpy[kept], cov[kept]
    if not len(t):
        return None, rejections
    if in_space:
        return _in_space(t, p, rpy, cov), rejections
    return PoseEdges.in_plane(t, np.hstack([p, rpy]), cov), rejections


def _in_space(t: Array, p_a: Array, rpy: Array, cov: Array) -> PoseEdges:
    R_ab = rotation_from_rpy(rpy)
    # along the pose's own axes
    to_b = np.kron(np.eye(2), np.swapaxes(R_ab, 1, 2))
    information = to_b @ np.linalg.inv(cov) @ np.swapaxes(to_b, 1, 2)
    return PoseEdges(t, R_ab, p_a, turn_first(information))


def edge_columns(edges: PoseEdges) -> dict[str, Array]:
    """What `read_edges` reads."""
    columns = dict(zip(("t_from", "t"), edges.t.T, strict=True))
    if not edges.in_space:
        columns |= {"x": edges.q[:, 0], "y": edges.q[:, 1], "yaw_deg": np.degrees(edges.q[:, 2])}
        return columns | dict(zip(COV_COLUMNS, upper_triangle(edges.cov).T, strict=True))
    columns |= dict(zip(PLACE, edges.p_a.T, strict=True))
    rpy_deg = np.degrees(rpy_from_rotation(edges.R_ab))
    columns |= dict(zip(ANGLES, rpy_deg.T, strict=True))
    to_a = np.kron(np.eye(2), edges.R_ab)
    cov = turn_first(to_a @ np.linalg.inv(edges.information) @ np.swapaxes(to_a, 1, 2))
    return columns | dict(zip(SPATIAL_COV_COLUMNS, upper_triangle(cov).T, strict=True))
