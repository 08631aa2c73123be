"""The water's own motion where only water lock is left."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import gtsam_nav as gn
from gtsam_nav.frames import rotation_from_rpy
from gtsam_nav.mission import Mission
from gtsam_nav.series import DvlSeries, ReferenceSeries

CURRENT_N = np.array([0.12, -0.08, 0.0])
SPELL_S = (50.0, 110.0)


@pytest.fixture(scope="module")
def mission() -> Mission:
    """A survey whose DVL loses the bottom for a minute, in a current."""
    whole = gn.simulate("marina", seed=2, duration_s=160.0)
    dvl, reference = whole.sensors["dvl"], whole.sensors["reference"]
    series, truth = dvl.series, reference.series
    assert isinstance(series, DvlSeries)
    assert isinstance(truth, ReferenceSeries)
    assert truth.rpy is not None
    axes = [np.interp(series.t, truth.t, np.unwrap(axis)) for axis in truth.rpy.T]
    R_nd = rotation_from_rpy(np.stack(axes, axis=1)) @ dvl.R_bs
    lost = (series.t > SPELL_S[0]) & (series.t < SPELL_S[1])
    v_d = series.v_d - np.where(lost[:, None], np.einsum("nji,j->ni", R_nd, CURRENT_N), 0.0)
    through_water = replace(
        series, v_d=v_d, bottom_lock=series.bottom_lock & ~lost, valid=series.valid | lost
    )
    return whole.with_sensor(replace(dvl, series=through_water))


@pytest.mark.slow
def test_the_current_is_found_and_the_path_honest(mission: Mission) -> None:
    config = gn.load_config(None, ["gnss.use=gaps", "gnss.gaps_s=[[45,115]]", "sonar.use=false"])
    solution = gn.estimate(mission, "graph", config)
    assert solution.slow_states is not None
    for axis, name in enumerate("ne"):
        values, sigmas = solution.slow_states.columns[f"current_{name}_0_m_s"]
        assert abs(values[0] - CURRENT_N[axis]) < 3.0 * sigmas[0] < 0.12
    assert mission.reference is not None
    truth = mission.reference.series
    assert isinstance(truth, ReferenceSeries)
    trajectory = solution.trajectory
    assert trajectory.cov_pose_n is not None
    inside = (trajectory.t > SPELL_S[0]) & (trajectory.t < SPELL_S[1])
    for axis in range(2):
        there = np.interp(trajectory.t[inside], truth.t, truth.p_n[:, axis])
        sigma = np.sqrt(trajectory.cov_pose_n[inside, axis, axis])
        assert np.all(np.abs(trajectory.p_n[inside, axis] - there) < 3.0 * sigma)
