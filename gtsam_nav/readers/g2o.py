"""Pose graphs in g2o's words: odometry, landmarks, and no clock.

==============  ================================================================================
EDGE_SE2        ``a b dx dy dtheta`` and the upper triangle of its information: pose b in the
                axes of pose a
EDGE_SE2_XY     ``pose landmark x y`` and the upper triangle of its information
EDGE_SE3:QUAT   ``a b x y z qx qy qz qw`` and the upper triangle of its information, translation
                first; that of the turn is per rad^2, as GTSAM has it (g2o itself means half of it)
VERTEX_..       somebody's guess or result; not read
==============  ================================================================================

Metres and radians, counter-clockwise; x becomes north, y west and z up, as in all local frames.
Poses are in the order of their numbers, one second apart. In the plane an edge between neighbours
is the odometry of that second, stamped at its middle; where some edges join other poses (loops) all
are edges of the mission too, for the methods that know poses, and mission time begins with the
first pose. A graph that leaves the plane is edges alone. One of ``EDGE_SE3:QUAT`` that neither
climbs nor tilts is planar.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array, rotation_from_quaternion, rpy_from_rotation
from gtsam_nav.mission import Mission, Rejection, Sensor
from gtsam_nav.preprocess.cleaning import tidy
from gtsam_nav.readers._clock import on_mission_time
from gtsam_nav.readers._edges import are_flat, mission_in_space, refuse_mixture, split_edges
from gtsam_nav.readers._graph_lines import GraphLines, informations, read_graph_lines
from gtsam_nav.readers._matrices import turn_first
from gtsam_nav.readers._text import first_lines
from gtsam_nav.series import IntArray, LandmarkSeries, Series
from gtsam_nav.solution import Progress, no_progress

NAME = "g2o graph"
EXPECTS = "a .g2o file (plain, .gz or .bz2; or .txt, .graph) with EDGE_SE2 or EDGE_SE3:QUAT lines"

PLANAR, SIGHTING, SPATIAL = "EDGE_SE2", "EDGE_SE2_XY", "EDGE_SE3:QUAT"
N_NUMBERS = {PLANAR: 11, SIGHTING: 7, SPATIAL: 30}
NOT_READ = ("VERTEX_SE2", "VERTEX_XY", "VERTEX_SE3:QUAT", "FIX")
ENDINGS, TEXT_ENDINGS = (".g2o", ".g2o.gz", ".g2o.bz2"), (".txt", ".graph")
FIRST_WORDS = ("VERTEX_SE2 ", "VERTEX_SE3:QUAT ", f"{PLANAR} ", f"{SPATIAL} ")
IN_PLANE = np.array([0, 1, 5])
"""x, y and yaw among shift and turn."""

Cleaned = tuple[Series | None, list[Rejection]]


def can_open(path: Path) -> bool:
    """Whether the path is a .g2o file, or a text file that begins as one does."""
    is_named, is_text = path.name.endswith(ENDINGS), path.name.endswith(TEXT_ENDINGS)
    if not (is_named or is_text):
        return False
    first = first_lines(path, 1)
    return bool(first) and (is_named or first[0].startswith(FIRST_WORDS))


def read(path: Path, progress: Progress = no_progress) -> Mission:
    """Read a graph.

    Raises
    ------
    DataError
        Where a line is malformed, planar lines are among those of a graph that leaves the plane,
        or no edge joins two poses.
    """
    lines = read_graph_lines(path, N_NUMBERS, NOT_READ, progress)
    if not len(lines.line[PLANAR]) + len(lines.line[SPATIAL]):
        raise DataError(f"no edge joins two poses: no line {PLANAR} or {SPATIAL}", path)
    spatial = lines.numbers[SPATIAL]
    with np.errstate(invalid="ignore"):  # a quaternion of zeros says nothing
        R_ab = rotation_from_quaternion(spatial[:, [8, 5, 6, 7]])
    information = informations(spatial[:, 9:], 6, path, lines.line[SPATIAL])
    if are_flat(R_ab, spatial[:, 2:5]):
        return _planar_mission(lines, _Edges.of(lines, R_ab, information))
    refuse_mixture(lines, [SPATIAL], [PLANAR, SIGHTING])
    return mission_in_space(
        _name(path),
        lines,
        ids=spatial[:, :2],
        R_ab=R_ab,
        p_a=spatial[:, 2:5],
        information=turn_first(information),
    )


def _name(path: Path) -> str:
    return path.name.partition(".g2o")[0]


@dataclass(frozen=True)
class _Edges:
    """Edges in the plane: ids (n, 2), x, y and theta (n, 3), and their covariance (n, 3, 3)."""

    ids: Array
    steps: Array
    cov: Array

    @classmethod
    def of(cls, lines: GraphLines, R_ab: Array, information: Array) -> _Edges:
        """Those of both kinds in the file's order; the spatial ones are flat."""
        planar, spatial = lines.numbers[PLANAR], lines.numbers[SPATIAL]
        theta = rpy_from_rotation(R_ab)[:, 2]
        own = informations(planar[:, 5:], 3, lines.path, lines.line[PLANAR])
        of_flat = np.linalg.inv(information)[:, IN_PLANE][:, :, IN_PLANE]
        order = np.argsort(np.concatenate([lines.line[PLANAR], lines.line[SPATIAL]]))
        steps = np.concatenate([planar[:, 2:5], np.column_stack([spatial[:, 2:4], theta])])
        return cls(
            ids=np.concatenate([planar[:, :2], spatial[:, :2]])[order],
            steps=steps[order],
            cov=np.concatenate([np.linalg.inv(own), of_flat])[order],
        )


