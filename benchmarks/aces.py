"""A recorded 2-D laser log against its surveyed relations: ``python -m benchmarks.aces FOLDER``.

The folder holds ``aces.clf.bz2`` (CARMEN: laser scans with odometry) and ``aces.relations`` (poses
of one scan in another, after Kümmerle et al., *On measuring the accuracy of SLAM algorithms*,
2009). Consecutive relations are registered from odometry by pIC; with ``--slam`` the whole log is
estimated by ``graph`` and scored on all relations, those between far apart times being its loops.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

import gtsam_nav as gn
from gtsam_nav.config import Config
from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.registration.pic import register
from gtsam_nav.series import BoolArray, IntArray, ScanSeries
from gtsam_nav.sonar.scans import Scan, planar_rotations

CONSECUTIVE_S = 30.0
"""Relations over a longer time are loops."""
SIGMA_RANGE_M, SIGMA_BEARING_DEG = 0.03, 0.5
"""Of the laser: its ranges come in steps of 0.05 m, its beams are 1 deg apart."""
NOISE = {"sigma_range_m": SIGMA_RANGE_M, "sigma_bearing_deg": SIGMA_BEARING_DEG}
SCANS_BEFORE = 1000
"""The first relation is about one of so many scans."""
ODOMETRY_SPREAD = np.array([0.1, 0.1, np.radians(2.0)])
"""How far a registration looks around the odometry's displacement over a relation."""
LASER = (
    "sonar.scans.min_interval_s=1.0",
    "pic.wall_radius_m=1.0",
    "pic.min_overlap=0.6",
    "graph.refinement.max_iterations=0",
)
"""What differs for a laser in corridors: defaults are those of a scanning sonar in a harbour."""


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


def read_log(path: Path) -> Mission:
    """The log by the package's own reader, with the laser's noise."""
    mission = gn.open_mission(path)
    laser = replace(scans_of(mission), noise=NOISE)
    return replace(mission, sensors={**mission.sensors, laser.name: laser})


def scans_of(mission: Mission) -> Sensor:
    """The laser."""
    (laser,) = mission.of_type("scans")
    return laser


def read_relations(path: Path, t: Array) -> Relations:
    """Relations between scans at times t; x, y and yaw only.

    The file's times are the log's: they differ from the mission's by a constant, which is that
    where they all fall on scans.
    """
    rows = np.loadtxt(path)
    first = rows[np.argmin(rows[:, 0]), 0]
    for zero_s in first - t[:SCANS_BEFORE]:
        a, b = (nearest(t, rows[:, c] - zero_s) for c in (0, 1))
        off = np.maximum(np.abs(t[a] + zero_s - rows[:, 0]), np.abs(t[b] + zero_s - rows[:, 1]))
        if np.all(off < 0.01):
            q = rows[:, [2, 3, 7]] * [1.0, -1.0, -1.0]
            return Relations(a, b, q, rows[:, 1] - rows[:, 0])
    raise SystemExit(f"{path}: the relations' times fall on no scans")


def nearest(t: Array, wanted: Array) -> IntArray:
    """Index into rising times t of the one nearest to each that is wanted."""
    after = np.clip(np.searchsorted(t, wanted), 1, len(t) - 1)
    return np.asarray(after - (wanted - t[after - 1] < t[after] - wanted), dtype=np.int64)


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


def scan_of(laser: Sensor, k: int) -> Scan:
    """Scan k with the laser's noise."""
    series = laser.series
    assert isinstance(series, ScanSeries)
    xy = series.points_b[series.first[k] : series.first[k + 1], :2]
    r = np.maximum(np.linalg.norm(xy, axis=1), 1e-6)
    ray = xy / r[:, None]
    across = np.column_stack([-ray[:, 1], ray[:, 0]]) * (r * np.radians(SIGMA_BEARING_DEG))[:, None]
    along = ray * SIGMA_RANGE_M
    cov = np.einsum("ni,nj->nij", along, along) + np.einsum("ni,nj->nij", across, across)
    return Scan(float(series.t[k]), xy, cov)


def registered(laser: Sensor, odometry: Array, relations: Relations, config: Config) -> Array:
    """Relative poses by pIC from odometry (poses of all scans); a failure keeps the odometry's."""
    prior = between(odometry, relations.a, relations.b)
    cov = np.diag(ODOMETRY_SPREAD**2)
    found = prior.copy()
    for k, (a, b) in enumerate(zip(relations.a.tolist(), relations.b.tolist(), strict=True)):
        match = register(scan_of(laser, a), scan_of(laser, b), prior[k], cov, config.pic)
        if match.ok:
            found[k] = match.q
    return found


def estimated(mission: Mission, method: str, config: Config) -> Array:
    """Poses x, y, yaw of all scans by a method, shape (n, 3)."""
    trajectory = gn.estimate(mission, method, config).trajectory
    inside = np.clip(scans_of(mission).series.t, trajectory.t[0], trajectory.t[-1])
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
    laser = scans_of(log)
    odometry = estimated(log, "dr", config)
    relations = read_relations(arguments.folder / "aces.relations", laser.series.t)
    near = relations.select(relations.elapsed_s < CONSECUTIVE_S)
    far = relations.select(relations.elapsed_s >= CONSECUTIVE_S)
    rows = {
        "odometry, consecutive": errors(between(odometry, near.a, near.b), near),
        "pic, consecutive": errors(registered(laser, odometry, near, config), near),
        "odometry, loops": errors(between(odometry, far.a, far.b), far),
    }
    if arguments.slam:
        begin = time.perf_counter()
        poses = estimated(log, "graph", config)
        print(f"graph: {time.perf_counter() - begin:.0f} s")
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
