"""A recorded 2-D laser log against its surveyed relations: ``python -m benchmarks.aces FOLDER``.

The folder holds ``aces.clf.bz2`` (CARMEN: laser scans with odometry) and ``aces.relations`` (poses
of one scan in another, after Kümmerle et al., *On measuring the accuracy of SLAM algorithms*,
2009). Consecutive relations are registered from odometry by pIC; with ``--slam`` the whole log is
estimated by ``graph`` and scored on all relations, those between far apart times being its loops.
"""

from __future__ import annotations

import argparse
import bz2
import json
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

import gtsam_nav as gn
from gtsam_nav.config import Config
from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.registration.pic import register
from gtsam_nav.series import BoolArray, IntArray, OdometrySeries, ScanSeries
from gtsam_nav.sonar.scans import Scan, planar_rotations

CONSECUTIVE_S = 30.0
"""Relations over a longer time are loops."""
MAX_RANGE_M = 49.0
"""The log says 50 or 81.83 where the laser saw nothing."""
SIGMA_RANGE_M, SIGMA_BEARING_DEG = 0.03, 0.5
"""Of the laser: its ranges come in steps of 0.05 m, its beams are 1 deg apart."""
ODOMETRY_SPREAD = np.array([0.1, 0.1, np.radians(2.0)])
"""How far a registration looks around the odometry's displacement over a relation."""
LASER = (
    "sonar.scans.min_interval_s=0.5",
    "pic.wall_radius_m=1.0",
    "pic.min_overlap=0.6",
    "pic.floor_xy_m=0.02",
    "pic.floor_yaw_deg=0.2",
    "graph.refinement.max_iterations=0",
    "graph.loops.radius_m=8.0",
)
"""What differs for a laser in corridors: defaults are those of a scanning sonar in a harbour."""
SIGMA_V_M_S, SIGMA_YAW_RATE_RAD_S = 0.2, 0.15
"""Of the odometry, as the log itself tells: the spread of its tenth worst step against pIC."""


@dataclass(frozen=True)
class LaserLog:
    """A CARMEN log: ranges (n, beams) and odometry poses (n, 3) x, y, yaw at times (n,).

    Angles and y are turned from the log's (left positive) to FRD.
    """

    t: Array
    ranges_m: Array
    odometry: Array

    def points(self, k: int) -> Array:
        """Echoes of scan k, shape (m, 2), forward and starboard, m."""
        beams = self.ranges_m.shape[1]
        bearing = np.radians(90.0 - np.arange(beams) * 180.0 / beams)
        seen = self.ranges_m[k] < MAX_RANGE_M
        r = self.ranges_m[k, seen]
        return np.column_stack([r * np.cos(bearing[seen]), r * np.sin(bearing[seen])])


@dataclass(frozen=True)
class Relations:
    """Surveyed poses x, y, yaw (n, 3) of scan b in scan a, by the indices of the scans."""

    a: IntArray
    b: IntArray
    q: Array
    elapsed_s: Array

    def select(self, which: BoolArray) -> Relations:
        """Those that a mask picks."""
        return Relations(self.a[which], self.b[which], self.q[which], self.elapsed_s[which])


@dataclass(frozen=True)
class Errors:
    """Of relative poses: medians and 95 % points, m and deg."""

    relations: int
    median_m: float
    median_deg: float
    p95_m: float
    p95_deg: float


def read_log(path: Path) -> LaserLog:
    """The FLASER lines of a CARMEN log."""
    rows = []
    with bz2.open(path, "rt", encoding="ascii") as lines:
        for line in lines:
            words = line.split()
            if words and words[0] == "FLASER":
                n = int(words[1])
                odometry = [float(w) for w in words[n + 5 : n + 8]]
                rows.append((float(words[n + 8]), [float(w) for w in words[2 : n + 2]], odometry))
    t, ranges, odometry = (np.array(column) for column in zip(*rows, strict=True))
    first = np.concatenate([[True], np.diff(t) > 0])
    return LaserLog(t[first], ranges[first], odometry[first] * [1.0, -1.0, -1.0])


def read_relations(path: Path, t: Array) -> Relations:
    """Relations between scans at times t; x, y and yaw only."""
    rows = np.loadtxt(path)
    a, b = (np.argmin(np.abs(t - rows[:, [c]]), axis=1) for c in (0, 1))
    stamped = np.maximum(np.abs(t[a] - rows[:, 0]), np.abs(t[b] - rows[:, 1])) < 0.01
    if not np.all(stamped):
        raise SystemExit(f"{path}: {np.sum(~stamped)} relations have no scan")
    q = rows[:, [2, 3, 7]] * [1.0, -1.0, -1.0]
    return Relations(a, b, q, rows[:, 1] - rows[:, 0])


def between(poses: Array, a: IntArray, b: IntArray) -> Array:
    """Poses b in poses a: x, y, yaw, shape (n, 3)."""
    turn = planar_rotations(poses[a, 2])
    xy = np.einsum("nji,nj->ni", turn, poses[b, :2] - poses[a, :2])
    return np.column_stack([xy, wrap_angle(poses[b, 2] - poses[a, 2])])


