"""A recorded 2-D laser log by default settings, against surveyed relations between its scans."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import gtsam_nav as gn
from benchmarks.aces import near_relations, registered
from gtsam_nav.config import Config
from gtsam_nav.mission import Mission

pytestmark = pytest.mark.realdata


@pytest.fixture(scope="module")
def log(recorded_data: Path) -> Mission:
    return gn.open_mission(recorded_data / "carmen" / "aces.clf.bz2")


@pytest.mark.slow
def test_consecutive_relations(log: Mission) -> None:
    near = near_relations(log)
    assert len(near.t) == 1189
    found = registered(log, near, Config())
    assert found is not None
    assert found.median_m <= 0.027
    assert found.median_deg <= 0.25
    assert found.p95_m <= 0.09
    assert found.p95_deg <= 0.95


@pytest.mark.slow
def test_the_whole_log_closes_its_loops(log: Mission) -> None:
    drifted = gn.evaluate(gn.estimate(log, "dr")).relations
    solution = gn.estimate(log, "graph")
    found = gn.evaluate(solution).relations
    assert drifted is not None
    assert found is not None
    assert drifted.loops is not None
    assert found.loops is not None
    assert found.loops.n == drifted.loops.n == 90
    assert drifted.loops.median_m > 2.0
    assert found.loops.median_m <= 0.15
    assert found.loops.p95_m <= 0.5
    assert found.loops.p95_deg <= 4.0
    # the scans were stamped when they had come in
    (clock,) = solution.clock_offsets
    assert clock.sensor == "scans"
    assert -0.12 < clock.offset_s < -0.05
    assert np.all(np.isfinite(solution.trajectory.p_n))
