"""A car with a MEMS IMU and RTK positions withheld for 15 s at a time."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import gtsam_nav as gn
from gtsam_nav.frames import Array
from gtsam_nav.series import ReferenceSeries
from gtsam_nav.solution import Solution

STARTS_S = np.array([60.0, 115.0, 170.0, 225.0, 280.0, 340.0, 430.0, 490.0])
GAP_S = 15.0
CARD_OFFSET_S = -0.27


def gap_errors(solution: Solution, begin_s: Array) -> tuple[Array, Array]:
    """Horizontal error in the middle of each gap, m, and its three sigma along the error."""
    assert solution.reference is not None
    series = solution.reference.series
    assert isinstance(series, ReferenceSeries)
    trajectory = solution.trajectory
    assert trajectory.cov_pose_n is not None
    errors, bounds = [], []
    for middle_s in begin_s + GAP_S / 2:
        k = int(np.argmin(np.abs(series.t - middle_s)))
        i = int(np.argmin(np.abs(trajectory.t - series.t[k])))
        place = [np.interp(series.t[k], trajectory.t, axis) for axis in trajectory.p_n.T]
        antenna = place + trajectory.R_nb[i] @ solution.reference.xyz_b
        error = (antenna - series.p_n[k])[:2]
        size = float(np.linalg.norm(error))
        along = error / size
        errors.append(size)
        bounds.append(3.0 * np.sqrt(along @ trajectory.cov_pose_n[i][:2, :2] @ along))
    return np.array(errors), np.array(bounds)


@pytest.mark.slow
@pytest.mark.realdata
def test_gaps_are_bridged_and_the_imus_clock_is_found(recorded_data: Path) -> None:
    """From a start at no offset at all; the receiver's velocities have a lag of their own."""
    mission = gn.open_mission(recorded_data / "rtk_mems_car")
    imu, gnss = mission.sensors["imu"], mission.sensors["gnss"]
    mission = mission.with_sensor(replace(imu, series=imu.series.shift(-CARD_OFFSET_S)))
    begin_s = gnss.series.t[0] + STARTS_S
    gaps = [[float(t), float(t + GAP_S)] for t in begin_s]
    config = gn.load_config(None, ["gnss.use=gaps", f"gnss.gaps_s={gaps}"])
    solution = gn.estimate(mission, "graph", config)

    errors, bounds = gap_errors(solution, begin_s)
    assert np.median(errors) <= 0.3
    assert np.max(errors) <= 1.0
    assert np.mean(errors < bounds) >= 0.8

    clock, lag = solution.clock_offsets
    assert (clock.sensor, clock.quantity) == ("imu", "time_offset")
    assert abs(clock.offset_s - CARD_OFFSET_S) < 0.03
    assert clock.sigma_s < 0.01
    assert (lag.sensor, lag.quantity) == ("gnss", "velocity_lag")
    assert abs(lag.offset_s) < 0.03
    assert lag.sigma_s < 0.01
