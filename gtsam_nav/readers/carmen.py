"""CARMEN logs: laser scans and odometry of ground robots.

======  ========================================================================================
FLASER  ``n r_1 .. r_n  x y theta  odom_x odom_y odom_theta  ipc_t host logger_t``: n ranges
        (m) from right to left over 180 degrees, both ends included where n is odd; the laser's
        pose and the odometry's
ODOM    ``x y theta tv rv accel  ipc_t host logger_t``: pose, m and rad, counter-clockwise
PARAM   ``robot_frontlaser_offset`` is the laser's place ahead of the robot's centre,
        ``robot_front_laser_max`` the range that stands for no echo
======  ========================================================================================

Stamps are ``ipc_t``: when a message came in, which for a scan is some time after it was taken.
Speeds are those between successive odometry poses: many robots leave tv and rv at zero. Surveyed
relations in a file ``NAME.relations`` beside the log are its ground truth.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission, Rejection, Sensor
from gtsam_nav.preprocess.cleaning import screen, tidy
from gtsam_nav.readers._carmen_relations import ENDING, read_relations
from gtsam_nav.readers._clock import on_mission_time
from gtsam_nav.readers._figures import NO_FIGURES, Figures
from gtsam_nav.readers._odometry import speeds_between
from gtsam_nav.readers._text import TRUNCATED, first_lines, said_of_end, stream_lines
from gtsam_nav.sensors.noise import OdometryNoise
from gtsam_nav.series import BoolArray, OdometrySeries, ReferenceSeries, ScanSeries
from gtsam_nav.solution import Progress, no_progress

NAME = "CARMEN log"
EXPECTS = "a text file (.clf, .log, .txt; plain, .gz or .bz2) with FLASER and ODOM lines"
BY_FIGURES = {"odometry": "odometry"}

LINES_TO_KNOW_IT_BY = 400
LINE = re.compile(r"(FLASER \d+( [\d.]+){2}|ODOM( -?[\d.eE+-]+){6} )")

NO_ECHO_M = 50.0
"""Ranges from here on are none, whatever the log's own limit."""
FIELD_OF_VIEW_RAD = np.pi
LASER_NOISE = {"sigma_range_m": 0.03, "sigma_bearing_deg": 0.5}
"""Of the lasers that such robots carry: ranges in steps of some centimetres, half a beam."""
LATE_S = 0.1
"""By which scans are stamped late, or thereabouts: the graph finds it."""
POSIX_S = 1e8
"""Stamps beyond are seconds since 1970."""
MALFORMED = "malformed line"


def can_open(path: Path) -> bool:
    """Whether the path is a text file that begins with lines of this kind."""
    return any(LINE.match(line) for line in first_lines(path, LINES_TO_KNOW_IT_BY))


def read(path: Path, progress: Progress = no_progress, figures: Figures = NO_FIGURES) -> Mission:
    """Read a log.

    Raises
    ------
    DataError
        Where it holds neither a whole scan nor two poses.
    """
    log, line = _Log(), ""
    for k, (line, fraction) in enumerate(stream_lines(path, whole=False)):
        if k % 200 == 0:
            progress("read mission", fraction)
        log.add(line)
    progress("read mission", 1.0)
    if log.last_is_bad:
        log.cut()
    noise = OdometryNoise.model_validate(figures.get("odometry", {}))
    scans, scan_rejections = log.scan_series()
    odometry, odometry_rejections = log.odometry_series(noise)
    sensors: dict[str, Sensor] = {}
    if odometry is not None:
        sensors["odometry"] = Sensor("odometry", "odometry", odometry)
    if scans is not None:
        sensors["scans"] = Sensor(
            "scans", "scans", scans, noise=LASER_NOISE, time_offset_sigma_s=LATE_S
        )
    if not sensors:
        raise DataError("no whole FLASER line, and no two poses to tell a speed", path)
    first = next(iter(sensors.values())).series.t[0]
    mission = Mission(
        name=re.sub(r"(\.(clf|log|txt))?(\.(gz|bz2))?$", "", path.name),
        sensors=sensors,
        start_utc=0.0 if first > POSIX_S else None,
        rejections=(*odometry_rejections, *scan_rejections),
        warnings=(*log.warnings(), *said_of_end(line)),
        sources=(path,),
    )
    mission = on_mission_time(mission, {"odometry": 0.0, "scans": 0.0})
    return mission if scans is None else _with_relations(mission, path, scans)


def _with_relations(mission: Mission, path: Path, scans: ScanSeries) -> Mission:
    """The mission with the relations that lie beside a log, whose scans still have its stamps."""
    beside = path.with_name(mission.name + ENDING)
    left = mission.first("scans")
    if left is None or not beside.is_file():
        return mission
    series = left.series
    zero = scans.t[scans.row == series.row[0]][0] - series.t[0]
    relations, warning = read_relations(beside, left.name, series.t + zero)
    if relations is not None:
        relations = replace(relations, t=relations.t - zero)
    return replace(
        mission,
        relations=relations,
        warnings=(*mission.warnings, *([warning] if warning else [])),
        sources=(*mission.sources, beside),
    )


