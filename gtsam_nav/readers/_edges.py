"""Edges of pose graphs, whose axes are x forward, y to port and z up, poses one a second."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gtsam_nav.errors import DataError
from gtsam_nav.frames import FLU_FROM_FRD, Array, rotation_from_rpy, rpy_from_rotation
from gtsam_nav.mission import Mission, Rejection
from gtsam_nav.pose_edges import EDGES, PoseEdges
from gtsam_nav.preprocess.cleaning import tidy
from gtsam_nav.readers._clock import on_mission_time
from gtsam_nav.readers._graph_lines import GraphLines
from gtsam_nav.readers._matrices import definite
from gtsam_nav.readers._odometry import step_speeds
from gtsam_nav.readers._text import TRUNCATED
from gtsam_nav.sensors.noise import OdometryNoise
from gtsam_nav.series import IntArray, OdometrySeries

TO_STARBOARD = np.array([1.0, -1.0, -1.0])
"""From x, y and theta, counter-clockwise, to forward, starboard and yaw."""
FLAT = 1e-3
"""Steps that rise by less, as a share of their length, and tilt by less (rad), lie in the plane."""
ONTO_ITSELF, NOT_FINITE = "joins a pose to itself", "says nothing finite"


def split_edges(
    ends: IntArray, steps: Array, cov: Array, noise: OdometryNoise | None = None
) -> tuple[PoseEdges | None, OdometrySeries | None, list[Rejection]]:
    """A planar graph's edges, and the odometry that those between neighbours are.

    Parameters
    ----------
    ends : ndarray of int, shape (n, 2)
        Places of the two poses in their order.
    steps : ndarray, shape (n, 3)
        x, y (m) and theta (rad, counter-clockwise) of the second in the axes of the first.
    cov : ndarray, shape (n, 3, 3)
        Along the axes of the second, as these files have it.
    noise : OdometryNoise, optional
        That of the odometry, where it is known better than by ``cov``.

    Returns
    -------
    edges : PoseEdges or None
        None of a graph without loops: odometry says it all.
    series : OdometrySeries or None
    rejections : list of Rejection
        By the number of the edge: in neither, all others are where they belong.
    """
    apart = np.abs(ends[:, 1] - ends[:, 0])
    sound = np.all(np.isfinite(steps), axis=1) & definite(cov)
    own = np.flatnonzero((apart <= 1) | ~sound)
    refused = {ONTO_ITSELF: apart == 0, NOT_FINITE: ~sound}
    odometry = _odometry(ends, np.where(sound[:, None], steps, np.nan), cov, noise)
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
    edges = _planar(ends[kept], steps[kept], cov[kept]) if np.any(loops) else None
    return edges, series, rejections


def _odometry(
    ends: IntArray, steps: Array, cov: Array, noise: OdometryNoise | None
) -> dict[str, Array]:
    """Columns of an `OdometrySeries` of all edges, as if all joined neighbours."""
    a, b = ends.T
    x, y, theta = steps.T
    c, s = np.cos(theta), np.sin(theta)
    backward = np.column_stack([-c * x - s * y, s * x - c * y, -theta])
    forward = np.where((b < a)[:, None], backward, steps)
    v_b, yaw_rate = step_speeds(forward, np.ones(len(steps)))
    if noise is None:
        sigma_v = np.sqrt(np.maximum(cov[:, 0, 0], cov[:, 1, 1]))
        sigma_yaw_rate = np.sqrt(cov[:, 2, 2])
    else:
        sigma_v = np.full(len(steps), noise.sigma_v_m_s)
        sigma_yaw_rate = np.full(len(steps), noise.sigma_yaw_rate_rad_s)
    return {
        # the mean over the second between two poses
        "t": np.minimum(a, b) + 0.5,
        "v_b": v_b,
        "yaw_rate": yaw_rate,
        "sigma_v": sigma_v,
        "sigma_yaw_rate": sigma_yaw_rate,
    }


def _planar(ends: IntArray, steps: Array, cov: Array) -> PoseEdges:
    turn = rotation_from_rpy(np.column_stack([np.zeros((len(steps), 2)), steps[:, 2]]))
    to_first = TO_STARBOARD[:, None] * turn
    return PoseEdges.in_plane(
        t=ends.astype(float),
        q=steps * TO_STARBOARD,
        cov=to_first @ cov @ np.swapaxes(to_first, 1, 2),
    )


def are_flat(R_ab: Array, p_a: Array) -> bool:
    """Whether relative poses, what is finite of them, neither climb nor tilt."""
    x, y, z = p_a[np.all(np.isfinite(p_a), axis=1)].T
    rise = np.abs(z) / np.maximum(np.hypot(x, y), 1.0)
    tilt = np.abs(rpy_from_rotation(R_ab)[:, :2])
    return not (np.any(rise > FLAT) or np.any(tilt > FLAT))


def spatial_edges(
    ends: IntArray, R_ab: Array, p_a: Array, information: Array
) -> tuple[PoseEdges | None, list[Rejection]]:
    """A graph's edges in space.

    Parameters
    ----------
    ends : ndarray of int, shape (n, 2)
        Places of the two poses in their order.
    R_ab, p_a : ndarray, shapes (n, 3, 3) and (n, 3)
        The second in the axes of the first.
    information : ndarray, shape (n, 6, 6)
        Turn, then shift, along the axes of the second.

    Returns
    -------
    edges : PoseEdges or None
        None where none is of use.
    rejections : list of Rejection
        By the number of the edge.
    """
    finite = np.all(np.isfinite(R_ab), axis=(1, 2)) & np.all(np.isfinite(p_a), axis=1)
    joins = ends[:, 0] != ends[:, 1]
    kept = finite & joins
    rejections = [
        Rejection(np.nan, EDGES, n, NOT_FINITE if joins[n] else ONTO_ITSELF)
        for n in np.flatnonzero(~kept).tolist()
    ]
    if not np.any(kept):
        return None, rejections
    flip = np.kron(np.eye(2), FLU_FROM_FRD)
    edges = PoseEdges(
        t=ends[kept].astype(float),
        R_ab=FLU_FROM_FRD @ R_ab[kept] @ FLU_FROM_FRD,
        p_a=p_a[kept] @ FLU_FROM_FRD,
        information=flip @ information[kept] @ flip,
    )
    return edges, rejections


def mission_in_space(
    name: str, lines: GraphLines, ids: Array, R_ab: Array, p_a: Array, information: Array
) -> Mission:
    """The mission that a graph in space is: edges alone, as in `spatial_edges`.

    Parameters
    ----------
    ids : ndarray, shape (n, 2)
        Numbers of the two poses.

    Raises
    ------
    DataError
        Where no edge is of use.
    """
    poses = np.unique(ids)
    edges, rejections = spatial_edges(np.searchsorted(poses, ids), R_ab, p_a, information)
    if edges is None:
        raise DataError("no edge joins two poses: " + rejections[0].reason, lines.path)
    if lines.cut:
        rejections.append(Rejection(np.nan, EDGES, len(ids), TRUNCATED))
    mission = Mission(
        name=name,
        sensors={},
        edges=edges,
        rejections=tuple(rejections),
        warnings=tuple(lines.warnings()),
        sources=(lines.path,),
    )
    return on_mission_time(mission, {EDGES: 0.0})


def refuse_mixture(lines: GraphLines, spatial: Sequence[str], planar: Sequence[str]) -> None:
    """Raise a DataError where a graph in space has planar lines too: those tell neither the height
    nor the tilt of the poses that they join."""
    there = [word for word in planar if len(lines.line[word])]
    if there:
        raise DataError(
            f"lines of {', '.join(there)}, which lie in the plane, among those of"
            f" {' or '.join(spatial)}, which leave it: a graph is of one kind",
            lines.path,
            int(lines.line[there[0]][0]),
        )