def _planar_mission(lines: GraphLines, graph: _Edges) -> Mission:
    poses = np.unique(graph.ids).astype(np.int64)
    ends = np.searchsorted(poses, graph.ids)
    edges, odometry, refused = split_edges(ends, graph.steps, graph.cov)
    refused += lines.truncation((PLANAR, SPATIAL), "odometry", len(ends))
    cleaned: dict[str, Cleaned] = {
        "odometry": (odometry, refused),
        "landmarks": _sightings(lines, poses),
    }
    mission = Mission(
        name=_name(lines.path),
        sensors={
            name: Sensor(name, name, series)
            for name, (series, _) in cleaned.items()
            if series is not None
        },
        edges=edges,
        rejections=tuple(r for _, dropped in cleaned.values() for r in dropped),
        warnings=tuple(lines.warnings()),
        sources=(lines.path,),
    )
    return on_mission_time(mission, dict.fromkeys(cleaned, 0.0))


def _sightings(lines: GraphLines, poses: IntArray) -> Cleaned:
    pose, landmark, x, y = lines.numbers[SIGHTING][:, :4].T
    information = informations(lines.numbers[SIGHTING][:, 4:], 2, lines.path, lines.line[SIGHTING])
    range_m = np.hypot(x, y)
    with np.errstate(invalid="ignore"):  # what is infinitely far is refused for its range
        ray = np.column_stack([x, y]) / np.maximum(range_m, 1e-12)[:, None]
    beside = np.column_stack([-ray[:, 1], ray[:, 0]])
    cov = np.linalg.inv(information)
    along, across = (np.sqrt(np.einsum("ni,nij,nj->n", u, cov, u)) for u in (ray, beside))
    place = np.minimum(np.searchsorted(poses, pose), len(poses) - 1)
    columns = {
        "t": place.astype(float),
        "id": landmark,
        "range_m": range_m,
        "bearing": -np.arctan2(y, x),
        "sigma_range": along,
        "sigma_bearing": across / np.maximum(range_m, 1e-12),
    }
    refused = {"no such pose": poses[place] != pose, "no range": range_m == 0}
    series, rejections = tidy(LandmarkSeries, "landmarks", columns, refused=refused)
    return series, rejections + lines.truncation([SIGHTING], "landmarks", len(pose))
