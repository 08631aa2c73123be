"""The smoother of a filter that began without a yaw: never worse than the filter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import gtsam_nav as gn
from gtsam_nav.config import load_config
from gtsam_nav.ekf.inertial_start import FOUND_YAW_SIGMA_RAD, FoundYaw, inertial_start
from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.mission import Mission
from gtsam_nav.preprocess.settings import MotionSettings
from gtsam_nav.series import GnssSeries, ReferenceSeries
from gtsam_nav.simulation import simulate
from gtsam_nav.solution import Solution
from gtsam_nav.trajectory import UNIFORM_YAW_SIGMA, Trajectory

REST_S = 19.0
"""A vessel of the laps lies still before."""


def without_compass(seed: int, stop_s: float, *, velocities: bool = True) -> Mission:
    mission = simulate("laps", seed=seed, duration_s=130.0).without("heading").crop(0.0, stop_s)
    gnss = mission.sensors["gnss"]
    assert isinstance(gnss.series, GnssSeries)
    if velocities:
        return mission
    return mission.with_sensor(replace(gnss, series=replace(gnss.series, v_n=None)))


def smoothed(mission: Mission) -> tuple[Solution, Trajectory]:
    """A solution, and what its filter had said."""
    solution = gn.estimate(mission, "ins-ekf", load_config(None, ["ins_ekf.smooth=true"]))
    assert solution.online is not None
    return solution, solution.online


def errors(trajectory: Trajectory, mission: Mission) -> tuple[float, Array]:
    """Horizontal root mean square, m, and those of the yaw, rad."""
    assert mission.reference is not None
    truth = mission.reference.series
    assert isinstance(truth, ReferenceSeries)
    assert truth.rpy is not None
    inside = trajectory.covers(truth.t)
    found = trajectory.interpolate(truth.t[inside])
    off_m = np.linalg.norm((found.p_n - truth.p_n[inside])[:, :2], axis=1)
    yaw = wrap_angle(found.rpy[:, 2] - truth.rpy[inside, 2])
    return float(np.sqrt(np.mean(off_m**2))), yaw


@pytest.mark.parametrize(
    ("seed", "stop_s", "velocities"),
    [(5, REST_S, False), (12, REST_S, False), (12, 60.0, False), (12, 130.0, True)],
)
def test_it_is_better_than_its_filter_whether_or_not_the_yaw_is_found(
    seed: int, stop_s: float, velocities: bool
) -> None:
    mission = without_compass(seed, stop_s, velocities=velocities)
    solution, online = smoothed(mission)
    assert errors(solution.trajectory, mission)[0] < 0.8 * errors(online, mission)[0]


def test_the_filter_itself_stays_what_it_was() -> None:
    mission = without_compass(5, REST_S, velocities=False)
    _, online = smoothed(mission)
    np.testing.assert_array_equal(online.p_n, gn.estimate(mission, "ins-ekf").trajectory.p_n)


def test_a_yaw_that_nothing_shows_is_not_claimed() -> None:
    solution, _ = smoothed(without_compass(5, REST_S, velocities=False))
    sigma_rpy = solution.trajectory.sigma_rpy
    assert sigma_rpy is not None
    np.testing.assert_array_less(UNIFORM_YAW_SIGMA - 1e-9, sigma_rpy[:, 2])


def test_a_yaw_that_motion_shows_is_known_as_well_as_is_said() -> None:
    mission = without_compass(12, 130.0)
    solution, _ = smoothed(mission)
    sigma_rpy = solution.trajectory.sigma_rpy
    assert sigma_rpy is not None
    assert np.degrees(sigma_rpy[-1, 2]) < 10.0
    _, yaw = errors(solution.trajectory, mission)
    assert abs(yaw[-1]) < 3 * sigma_rpy[-1, 2]
    assert abs(yaw[0]) < 3 * sigma_rpy[0, 2]


def test_a_start_in_another_yaw_leaves_the_antenna_where_its_fix_was() -> None:
    mission = without_compass(5, 130.0)
    gnss = replace(mission.sensors["gnss"], xyz_b=np.array([3.0, 1.0, -2.0]))
    start = inertial_start(mission.with_sensor(gnss), mission.sensors["imu"], MotionSettings())
    bias_b = np.array([1e-3, 0.0, -2e-3])
    turned = start.with_yaw(FoundYaw(2.0, bias_b, 100.0))
    antenna_n, after_n = (s.state.p_n + s.state.body.R_nb @ gnss.xyz_b for s in (start, turned))
    np.testing.assert_allclose(after_n, antenna_n)
    assert isinstance(gnss.series, GnssSeries)
    np.testing.assert_allclose(antenna_n[:2], gnss.series.p_n[0, :2], atol=1e-9)
    np.testing.assert_array_equal(turned.state.gyro_bias_b, bias_b)
    down_b = turned.state.body.R_nb[2]
    assert down_b @ turned.P[:3, :3] @ down_b == pytest.approx(FOUND_YAW_SIGMA_RAD**2)