@dataclass
class _Kind:
    """Lines of one word: stamp, odometry pose, and why a line is none."""

    t: list[float] = field(default_factory=list)
    poses: list[list[float]] = field(default_factory=list)
    reasons: list[str] = field(default_factory=list)

    def add(self, t: float, pose: list[float], reason: str = "") -> None:
        """One line."""
        self.t.append(t)
        self.poses.append(pose)
        self.reasons.append(reason)

    def refused(self) -> dict[str, BoolArray]:
        """Lines that are none, by reason."""
        reasons = np.array(self.reasons, dtype=object)
        return {reason: reasons == reason for reason in sorted({*self.reasons} - {""})}


UNKNOWN = [np.nan] * 3


@dataclass
class _Log:
    laser: _Kind = field(default_factory=_Kind)
    odom: _Kind = field(default_factory=_Kind)
    points: list[Array] = field(default_factory=list)
    params: dict[str, float] = field(default_factory=dict)
    others: Counter[str] = field(default_factory=Counter)
    last_is_bad: str = ""

    def add(self, line: str) -> None:
        """One line."""
        word, _, rest = line.partition(" ")
        if word not in ("FLASER", "ODOM", "PARAM"):
            self.others[word[:20]] += bool(word) and not word.startswith("#")
            return
        self.last_is_bad = ""
        try:
            {"FLASER": self._flaser, "ODOM": self._odom, "PARAM": self._param}[word](rest.split())
        except (ValueError, IndexError):
            self.last_is_bad = word
            if word == "FLASER":
                self._add_scan(np.nan, UNKNOWN, np.empty((0, 2)), MALFORMED)
            elif word == "ODOM":
                self.odom.add(np.nan, UNKNOWN, MALFORMED)

    def cut(self) -> None:
        """Name the last line's fault for what it is."""
        kind = {"FLASER": self.laser, "ODOM": self.odom}.get(self.last_is_bad)
        if kind is not None:
            kind.reasons[-1] = TRUNCATED

    def _param(self, f: list[str]) -> None:
        try:
            self.params[f[0]] = float(f[1])
        except ValueError:
            return  # a word

    def _odom(self, f: list[str]) -> None:
        if len(f) != 9:
            raise ValueError("nine fields are needed")
        self.odom.add(float(f[6]), [float(text) for text in f[:3]])

    def _flaser(self, f: list[str]) -> None:
        n = int(f[0])
        if n < 1 or len(f) != n + 10:
            raise ValueError("the number of ranges is another")
        ranges = np.array(f[1 : n + 1], dtype=float)
        pose = [float(text) for text in f[n + 4 : n + 7]]
        limit = min(self.params.get("robot_front_laser_max", NO_ECHO_M), NO_ECHO_M)
        seen = (ranges > 0) & (ranges < limit)
        # 181 rays are a degree apart, and so are 180, without the one to the left
        steps = n - 1 if n % 2 and n > 1 else n
        angle = -FIELD_OF_VIEW_RAD / 2 + np.arange(n) * FIELD_OF_VIEW_RAD / steps
        x = ranges * np.cos(angle) + self.params.get("robot_frontlaser_offset", 0.0)
        # y is to starboard
        points = np.column_stack([x, -ranges * np.sin(angle)])[seen]
        self._add_scan(float(f[n + 7]), pose, points, "" if np.any(seen) else "no echo")

    def _add_scan(self, t: float, pose: list[float], points: Array, reason: str = "") -> None:
        self.laser.add(t, pose, reason)
        self.points.append(points)

    def scan_series(self) -> tuple[ScanSeries | None, list[Rejection]]:
        """The scans, in the robot's axes."""
        if not self.points:
            return None, []
        t = np.array(self.laser.t)
        kept, rejections = screen(ScanSeries, "scans", {"t": t}, refused=self.laser.refused())
        if not len(kept):
            return None, rejections
        picked = [self.points[k] for k in kept]
        first = np.concatenate([[0], np.cumsum([len(p) for p in picked])]).astype(np.int64)
        series = ScanSeries(t=t[kept], row=kept, first=first, points_b=np.concatenate(picked))
        return series, rejections

    def odometry_series(
        self, noise: OdometryNoise
    ) -> tuple[OdometrySeries | None, list[Rejection]]:
        """Speeds between the poses of ODOM lines, else those of FLASER lines."""
        kind = self.odom if self.odom.t else self.laser
        t, poses = np.array(kind.t), np.array(kind.poses).reshape(-1, 3)
        # a series of positions is screened as one of poses must be
        kept, rejections = screen(
            ReferenceSeries, "odometry", {"t": t, "p_n": poses}, refused=kind.refused()
        )
        if len(kept) < 2:
            return None, rejections
        middle, v_b, yaw_rate = speeds_between(t[kept], poses[kept])
        columns = {
            "t": middle,
            "v_b": v_b,
            "yaw_rate": yaw_rate,
            "sigma_v": np.full(len(middle), noise.sigma_v_m_s),
            "sigma_yaw_rate": np.full(len(middle), noise.sigma_yaw_rate_rad_s),
        }
        series, more = tidy(OdometrySeries, "odometry", columns)
        return series, rejections + more

    def warnings(self) -> list[str]:
        """What was not read."""
        if not (others := +self.others):
            return []
        listed = ", ".join(f"{word} ({n})" for word, n in others.most_common(5))
        return [f"lines that begin with other words are left out: {listed}"]
