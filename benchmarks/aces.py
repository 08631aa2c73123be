"""A recorded 2-D laser log against its surveyed relations: ``python -m benchmarks.aces FOLDER``.

The folder holds ``aces.clf.bz2`` (CARMEN: laser scans with odometry) and ``aces.relations`` (poses
of one scan in another, after Kümmerle et al., *On measuring the accuracy of SLAM algorithms*,
2009). Consecutive relations are registered from odometry by pIC; with ``--slam`` the whole log is
estimated by ``graph`` and scored on all relations, those between far apart times being its loops.
All settings are the defaults.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import asdict
from pathlib import Path

import numpy as np

import gtsam_nav as gn
from gtsam_nav.config import Config
from gtsam_nav.errors import GtsamNavError
from gtsam_nav.evaluation.relations import (
    LOOP_S,
    RelationErrors,
    between,
    planar_poses,
    relation_scores,
)
from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission, Relations
from gtsam_nav.registration.pic import register
from gtsam_nav.series import IntArray
from gtsam_nav.sonar.echoes import echoes_of_scans
from gtsam_nav.sonar.scans import Scan

ODOMETRY_SPREAD = np.array([0.1, 0.1, np.radians(2.0)])
"""How far a registration looks around the odometry's displacement over a relation."""


def near_relations(mission: Mission) -> Relations:
    """Those between scans that follow each other."""
    relations = mission.relations
    assert relations is not None
    near = np.diff(relations.t, axis=1)[:, 0] < LOOP_S
    return Relations(relations.sensor, relations.t[near], relations.q[near])


def registered(mission: Mission, relations: Relations, config: Config) -> RelationErrors | None:
    """Errors of relative poses by pIC from odometry; where it fails the odometry's counts."""
    trajectory = gn.estimate(mission, "dr", config).trajectory
    inside = np.clip(relations.t, trajectory.t[0], trajectory.t[-1])
    found = between(*(planar_poses(trajectory, t) for t in inside.T))
    for n, (a, b) in enumerate(scans_of(mission, relations)):
        match = register(a, b, found[n], np.diag(ODOMETRY_SPREAD**2), config.pic)
        if match.ok:
            found[n] = match.q
    return RelationErrors.of(found - relations.q)


def scans_of(mission: Mission, relations: Relations) -> list[tuple[Scan, Scan]]:
    """The two scans of each relation."""
    sensor = mission.sensors[relations.sensor]
    echoes = echoes_of_scans(sensor)
    first = np.searchsorted(echoes.beam, np.arange(len(sensor.series) + 1))

    def scan(k: int) -> Scan:
        own = slice(first[k], first[k + 1])
        return Scan(float(sensor.series.t[k]), echoes.xy_b[own], echoes.cov_b[own])

    return [(scan(a), scan(b)) for a, b in nearest(sensor.series.t, relations.t).tolist()]


def nearest(t: Array, wanted: Array) -> IntArray:
    """Index into rising times t of the one nearest to each that is wanted."""
    return np.asarray(np.searchsorted(0.5 * (t[1:] + t[:-1]), wanted), dtype=np.int64)


def main() -> None:
    """Print the table, and write it as JSON where asked."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.aces", description=__doc__)
    parser.add_argument("folder", type=Path, help="holds aces.clf.bz2 and aces.relations")
    parser.add_argument("--slam", action="store_true", help="estimate the whole log too")
    parser.add_argument("-c", "--config", type=Path, help="settings other than the defaults")
    parser.add_argument("--json", type=Path, help="write the figures here")
    arguments = parser.parse_args()
    try:
        config = gn.load_config(arguments.config)
        log = gn.open_mission(arguments.folder / "aces.clf.bz2")
    except GtsamNavError as error:
        parser.error(str(error))
    if log.relations is None:
        parser.error(f"{arguments.folder}: aces.relations is missing")
    odometry = relation_scores(gn.estimate(log, "dr", config).trajectory, log.relations)
    rows = {
        "odometry, consecutive": odometry.near,
        "pic, consecutive": registered(log, near_relations(log), config),
        "odometry, loops": odometry.loops,
    }
    if arguments.slam:
        begin = time.perf_counter()
        scores = gn.evaluate(gn.estimate(log, "graph", config)).relations
        assert scores is not None
        print(f"graph: {time.perf_counter() - begin:.0f} s")
        rows |= {"graph, consecutive": scores.near, "graph, loops": scores.loops}
    print("                        relations   median              95 %")
    for name, e in rows.items():
        assert e is not None
        print(
            f"{name:24s}{e.n:8d}   {e.median_m:.3f} m {e.median_deg:.2f}°"
            f"   {e.p95_m:7.3f} m {e.p95_deg:6.2f}°"
        )
    if arguments.json:
        document = {name: asdict(e) for name, e in rows.items() if e is not None}
        arguments.json.write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
