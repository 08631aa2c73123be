"""Planar graphs as text, in the words of TORO and GTSAM: odometry, landmarks, and no clock.

==========  ====================================================================================
ODOMETRY,   ``a b dx dy dtheta`` and six figures of its covariance: pose b in the axes of pose a
EDGE2
LANDMARK    ``pose landmark x y`` and ``xx xy yy`` of its covariance: a landmark in the pose's axes
BR          ``pose landmark bearing range sigma_bearing sigma_range``
VERTEX2     ``id x y theta``: somebody's guess or result; not read
==========  ====================================================================================

Metres and radians, counter-clockwise; x becomes north and y west, as in all local frames. The
six figures are the covariance ``xx xy xt yy yt tt`` or, as in TORO, the information
``xx xy yy tt xt yt``; the zeros between them tell which. (GTSAM takes TORO's for a covariance too.)

Poses are in the order of their numbers, one second apart: an edge between neighbours is the
odometry of that second, stamped at its middle; mission time begins with the first stamp. Where some
join other poses (loops) all are edges of the mission too, for the methods that know poses; mission
time begins with the first pose then. Noise is that of the file, but the odometry and sightings of a
data set with a card (``victoria_park``) have that of the card.
"""

from __future__ import annotations

from collections import Counter
from itertools import islice
from pathlib import Path

import numpy as np

from gtsam_nav.cards import Card, load_card
from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission, Rejection, Sensor
from gtsam_nav.preprocess.cleaning import tidy
from gtsam_nav.readers._clock import on_mission_time
from gtsam_nav.readers._edges import split_edges
from gtsam_nav.readers._text import TRUNCATED, read_lines
from gtsam_nav.sensors.noise import LandmarkNoise, OdometryNoise
from gtsam_nav.series import IntArray, LandmarkSeries, Series
from gtsam_nav.solution import Progress, no_progress

NAME = "TORO graph"
EXPECTS = "a text file (.txt, .graph, .toro) of lines ODOMETRY or EDGE2, LANDMARK or BR, VERTEX2"

SUFFIXES = (".txt", ".graph", ".toro")
EDGES, SIGHTINGS = ("ODOMETRY", "EDGE2"), ("LANDMARK", "BR")
N_NUMBERS = {"ODOMETRY": 11, "EDGE2": 11, "LANDMARK": 7, "BR": 6, "VERTEX2": 4}
"""Numbers behind each word; but for a VERTEX2 the first two are whole."""

CARDS = ("victoria_park",)
"""Data sets whose card knows the noise better than their file."""

LINES_TO_KNOW_IT_BY = 20
MAX_ID = 2**53

Cleaned = tuple[Series | None, list[Rejection]]


class _Lines:
    """What a file says: ``edges`` (n, 11), ``sightings`` as (pose, landmark, range, bearing,
    sigma_range, sigma_bearing), the sensor whose last line is cut, and words that mean nothing."""

    def __init__(self, path: Path) -> None:
        edges: list[list[float]] = []
        sightings: list[list[float]] = []
        self.cut: str | None = None
        self.skipped: Counter[str] = Counter()
        lines = read_lines(path, encoding="latin-1")
        last = max((k for k, line in enumerate(lines) if line.strip()), default=0)
        for k, line in enumerate(lines):
            word, *texts = line.split() or ["#"]
            if word not in N_NUMBERS:
                self.skipped[word[:20]] += not word.startswith("#")
                continue
            sensor = "landmarks" if word in SIGHTINGS else "odometry"
            try:
                numbers = _numbers(word, texts)
            except ValueError as error:
                if k == last and len(texts) <= N_NUMBERS[word]:
                    self.cut = sensor
                    break
                raise DataError(str(error), path, k + 1) from error
            if word in EDGES:
                edges.append(numbers)
            elif word in SIGHTINGS:
                sightings.append(_polar(numbers) if word == "LANDMARK" else _in_order(numbers))
        self.edges = np.array(edges).reshape(-1, 11)
        self.sightings = np.array(sightings).reshape(-1, 6)

    def truncation(self, sensor: str, n_samples: int) -> list[Rejection]:
        """The rejection of a last line that was cut off, if it was this sensor's."""
        return [Rejection(np.nan, sensor, n_samples, TRUNCATED)] if self.cut == sensor else []


