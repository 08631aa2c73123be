"""RTK that turns from float to fixed, through the methods that use all fixes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import gtsam_nav as gn
from gtsam_nav.frames import Array
from gtsam_nav.series import GnssSeries
from gtsam_nav.simulation import simulate

pytestmark = pytest.mark.slow
FLOAT_S, OFF_N = 40.0, np.array([1.2, -0.9, 0.8])


def rtk_mission(sigma_float: float, share: float = 0.0) -> gn.Mission:
    """A boat whose receiver is off by 1.5 m in its first 40 s."""
    mission = simulate("laps", seed=3, duration_s=120.0)
    receiver, truth = mission.first("gnss"), mission.reference
    assert receiver is not None
    assert truth is not None
    series, true = receiver.series, truth.series
    assert isinstance(series, GnssSeries)
    v_n = series.v_n
    p_n = np.stack([np.interp(series.t, true.t, axis) for axis in _places(true).T], axis=1)
    fixed = series.t >= FLOAT_S
    sigma = np.where(fixed, 0.02, sigma_float)[:, None] * np.ones(3)
    white = np.sqrt(1 - share) * 0.02
    p_n += white * np.random.default_rng(0).normal(size=p_n.shape) + ~fixed[:, None] * OFF_N
    rtk = GnssSeries(t=series.t, p_n=p_n, sigma=sigma, v_n=v_n)
    noise = {**receiver.noise, "correlated_share": share, "correlation_time_s": 60.0}
    # the reference is the body's origin
    return mission.with_sensor(replace(receiver, series=rtk, xyz_b=np.zeros(3), noise=noise))


def _places(true: object) -> Array:
    return np.asarray(getattr(true, "p_n"))  # noqa: B009


@pytest.mark.parametrize("method", ["graph", "ins-ekf"])
@pytest.mark.parametrize(("sigma_float", "share"), [(0.02, 0.0), (1.0, 0.9), (1.0, 0.0)])
def test_the_fixed_solution_is_believed(method: str, sigma_float: float, share: float) -> None:
    mission = rtk_mission(sigma_float, share)
    solution = gn.estimate(mission, method=method)
    scores = gn.evaluate(solution, solution.reference)
    late = solution.trajectory.t > FLOAT_S + 5.0
    assert scores.nees is not None
    assert scores.nees.mean < 4.0
    true = mission.reference
    assert true is not None
    t = solution.trajectory.t[late]
    places = np.stack([np.interp(t, true.series.t, a) for a in _places(true.series).T], axis=1)
    off_m = np.linalg.norm((solution.trajectory.p_n[late] - places)[:, :2], axis=1)
    assert np.sqrt(np.mean(off_m**2)) < 0.1
    left_out = [r for r in solution.rejections if r.sensor == "gnss" and r.t > FLOAT_S]
    assert len(left_out) < 5
    jumps = [said for said in solution.warnings if "a jump that the receiver" in said]
    assert len(jumps) == (sigma_float < 1.0)
