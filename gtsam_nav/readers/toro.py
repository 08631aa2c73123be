"""Pose graphs as text, in the words of TORO and GTSAM: odometry, landmarks, and no clock.

==========  ====================================================================================
ODOMETRY,   ``a b dx dy dtheta`` and six figures of its covariance: pose b in the axes of pose a
EDGE2
EDGE3       ``a b x y z roll pitch yaw`` and the upper triangle of its information: pose b in the
            axes of pose a, in space
LANDMARK    ``pose landmark x y`` and ``xx xy yy`` of its covariance: a landmark in the pose's axes
BR          ``pose landmark bearing range sigma_bearing sigma_range``
VERTEX..    somebody's guess or result; not read
==========  ====================================================================================

Metres and radians, counter-clockwise; x becomes north, y west and z up, as in all local frames. The
six figures are the covariance ``xx xy xt yy yt tt`` or, as in TORO, the information
``xx xy yy tt xt yt``; the zeros between them tell which. (GTSAM takes TORO's for a covariance too.)
The information in space is that of the turn, then of the shift, as GTSAM takes it.

Poses are in the order of their numbers, one second apart. In the plane an edge between neighbours
is the odometry of that second, stamped at its middle; mission time begins with the first stamp.
Where some edges join other poses (loops) all are edges of the mission too, for the methods that
know poses; mission time begins with the first pose then. A graph in space is edges alone. Noise is
that of the file, but the odometry and sightings of a data set with a card (``victoria_park``) have
that of the card.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import numpy as np

from gtsam_nav.cards import Card, load_card
from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array, rotation_from_rpy
from gtsam_nav.mission import Mission, Rejection, Sensor
from gtsam_nav.preprocess.cleaning import tidy
from gtsam_nav.readers._clock import on_mission_time
from gtsam_nav.readers._edges import mission_in_space, refuse_mixture, split_edges
from gtsam_nav.readers._graph_lines import GraphLines, informations, read_graph_lines
from gtsam_nav.readers._matrices import definite
from gtsam_nav.sensors.noise import LandmarkNoise, OdometryNoise
from gtsam_nav.series import IntArray, LandmarkSeries, Series
from gtsam_nav.solution import Progress, no_progress

NAME = "TORO graph"
EXPECTS = "a text file (.txt, .graph, .toro) of lines ODOMETRY, EDGE2 or EDGE3, LANDMARK or BR"

SUFFIXES = (".txt", ".graph", ".toro")
EDGES, SIGHTINGS, SPATIAL = ("ODOMETRY", "EDGE2"), ("LANDMARK", "BR"), "EDGE3"
N_NUMBERS = {"ODOMETRY": 11, "EDGE2": 11, "LANDMARK": 7, "BR": 6, SPATIAL: 29}
NOT_READ = ("VERTEX2", "VERTEX3")

CARDS = ("victoria_park",)
"""Data sets whose card knows the noise better than their file."""

LINES_TO_KNOW_IT_BY = 20

Cleaned = tuple[Series | None, list[Rejection]]


def can_open(path: Path) -> bool:
    """Whether the path is a text file that begins with lines of this kind."""
    try:
        if not (path.is_file() and path.name.endswith(SUFFIXES)):
            return False
        with path.open(encoding="latin-1") as stream:
            words = [line[:20].split(None, 1) for line in islice(stream, LINES_TO_KNOW_IT_BY)]
    except (OSError, ValueError):
        return False
    return any(word[0] in (*N_NUMBERS, *NOT_READ) for word in words if word)


def read(path: Path, progress: Progress = no_progress) -> Mission:
    """Read a graph.

    Raises
    ------
    DataError
        Where a line is malformed, planar lines are among those in space, or no edge joins two
        poses.
    """
    lines = read_graph_lines(path, N_NUMBERS, NOT_READ, progress)
    if len(lines.line[SPATIAL]):
        refuse_mixture(lines, [SPATIAL], [*EDGES, *SIGHTINGS])
        return _in_space(lines)
    card = load_card(path.stem) if path.stem in CARDS else None
    edges_read, line = lines.of(EDGES)
    poses = np.unique(edges_read[:, :2]).astype(np.int64)
    if not len(poses):
        raise DataError(f"no edge joins two poses: no line {' or '.join(EDGES)} or {SPATIAL}", path)
    ends = np.searchsorted(poses, edges_read[:, :2])
    cov = _covariances(edges_read[:, 5:], path, line)
    noise = None
    if card is not None:
        noise = OdometryNoise.model_validate(card.sensors["odometry"].noise)
    edges, odometry, refused = split_edges(ends, edges_read[:, 2:5], cov, noise)
    seen = _seen(lines)
    cleaned: dict[str, Cleaned] = {
        "odometry": (odometry, refused + lines.truncation(EDGES, "odometry", len(ends))),
        "landmarks": _sightings(lines, seen, poses, card),
    }
    sensors = {
        name: Sensor(name, name, series, noise=card.sensors[name].noise if card else {})
        for name, (series, _) in cleaned.items()
        if series is not None
    }
    mission = Mission(
        name=path.stem,
        sensors=sensors,
        edges=edges,
        rejections=tuple(r for _, dropped in cleaned.values() for r in dropped),
        warnings=(*lines.warnings(), *_warnings(len(seen), len(poses), sensors)),
        sources=(path,),
    )
    return on_mission_time(mission, dict.fromkeys(cleaned, 0.0))


def _in_space(lines: GraphLines) -> Mission:
    numbers = lines.numbers[SPATIAL]
    with np.errstate(invalid="ignore"):  # an infinite angle says nothing
        R_ab = rotation_from_rpy(numbers[:, 5:8])
    return mission_in_space(
        lines.path.stem,
        lines,
        ids=numbers[:, :2],
        R_ab=R_ab,
        p_a=numbers[:, 2:5],
        information=informations(numbers[:, 8:], 6, lines.path, lines.line[SPATIAL]),
    )


def _warnings(n_seen: int, n_poses: int, sensors: dict[str, Sensor]) -> Iterator[str]:
    known = len(sensors["odometry"].series) if "odometry" in sensors else 0
    if known < n_poses - 1:
        yield f"no edge joins {n_poses - 1 - known} of {n_poses - 1} neighbouring poses"
    if n_seen and "landmarks" not in sensors:
        yield "the graph has no usable sighting of a landmark"


def _seen(lines: GraphLines) -> Array:
    """Sightings (m, 6) in the file's order: pose, landmark, range, bearing, and their sigmas."""
    seen = [_polar(lines.numbers["LANDMARK"]), lines.numbers["BR"][:, [0, 1, 3, 2, 5, 4]]]
    order = np.argsort(np.concatenate([lines.line[word] for word in SIGHTINGS]))
    return np.concatenate(seen)[order]


