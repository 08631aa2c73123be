"""Planar pose graphs in g2o's words: odometry, landmarks, and no clock.

==============  ================================================================================
EDGE_SE2        ``a b dx dy dtheta`` and the upper triangle of its information: pose b in the
                axes of pose a
EDGE_SE2_XY     ``pose landmark x y`` and the upper triangle of its information
EDGE_SE3:QUAT   ``a b x y z qx qy qz qw`` and 21 figures, translation first: what of it lies in
                the plane; a graph that climbs loses its height, and a warning says so
VERTEX_..       somebody's guess or result; not read
==============  ================================================================================

Metres and radians, counter-clockwise; x becomes north and y west, as in all local frames. Poses are
in the order of their numbers, one second apart: an edge between neighbours is the odometry of that
second, stamped at its middle. Where some join other poses (loops) all are edges of the mission too,
for the methods that know poses; mission time begins with the first pose then.
"""

from __future__ import annotations

from collections import Counter
from functools import lru_cache
from pathlib import Path

import numpy as np

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array, rpy_from_quaternion
from gtsam_nav.mission import Mission, Rejection, Sensor
from gtsam_nav.preprocess.cleaning import tidy
from gtsam_nav.readers._clock import on_mission_time
from gtsam_nav.readers._edges import split_edges
from gtsam_nav.readers._odometry import step_speeds
from gtsam_nav.readers._text import TRUNCATED, first_lines, stream_lines
from gtsam_nav.series import IntArray, LandmarkSeries, Series
from gtsam_nav.solution import Progress, no_progress

NAME = "g2o graph"
EXPECTS = "a .g2o file (plain, .gz or .bz2) with EDGE_SE2 or EDGE_SE3:QUAT lines"

N_NUMBERS = {"EDGE_SE2": 11, "EDGE_SE2_XY": 7, "EDGE_SE3:QUAT": 30}
"""Numbers behind each word; the first two are whole."""
NOT_READ = ("VERTEX_SE2", "VERTEX_XY", "VERTEX_SE3:QUAT", "FIX")
ENDINGS = (".g2o", ".g2o.gz", ".g2o.bz2")
LINES_TO_KNOW_IT_BY = 5
FLAT_M = 1e-3
"""Steps that rise by less, as a share of their length, lie in the plane."""
MAX_ID = 2**53

Cleaned = tuple[Series | None, list[Rejection]]


def can_open(path: Path) -> bool:
    """Whether the path is a .g2o file."""
    try:
        return path.is_file() and path.name.endswith(ENDINGS) and bool(first_lines(path, 1))
    except (OSError, ValueError):
        return False


def read(path: Path, progress: Progress = no_progress) -> Mission:
    """Read a graph.

    Raises
    ------
    DataError
        Where a line is malformed, or no edge joins two poses.
    """
    graph = _Graph(path, progress)
    progress("read mission", 1.0)
    poses = np.unique(graph.edges[:, :2]).astype(np.int64)
    if not len(poses):
        raise DataError("no edge joins two poses: no line EDGE_SE2 or EDGE_SE3:QUAT", path)
    ends = np.searchsorted(poses, graph.edges[:, :2])
    edges, odometry, refused = split_edges(
        ends, graph.edges[:, 2:5], graph.cov, _odometry(graph, ends)
    )
    cleaned: dict[str, Cleaned] = {"odometry": (odometry, refused)}
    if len(graph.sightings):
        cleaned["landmarks"] = _sightings(graph, poses)
    rejections = [rejection for _, dropped in cleaned.values() for rejection in dropped]
    if graph.is_cut:
        rejections.append(Rejection(np.nan, "odometry", len(graph.edges), TRUNCATED))
    mission = Mission(
        name=path.name.partition(".g2o")[0],
        sensors={
            name: Sensor(name, name, series)
            for name, (series, _) in cleaned.items()
            if series is not None
        },
        edges=edges,
        rejections=tuple(rejections),
        warnings=tuple(graph.warnings()),
        sources=(path,),
    )
    return on_mission_time(mission, dict.fromkeys(cleaned, 0.0))


