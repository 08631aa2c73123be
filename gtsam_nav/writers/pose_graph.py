"""Pose graphs as g2o, with the times that the format cannot hold beside it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gtsam_nav.errors import DataError
from gtsam_nav.frames import (
    FLU_FROM_FRD,
    Array,
    quaternion_from_rotation,
    rotation_from_quaternion,
)
from gtsam_nav.solution import PoseGraph, PoseGraphEdge
from gtsam_nav.writers.frame import Frame, express_points, express_rotations
from gtsam_nav.writers.tables import EXACT, format_rows, read_table, write_table

TRANSLATION_FIRST = np.array([3, 4, 5, 0, 1, 2])
"""Reorders (rot, trans) to g2o's (trans, rot), and back."""

UPPER = np.triu_indices(6)


def write_g2o(graph: PoseGraph, path: Path, frame: Frame = "ned") -> None:
    """Write ``VERTEX_SE3:QUAT`` and ``EDGE_SE3:QUAT`` lines, exactly.

    An edge holds the upper triangle of its information, translation first; the rotation is in
    radians, as GTSAM reads and writes it.
    """
    ids = np.arange(len(graph.t), dtype=float)
    R_nb = rotation_from_quaternion(graph.q_nb_wxyz)
    q_wxyz = quaternion_from_rotation(express_rotations(R_nb, frame))
    vertices = [ids, *express_points(graph.p_n, frame).T, *q_wxyz[:, [1, 2, 3, 0]].T]
    text = format_rows(vertices, ["VERTEX_SE3:QUAT %d", *[EXACT] * 7], " ")
    if graph.edges:
        text += format_rows(
            list(_edge_rows(graph, frame).T), ["EDGE_SE3:QUAT %d", "%d", *[EXACT] * 28], " "
        )
    path.write_text(text, encoding="utf-8", newline="\n")


def _edge_rows(graph: PoseGraph, frame: Frame) -> Array:
    """One row an edge: a, b, x y z, qx qy qz qw, 21 numbers of information."""
    p_a = np.array([edge.p_a for edge in graph.edges])
    R_ab = np.array([edge.R_ab for edge in graph.edges])
    information = np.array([edge.information for edge in graph.edges])
    if frame == "enu":
        flip = np.kron(np.eye(2), FLU_FROM_FRD)
        p_a = p_a @ FLU_FROM_FRD
        R_ab = FLU_FROM_FRD @ R_ab @ FLU_FROM_FRD
        information = flip @ information @ flip
    translation_first = information[:, TRANSLATION_FIRST][:, :, TRANSLATION_FIRST]
    return np.column_stack(
        [
            [(edge.a, edge.b) for edge in graph.edges],
            p_a,
            quaternion_from_rotation(R_ab)[:, [1, 2, 3, 0]],
            translation_first[:, UPPER[0], UPPER[1]],
        ]
    )


def write_vertex_times(graph: PoseGraph, path: Path) -> None:
    """Write the mission time of each vertex."""
    ids = np.arange(len(graph.t), dtype=float)
    write_table(path, {"vertex": (ids, "%d"), "t": (graph.t, EXACT)})


def read_pose_graph(g2o: Path, vertex_times: Path) -> PoseGraph:
    """Read what `write_g2o` (in NED) and `write_vertex_times` wrote.

    Raises
    ------
    DataError
        Where a line is of another kind or does not hold the right numbers.
    """
    vertices: list[list[float]] = []
    edges: list[PoseGraphEdge] = []
    try:
        lines = g2o.read_text(encoding="utf-8").splitlines()
    except (OSError, ValueError) as error:
        raise DataError(f"cannot be read: {error}", g2o) from error
    for number, line in enumerate(lines, start=1):
        kind, *fields = line.split() or [""]
        try:
            values = [float(field) for field in fields]
        except ValueError as error:
            raise DataError(str(error), g2o, number) from error
        if not np.all(np.isfinite(values)):
            raise DataError("holds a number that is not finite", g2o, number)
        if kind == "VERTEX_SE3:QUAT" and len(values) == 8:
            vertices.append(values)
        elif kind == "EDGE_SE3:QUAT" and len(values) == 30:
            edges.append(_edge(np.array(values)))
        else:
            raise DataError(f"'{kind}' with {len(values)} numbers is not understood", g2o, number)
    poses = np.array(vertices).reshape(-1, 8)
    times = read_table(vertex_times).get("t", np.empty(0))
    if len(times) != len(poses):
        raise DataError(f"{len(times)} times of {len(poses)} vertices", vertex_times)
    return PoseGraph(
        t=times,
        p_n=poses[:, 1:4],
        q_nb_wxyz=poses[:, [7, 4, 5, 6]],
        edges=tuple(edges),
    )


def _edge(values: Array) -> PoseGraphEdge:
    upper = np.zeros((6, 6))
    upper[UPPER] = values[9:]
    information = upper + np.triu(upper, 1).T
    return PoseGraphEdge(
        a=int(values[0]),
        b=int(values[1]),
        R_ab=rotation_from_quaternion(values[[8, 5, 6, 7]]),
        p_a=values[2:5],
        information=information[TRANSLATION_FIRST][:, TRANSLATION_FIRST],
    )