def _polar(cartesian: Array) -> Array:
    """Landmarks' x, y and covariances in a pose's axes as ranges and bearings with their sigmas."""
    pose, landmark, x, y, xx, xy, yy = cartesian.T
    range_m = np.hypot(x, y)
    somewhere = (range_m > 0) & (range_m < np.inf)
    with np.errstate(invalid="ignore", divide="ignore"):
        c, s = x / range_m, y / range_m
        along = np.sqrt(np.maximum(c * c * xx + 2 * c * s * xy + s * s * yy, 0.0))
        across = np.sqrt(np.maximum(s * s * xx - 2 * c * s * xy + c * c * yy, 0.0)) / range_m
    told = [np.where(somewhere, figure, np.nan) for figure in (np.arctan2(y, x), along, across)]
    return np.column_stack([pose, landmark, range_m, *told])


def _covariances(figures: Array, path: Path, line: IntArray) -> Array:
    """Covariances of x, y and theta, shape (n, 3, 3); all are positive definite."""
    xx, xy, third, fourth, fifth, sixth = figures.T
    toro = (third != 0) & (fourth != 0) & (fifth == 0) & (sixth == 0)
    usual = (third == 0) & (fourth != 0) & (fifth == 0) & (sixth != 0)
    if not np.all(toro | usual):
        which = int(np.flatnonzero(~(toro | usual))[0])
        raise DataError(
            f"its noise, {figures[which].tolist()}, is neither a covariance in"
            " the order xx 0 0 yy 0 tt nor an information in TORO's, xx 0 yy tt 0 0",
            path,
            int(line[which]),
        )
    cov = np.zeros((len(figures), 3, 3))
    cov[:, 0, 0], cov[:, 0, 1], cov[:, 1, 0] = xx, xy, xy
    cov[:, 1, 1] = np.where(toro, third, fourth)
    cov[:, 2, 2] = np.where(toro, fourth, sixth)
    good = definite(cov)
    if not np.all(good):
        raise DataError("its noise is not positive definite", path, int(line[np.argmin(good)]))
    cov[toro] = np.linalg.inv(cov[toro])
    return cov


def _sightings(lines: GraphLines, seen: Array, poses: IntArray, card: Card | None) -> Cleaned:
    pose, landmark, range_m, bearing, sigma_range, sigma_bearing = seen.T
    place = np.minimum(np.searchsorted(poses, pose), len(poses) - 1)
    if card is not None:
        noise = LandmarkNoise.model_validate(card.sensors["landmarks"].noise)
        sigma_range = np.full(len(pose), noise.sigma_range_m)
        sigma_bearing = np.full(len(pose), np.radians(noise.sigma_bearing_deg))
    columns = {
        "t": place.astype(float),
        "id": landmark,
        "range_m": range_m,
        "bearing": -bearing,
        "sigma_range": sigma_range,
        "sigma_bearing": sigma_bearing,
    }
    refused = {"no such pose": poses[place] != pose}
    series, rejections = tidy(LandmarkSeries, "landmarks", columns, refused=refused)
    return series, rejections + lines.truncation(SIGHTINGS, "landmarks", len(pose))
