"""Whether the map that a scanner's points draw is one: to which side they lie, and where ahead is.

Points are in body axes. Where those of a scanner were taken for them, or port was taken for
starboard, scans between which the vehicle turned or went some way do not fall upon each other.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from gtsam_nav.audit import fixes
from gtsam_nav.audit.courses import Velocity, way
from gtsam_nav.audit.findings import Finding
from gtsam_nav.audit.lagged_products import Signal
from gtsam_nav.audit.motion import turned
from gtsam_nav.audit.sonar_map import (
    FEWEST_PAIRS,
    MOST_PAIRS,
    MOVED_M,
    TURNED_RAD,
    MapLikeness,
    Reading,
    overlap,
    unless,
)
from gtsam_nav.frames import Array, rotation_from_rpy
from gtsam_nav.mission import Sensor
from gtsam_nav.series import IntArray, ScanSeries

LONGEST_S = 30.0
"""Way and turns between two scans are reckoned: errors grow with the time."""
CELL_SHARE, LEAST_CELL_M, MOST_CELL_M = 0.025, 0.1, 1.0
"""Of the median range: what a small error of a turn moves a point by."""
MOVED_SHARE = 0.3
"""Of it: scans that are farther apart see other things."""
MOST_POINTS = 200


@dataclass(frozen=True)
class Scans:
    """Scans as they lie about the vehicle, and where it was.

    Attributes
    ----------
    points_b : tuple of ndarray, shape (k, 2)
        Of each scan, forward and starboard, m.
    yaw : ndarray, shape (s,)
    body_n : ndarray, shape (s, 2)
    pairs : ndarray of int, shape (k, 2)
        Scans between which the vehicle moved.
    cell_m : float
    """

    points_b: tuple[Array, ...]
    yaw: Array
    body_n: Array
    pairs: IntArray
    cell_m: float

    @property
    def knows_way(self) -> bool:
        """Whether enough of the pairs are parted by a way that the cells show, not by a turn."""
        apart_m = np.hypot(*(self.body_n[self.pairs[:, 1]] - self.body_n[self.pairs[:, 0]]).T)
        return int(np.sum(apart_m > 2.0 * self.cell_m)) >= FEWEST_PAIRS

    def likeness(self, reading: Reading) -> Array:
        """Share of points of each pair that fall upon those of the other scan, shape (k,)."""
        cells = [self._cells(k, reading) for k in range(len(self.points_b))]
        return np.array([overlap(cells[a], cells[b]) for a, b in self.pairs])

    def _cells(self, k: int, reading: Reading) -> IntArray:
        sign, offset = reading
        points_b = self.points_b[k] * [1.0, sign]
        points_n = self.body_n[k] + turned(points_b, np.full(len(points_b), self.yaw[k] + offset))
        return np.asarray(np.floor(points_n / self.cell_m), dtype=np.int64)


def moved_scans(sensor: Sensor, yaw: Signal, velocity: Velocity | None) -> Scans | None:
    """Scans between which the vehicle moves; None where there are too few pairs of them.

    Parameters
    ----------
    sensor : Sensor
        Of scans.
    yaw : Signal
        But for a constant, rad.
    velocity : Velocity or None
        None where nothing tells the way.
    """
    series = sensor.series
    assert isinstance(series, ScanSeries)
    if velocity is not None:
        series = series.crop(velocity.t[0], velocity.t[-1])
    series = series.crop(yaw.t[0], yaw.t[-1])
    if len(series) < 2 or not len(series.points_b):
        return None
    heading = np.interp(series.t, yaw.t, yaw.values)
    body_n = np.zeros((len(series), 2))
    if velocity is not None:
        v_b = velocity.v_b()
        at_t = turned(v_b, np.interp(velocity.t, yaw.t, yaw.values))
        way_n = way(velocity.t, at_t)
        body_n = np.stack([np.interp(series.t, velocity.t, axis) for axis in way_n.T], axis=1)
    range_m = float(np.median(np.hypot(*series.points_b[:, :2].T)))
    pairs = _pairs(series.t, heading, body_n, min(MOVED_M, MOVED_SHARE * range_m))
    if len(pairs) < FEWEST_PAIRS:
        return None
    seen, numbers = np.unique(pairs, return_inverse=True)
    cell_m = float(np.clip(CELL_SHARE * range_m, LEAST_CELL_M, MOST_CELL_M))
    points_b = tuple(_thinned(series, k) for k in seen.tolist())
    return Scans(points_b, heading[seen], body_n[seen], numbers.reshape(pairs.shape), cell_m)


def _pairs(t: Array, yaw: Array, body_n: Array, moved_m: float) -> IntArray:
    """Some scans, and with each the first after it that a turn or a way parts from it."""
    found = []
    for a in np.unique(np.linspace(0, len(t) - 1, 4 * MOST_PAIRS).astype(int)).tolist():
        later = slice(a + 1, int(np.searchsorted(t, t[a] + LONGEST_S)))
        turns = np.abs(yaw[later] - yaw[a]) > TURNED_RAD
        ways = np.hypot(*(body_n[later] - body_n[a]).T) > moved_m
        if np.any(turns | ways):
            found.append((a, a + 1 + int(np.argmax(turns | ways))))
    pairs = np.array(found, dtype=np.int64).reshape(-1, 2)
    return np.asarray(pairs[:: max(1, -(-len(pairs) // MOST_PAIRS))])


def _thinned(series: ScanSeries, k: int) -> Array:
    points_b = series.points_b[series.first[k] : series.first[k + 1], :2]
    return np.asarray(points_b[:: max(1, -(-len(points_b) // MOST_POINTS))])


def scan_findings(sensor: Sensor, like: MapLikeness, suspected: Sequence[str]) -> Iterator[Finding]:
    """Judge side and direction of a scanner's points.

    ``suspected`` names who else the scans' disagreement may be due to.
    """
    sign, offset = like.reading
    read = like.read("scans")
    if not like.better:
        if like.settled:
            yield Finding("scan axes", sensor.name, "ok", read)
        return
    turn = rotation_from_rpy([0.0, 0.0, offset])
    mended = ["port and starboard are exchanged"] if sign < 0 else []
    mended += [f"the points are turned by {np.degrees(offset):+.0f} deg"] if offset else []
    message = f"{read}, and by {like.best:.2f} once {' and '.join(mended)}{unless(suspected)}"
    mounting = fixes.mounting(turn @ np.diag([1.0, sign, sign]))
    fix = f"{mounting} (after the mounting that it has; in a mission folder scanner_axes: true)"
    yield Finding("scan axes", sensor.name, "warning", message, fix)