def can_open(path: Path) -> bool:
    """Whether the path is a text file that begins with lines of this kind."""
    try:
        if not (path.is_file() and path.name.endswith(SUFFIXES)):
            return False
        with path.open(encoding="latin-1") as stream:
            words = [line[:20].split(None, 1) for line in islice(stream, LINES_TO_KNOW_IT_BY)]
    except (OSError, ValueError):
        return False
    return any(word[0] in N_NUMBERS for word in words if word)


def read(path: Path, progress: Progress = no_progress) -> Mission:
    """Read a graph.

    Raises
    ------
    DataError
        Where a line is malformed, or no edge joins two poses.
    """
    progress("read mission", 0.0)
    lines = _Lines(path)
    card = load_card(path.stem) if path.stem in CARDS else None
    poses = np.unique(lines.edges[:, :2]).astype(np.int64)
    if not len(poses):
        raise DataError(f"no edge joins two poses: no line {' or '.join(EDGES)}", path)
    ends = np.searchsorted(poses, lines.edges[:, :2])
    cov = _covariances(lines.edges[:, 5:], path)
    edges, odometry, refused = split_edges(
        ends, lines.edges[:, 2:5], cov, _odometry(lines, ends, cov, card)
    )
    cleaned: dict[str, Cleaned] = {
        "odometry": (odometry, refused + lines.truncation("odometry", len(ends))),
        "landmarks": _sightings(lines, poses, card),
    }
    progress("read mission", 1.0)
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
        warnings=tuple(_warnings(lines, len(poses), sensors)),
        sources=(path,),
    )
    return on_mission_time(mission, dict.fromkeys(cleaned, 0.0))


def _warnings(lines: _Lines, n_poses: int, sensors: dict[str, Sensor]) -> list[str]:
    found = ["the graph has no clock: its poses are taken to be one second apart"]
    if words := +lines.skipped:
        listed = ", ".join(f"{word} ({n})" for word, n in words.most_common(5))
        found.append(f"lines that begin with other words are left out: {listed}")
    known = len(sensors["odometry"].series) if "odometry" in sensors else 0
    if known < n_poses - 1:
        found.append(f"no edge joins {n_poses - 1 - known} of {n_poses - 1} neighbouring poses")
    if len(lines.sightings) and "landmarks" not in sensors:
        found.append("the graph has no usable sighting of a landmark")
    return found


def _numbers(word: str, texts: list[str]) -> list[float]:
    """The numbers behind a word; raises ValueError where they are not as they should be."""
    if len(texts) != N_NUMBERS[word]:
        raise ValueError(f"{len(texts)} numbers behind {word}, where {N_NUMBERS[word]} are needed")
    n_ids = 1 if word == "VERTEX2" else 2
    try:
        numbers = [float(text) for text in texts]
    except ValueError:
        raise ValueError(f"{word} is followed by something that is not a number") from None
    if any(not (abs(number) < MAX_ID and number.is_integer()) for number in numbers[:n_ids]):
        raise ValueError(f"{word} needs whole numbers of poses or landmarks first")
    return numbers


def _in_order(br: list[float]) -> list[float]:
    pose, landmark, bearing, range_m, sigma_bearing, sigma_range = br
    return [pose, landmark, range_m, bearing, sigma_range, sigma_bearing]