class _Graph:
    """The lines of a file: ``edges`` (n, 5) as a, b, x, y, theta, and their ``cov`` (n, 3, 3);
    ``sightings`` (m, 6) as pose, landmark, x, y, sigma along and across."""

    def __init__(self, path: Path, progress: Progress) -> None:
        edges: list[list[float]] = []
        cov: list[Array] = []
        sightings: list[list[float]] = []
        self.skipped: Counter[str] = Counter()
        self.steepest = 0.0
        fault: DataError | None = None
        for number, (line, fraction) in enumerate(stream_lines(path), start=1):
            if number % 1000 == 0:
                progress("read mission", fraction)
            word, *texts = line.split() or ["#"]
            if word not in N_NUMBERS:
                self.skipped[word[:20]] += not (word.startswith("#") or word in NOT_READ)
                continue
            if fault is not None:
                raise fault  # only the last line may be cut
            try:
                values = _numbers(word, texts)
                if word == "EDGE_SE2_XY":
                    sightings.append(_sighting(values))
                else:
                    step, of_step = self._edge(word, values)
                    edges.append([*values[:2], *step])
                    cov.append(of_step)
            except (ValueError, np.linalg.LinAlgError) as error:
                fault = DataError(f"{word}: {error}", path, number)
                if len(texts) == N_NUMBERS[word]:
                    raise fault from error
        self.is_cut = fault is not None
        self.edges = np.array(edges).reshape(-1, 5)
        self.cov = np.array(cov).reshape(-1, 3, 3)
        self.sightings = np.array(sightings).reshape(-1, 6)

    def _edge(self, word: str, v: Array) -> tuple[Array, Array]:
        """The step of an edge and its covariance."""
        if word == "EDGE_SE2":
            return v[2:5], _covariance(tuple(v[5:].tolist()), 3)
        x, y, z = v[2:5]
        self.steepest = max(self.steepest, abs(z) / max(float(np.hypot(x, y)), 1.0))
        yaw = rpy_from_quaternion(v[[8, 5, 6, 7]])[2]
        cov = _covariance(tuple(v[9:].tolist()), 6)[np.ix_([0, 1, 5], [0, 1, 5])]
        return np.array([x, y, yaw]), cov

    def warnings(self) -> list[str]:
        """What the user must hear of."""
        found = ["the graph has no clock: its poses are taken to be one second apart"]
        if words := +self.skipped:
            listed = ", ".join(f"{word} ({n})" for word, n in words.most_common(5))
            found.append(f"lines that begin with other words are left out: {listed}")
        if self.steepest > FLAT_M:
            found.append("the graph leaves the plane: only what lies in it is read")
        return found


def _numbers(word: str, texts: list[str]) -> Array:
    if len(texts) != N_NUMBERS[word]:
        raise ValueError(f"{len(texts)} numbers where {N_NUMBERS[word]} are needed")
    values = np.array(texts, dtype=float)
    if not (np.all(np.abs(values[:2]) < MAX_ID) and np.all(values[:2] == np.floor(values[:2]))):
        raise ValueError("whole numbers of poses or landmarks are needed first")
    return values


@lru_cache(maxsize=256)
def _covariance(upper: tuple[float, ...], size: int) -> Array:
    """Inverse of an information matrix, of which the upper triangle is given row by row.

    A file's edges have few different ones.
    """
    information = np.zeros((size, size))
    information[np.triu_indices(size)] = upper
    information += np.triu(information, 1).T
    if not np.all(np.isfinite(information)) or np.any(np.linalg.eigvalsh(information) <= 0):
        raise ValueError("its information is not positive definite")
    return np.asarray(np.linalg.inv(information))


def _sighting(v: Array) -> list[float]:
    x, y = v[2:4]
    cov = _covariance(tuple(v[4:].tolist()), 2)
    ray = np.array([x, y]) / max(float(np.hypot(x, y)), 1e-12)
    across = np.array([-ray[1], ray[0]])
    along_across = np.sqrt([ray @ cov @ ray, across @ cov @ across])
    return [*v[:2], x, y, *along_across]


def _odometry(graph: _Graph, ends: IntArray) -> dict[str, Array]:
    """The edges as if all joined neighbours."""
    a, b = ends.T
    x, y, theta = graph.edges[:, 2:5].T
    c, s = np.cos(theta), np.sin(theta)
    backward = np.column_stack([-c * x - s * y, s * x - c * y, -theta])
    steps = np.where((b < a)[:, None], backward, graph.edges[:, 2:5])
    v_b, yaw_rate = step_speeds(steps, np.ones(len(steps)))
    return {
        "t": np.minimum(a, b) + 0.5,
        "v_b": v_b,
        "yaw_rate": yaw_rate,
        "sigma_v": np.sqrt(np.maximum(graph.cov[:, 0, 0], graph.cov[:, 1, 1])),
        "sigma_yaw_rate": np.sqrt(graph.cov[:, 2, 2]),
    }


def _sightings(graph: _Graph, poses: IntArray) -> Cleaned:
    pose, landmark, x, y, along, across = graph.sightings.T
    place = np.minimum(np.searchsorted(poses, pose), len(poses) - 1)
    range_m = np.hypot(x, y)
    columns = {
        "t": place.astype(float),
        "id": landmark,
        "range_m": range_m,
        "bearing": -np.arctan2(y, x),
        "sigma_range": along,
        "sigma_bearing": across / np.maximum(range_m, 1e-12),
    }
    refused = {"no such pose": poses[place] != pose, "no range": range_m == 0}
    return tidy(LandmarkSeries, "landmarks", columns, refused=refused)
