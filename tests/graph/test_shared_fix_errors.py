"""The error that GNSS fixes share, as a state beside the keyframes."""

from __future__ import annotations

import gtsam
import numpy as np
import pytest

from gtsam_nav.config import Config
from gtsam_nav.graph.factors import X
from gtsam_nav.graph.measurements import build_problem
from gtsam_nav.graph.measurements.gnss import error_key
from gtsam_nav.graph.outset import start_and_motion
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.series import DepthSeries, DvlSeries, GnssSeries

SHARE, TIME_S = 0.8, 40.0
SIGMA = np.array([1.5, 1.0, 4.5])
"""Of a fix, along n, e and d."""


def test_what_fixes_share_is_as_large_on_each_axis_as_its_part_of_their_sigma() -> None:
    t = np.arange(0.0, 60.1)
    still, known = np.zeros((len(t), 3)), np.ones(len(t), dtype=bool)
    dvl = DvlSeries(t=t, v_d=still, sigma=0.1 + 0 * t, valid=known, bottom_lock=known)
    fixes = GnssSeries(t=t, p_n=still, sigma=np.tile(SIGMA, (len(t), 1)))
    noise = {"correlated_share": SHARE, "correlation_time_s": TIME_S}
    sensors = {
        "dvl": Sensor("dvl", "dvl", dvl),
        "gnss": Sensor("gnss", "gnss", fixes, noise=noise),
    }
    mission, config = Mission("still", sensors), Config()
    keyframes = np.arange(0.0, 60.1, 20.0)
    problem = build_problem(mission, *start_and_motion(mission, config), keyframes, config)
    errors = [error_key(0, k) for k in range(len(keyframes))]
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for entry in problem.entries:
        if entry.sensor == "gnss" and X(0) not in entry.gaussian.keys():  # noqa: SIM118
            graph.add(entry.gaussian)
    for key in errors:
        values.insert(key, gtsam.NavState())
    joint = gtsam.Marginals(graph, values).jointMarginalCovariance(errors)
    for a, b in ((0, 0), (2, 2), (0, 1), (1, 3)):
        apart_s = abs(keyframes[a] - keyframes[b])
        wanted = SHARE * SIGMA**2 * np.exp(-apart_s / TIME_S)
        found = joint.at(errors[a], errors[b])[3:6, 3:6]
        np.testing.assert_allclose(found, np.diag(wanted), rtol=1e-6, atol=1e-9)


def test_a_height_that_counts_nowhere_has_a_shared_error_like_the_rest() -> None:
    """Kilometres, as a 2-D fix states, would spoil the equations beside a depth sensor."""
    t = np.arange(0.0, 60.1)
    still, known = np.zeros((len(t), 3)), np.ones(len(t), dtype=bool)
    sigma = np.tile([1.5, 1.0, 9999.0], (len(t), 1))
    noise = {"correlated_share": SHARE, "correlation_time_s": TIME_S}
    sensors = {
        "dvl": Sensor(
            "dvl",
            "dvl",
            DvlSeries(t=t, v_d=still, sigma=0.1 + 0 * t, valid=known, bottom_lock=known),
        ),
        "depth": Sensor("depth", "depth", DepthSeries(t=t, depth_m=0 * t, sigma=0.1 + 0 * t)),
        "gnss": Sensor("gnss", "gnss", GnssSeries(t=t, p_n=still, sigma=sigma), noise=noise),
    }
    for beside, of_north in ((True, 1.0), (False, 9999.0 / 1.5)):
        mission, config = Mission("still", sensors), Config()
        mission = mission if beside else mission.without("depth")
        keyframes = np.arange(0.0, 60.1, 20.0)
        problem = build_problem(mission, *start_and_motion(mission, config), keyframes, config)
        first = error_key(0, 0)
        (prior,) = [e.gaussian for e in problem.entries if list(e.gaussian.keys()) == [first]]
        north, _, down = prior.noiseModel().sigmas()[3:6]
        assert down == pytest.approx(of_north * north)
