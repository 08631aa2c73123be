"""pIC on a recorded 2-D laser log: surveyed relations between consecutive scans."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import gtsam_nav as gn
from benchmarks.aces import (
    CONSECUTIVE_S,
    LASER,
    Relations,
    between,
    errors,
    estimated,
    read_log,
    read_relations,
    registered,
    scans_of,
)
from gtsam_nav.config import Config
from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission

pytestmark = pytest.mark.realdata


@pytest.fixture(scope="module")
def log(recorded_data: Path) -> Mission:
    return read_log(recorded_data / "carmen" / "aces.clf.bz2")


@pytest.fixture(scope="module")
def relations(recorded_data: Path, log: Mission) -> Relations:
    t = scans_of(log).series.t
    return read_relations(recorded_data / "carmen" / "aces.relations", t)


@pytest.fixture(scope="module")
def odometry(log: Mission) -> Array:
    return estimated(log, "dr", Config())


@pytest.mark.parametrize("overrides", [(), LASER])
def test_consecutive_relations(
    log: Mission, odometry: Array, relations: Relations, overrides: tuple[str, ...]
) -> None:
    near = relations.select(relations.elapsed_s < CONSECUTIVE_S)
    assert len(near.a) == 1189
    found = errors(registered(scans_of(log), odometry, near, gn.load_config(None, overrides)), near)
    assert found.median_m <= 0.027
    assert found.median_deg <= 0.25
    assert found.p95_m <= 0.09
    assert found.p95_deg <= 0.95


@pytest.mark.slow
def test_the_whole_log_closes_its_loops(
    log: Mission, odometry: Array, relations: Relations
) -> None:
    far = relations.select(relations.elapsed_s >= CONSECUTIVE_S)
    assert len(far.a) == 90
    drifted = errors(between(odometry, far.a, far.b), far)
    poses = estimated(log, "graph", gn.load_config(None, LASER))
    found = errors(between(poses, far.a, far.b), far)
    assert np.isfinite(poses).all()
    assert drifted.median_m > 2.0
    # the median only: a stretch whose loops are not found stays metres off
    assert found.median_m <= 0.15