def _polar(seen: list[float]) -> list[float]:
    """A landmark's x, y and covariance in a pose's axes as range and bearing with their sigmas."""
    pose, landmark, x, y, xx, xy, yy = seen
    range_m = float(np.hypot(x, y))
    if not 0 < range_m < np.inf:
        return [pose, landmark, range_m, np.nan, np.nan, np.nan]
    c, s = x / range_m, y / range_m
    along = c * c * xx + 2 * c * s * xy + s * s * yy
    across = s * s * xx - 2 * c * s * xy + c * c * yy
    sigma_along, sigma_across = np.sqrt([max(along, 0.0), max(across, 0.0)])
    return [pose, landmark, range_m, np.arctan2(y, x), sigma_along, sigma_across / range_m]


def _odometry(lines: _Lines, ends: IntArray, cov: Array, card: Card | None) -> dict[str, Array]:
    """The edges as if all joined neighbours."""
    a, b = ends.T
    step = _forward(lines.edges[:, 2:5], backward=b < a)
    with np.errstate(invalid="ignore"):
        sigma_v = np.sqrt(np.maximum(cov[:, 0, 0], cov[:, 1, 1]))
        sigma_turn = np.sqrt(cov[:, 2, 2])
    if card is not None:
        noise = OdometryNoise.model_validate(card.sensors["odometry"].noise)
        sigma_v = np.full(len(a), noise.sigma_v_m_s)
        sigma_turn = np.full(len(a), noise.sigma_yaw_rate_rad_s)
    return {
        # the mean over the second between two poses
        "t": np.minimum(a, b) + 0.5,
        "v_b": _mean_velocity(step),
        "yaw_rate": -step[:, 2],
        "sigma_v": sigma_v,
        "sigma_yaw_rate": sigma_turn,
    }


def _forward(step: Array, backward: Array) -> Array:
    """The later pose (x, y, theta) in the axes of the earlier, also where stated backward."""
    x, y, theta = step.T
    c, s = np.cos(theta), np.sin(theta)
    inverse = np.column_stack([-c * x - s * y, s * x - c * y, -theta])
    return np.where(np.asarray(backward)[:, None], inverse, step)


def _mean_velocity(step: Array) -> Array:
    """Body velocity, forward and starboard, that makes the step in a second at a steady turn."""
    x, y, theta = step.T
    half = theta / 2
    small = np.abs(half) < 1e-6
    per_arc = np.where(small, 1.0, half / np.tan(np.where(small, 1.0, half)))
    return np.column_stack([per_arc * x + half * y, half * x - per_arc * y])


def _covariances(figures: Array, path: Path) -> Array:
    """Covariances of x, y and theta, shape (n, 3, 3)."""
    xx, xy, third, fourth, fifth, sixth = figures.T
    toro = (third != 0) & (fourth != 0) & (fifth == 0) & (sixth == 0)
    usual = (third == 0) & (fourth != 0) & (fifth == 0) & (sixth != 0)
    if not np.all(toro | usual):
        which = int(np.flatnonzero(~(toro | usual))[0])
        raise DataError(
            f"the noise of edge {which + 1}, {figures[which].tolist()}, is neither a covariance in"
            " the order xx 0 0 yy 0 tt nor an information in TORO's, xx 0 yy tt 0 0",
            path,
        )
    cov = np.zeros((len(figures), 3, 3))
    cov[:, 0, 0], cov[:, 0, 1], cov[:, 1, 0] = xx, xy, xy
    cov[:, 1, 1] = np.where(toro, third, fourth)
    cov[:, 2, 2] = np.where(toro, fourth, sixth)
    if np.any(singular := toro & (np.linalg.det(cov) == 0.0)):
        which = int(np.flatnonzero(singular)[0])
        raise DataError(f"the information of edge {which + 1} is singular", path)
    cov[toro] = np.linalg.inv(cov[toro])
    return cov


def _sightings(lines: _Lines, poses: IntArray, card: Card | None) -> Cleaned:
    pose, landmark, range_m, bearing, sigma_range, sigma_bearing = lines.sightings.T
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
    return series, rejections + lines.truncation("landmarks", len(pose))