def errors(q: Array, relations: Relations) -> Errors:
    """How far relative poses are from the surveyed ones."""
    off = q - relations.q
    m, deg = np.hypot(off[:, 0], off[:, 1]), np.abs(np.degrees(wrap_angle(off[:, 2])))
    return Errors(
        len(q),
        *(float(f) for f in (np.median(m), np.median(deg), *np.percentile([m, deg], 95, axis=1))),
    )


def scan_of(log: LaserLog, k: int) -> Scan:
    """A scan with the laser's noise."""
    xy = log.points(k)
    r = np.maximum(np.linalg.norm(xy, axis=1), 1e-6)
    ray = xy / r[:, None]
    across = np.column_stack([-ray[:, 1], ray[:, 0]]) * (r * np.radians(SIGMA_BEARING_DEG))[:, None]
    along = ray * SIGMA_RANGE_M
    cov = np.einsum("ni,nj->nij", along, along) + np.einsum("ni,nj->nij", across, across)
    return Scan(float(log.t[k]), xy, cov)


def registered(log: LaserLog, relations: Relations, config: Config) -> Array:
    """Relative poses by pIC from odometry; a failure keeps the odometry's."""
    prior = between(log.odometry, relations.a, relations.b)
    cov = np.diag(ODOMETRY_SPREAD**2)
    found = prior.copy()
    for k, (a, b) in enumerate(zip(relations.a.tolist(), relations.b.tolist(), strict=True)):
        match = register(scan_of(log, a), scan_of(log, b), prior[k], cov, config.pic)
        if match.ok:
            found[k] = match.q
    return found


def mission_of(log: LaserLog) -> Mission:
    """The log as a mission: odometry from its poses, and one scan a laser scan."""
    dt = np.diff(log.t)
    n = len(log.t)
    index = np.arange(n)
    step = between(log.odometry, index[:-1], index[1:])
    # a step's velocity holds at its middle
    odometry = OdometrySeries(
        t=0.5 * (log.t[1:] + log.t[:-1]) - log.t[0],
        v_b=step[:, :2] / dt[:, None],
        yaw_rate=step[:, 2] / dt,
        sigma_v=np.full(n - 1, SIGMA_V_M_S),
        sigma_yaw_rate=np.full(n - 1, SIGMA_YAW_RATE_RAD_S),
    )
    points = [log.points(k) for k in range(n)]
    first = np.concatenate([[0], np.cumsum([len(p) for p in points])]).astype(np.int64)
    scans = ScanSeries(t=log.t - log.t[0], first=first, points_b=np.concatenate(points))
    noise = {"sigma_range_m": SIGMA_RANGE_M, "sigma_bearing_deg": SIGMA_BEARING_DEG}
    return Mission(
        name="aces",
        sensors={
            "odometry": Sensor("odometry", "odometry", odometry),
            "laser": Sensor("laser", "scans", scans, noise=noise),
        },
    )


def estimated(log: LaserLog, config: Config) -> Array:
    """Poses x, y, yaw of all scans by the method ``graph``."""
    trajectory = gn.estimate(mission_of(log), "graph", config).trajectory
    t = log.t - log.t[0]
    inside = np.clip(t, trajectory.t[0], trajectory.t[-1])
    xy = [np.interp(inside, trajectory.t, trajectory.p_n[:, c]) for c in (0, 1)]
    yaw = np.interp(inside, trajectory.t, np.unwrap(trajectory.rpy[:, 2]))
    return np.column_stack([*xy, yaw])


def main() -> None:
    """Print the table, and write it as JSON where asked."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.aces", description=__doc__)
    parser.add_argument("folder", type=Path, help="holds aces.clf.bz2 and aces.relations")
    parser.add_argument("--slam", action="store_true", help="estimate the whole log too")
    parser.add_argument("-c", "--config", type=Path, help="settings, instead of those for a laser")
    parser.add_argument("--json", type=Path, help="write the figures here")
    arguments = parser.parse_args()
    config = gn.load_config(arguments.config, () if arguments.config else LASER)
    log = read_log(arguments.folder / "aces.clf.bz2")
    relations = read_relations(arguments.folder / "aces.relations", log.t)
    near = relations.select(relations.elapsed_s < CONSECUTIVE_S)
    far = relations.select(relations.elapsed_s >= CONSECUTIVE_S)
    rows = {
        "odometry, consecutive": errors(between(log.odometry, near.a, near.b), near),
        "pic, consecutive": errors(registered(log, near, config), near),
        "odometry, loops": errors(between(log.odometry, far.a, far.b), far),
    }
    if arguments.slam:
        poses = estimated(log, config)
        rows["graph, consecutive"] = errors(between(poses, near.a, near.b), near)
        rows["graph, loops"] = errors(between(poses, far.a, far.b), far)
    print("                        relations   median              95 %")
    for name, e in rows.items():
        print(
            f"{name:24s}{e.relations:8d}   {e.median_m:.3f} m {e.median_deg:.2f}°"
            f"   {e.p95_m:7.3f} m {e.p95_deg:6.2f}°"
        )
    if arguments.json:
        document = {name: asdict(e) for name, e in rows.items()}
        arguments.json.write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
