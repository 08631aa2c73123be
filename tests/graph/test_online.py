"""What the causal pass hands on to the batch."""

from __future__ import annotations

import numpy as np

from gtsam_nav.config import Config
from gtsam_nav.frames import Array
from gtsam_nav.graph.factors import X
from gtsam_nav.graph.measurements import build_problem
from gtsam_nav.graph.online import run_online
from gtsam_nav.graph.outset import mission_keyframes, start_and_motion
from gtsam_nav.simulation import SimulationSettings, simulate
from gtsam_nav.solution import no_progress


def test_fixes_tell_where_the_batch_begins_though_no_compass_does() -> None:
    """Of the factors alone the dead-reckoned track always costs least: they made it."""
    bare = SimulationSettings(sonar=None, landmarks=None)
    mission = simulate("marina", 3, 120.0, bare).without("heading", "attitude", "imu")
    assert mission.reference is not None
    config, none = Config(), np.empty(0, dtype=int)
    start, motion = start_and_motion(mission.without("gnss"), config)
    t = mission_keyframes(mission, np.empty(0), np.empty(0), config)
    problem = build_problem(mission, start, motion, t, config)
    true = mission.reference.series
    truth = np.stack([np.interp(t, true.t, axis) for axis in true.p_n.T], axis=1)

    def off(p_n: Array) -> float:
        return float(np.max(np.linalg.norm((p_n - truth)[:, :2], axis=1)))

    values = run_online(problem, None, none, config, no_progress).values
    causal = np.array([values.atNavState(X(k)).position() for k in range(len(t))])
    assert off(causal) < 3.0 < 10.0 < off(problem.p_n)
