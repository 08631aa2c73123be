"""Displacements between keyframes: they bend with the turn that the estimate makes of a gyro's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import gtsam_nav as gn
from gtsam_nav.frames import Array, rotation_from_rpy
from gtsam_nav.graph import factors
from gtsam_nav.graph.factors import X
from gtsam_nav.mission import InitialState, Mission, Sensor
from gtsam_nav.series import GnssSeries, OdometrySeries
from gtsam_nav.simulation import SimulationSettings

SIGMA_M = 0.03
STEP_S, DURATION_S, SPEED_M_S = 1e-3, 5.0, 1.0
SHORTLY_SURFACED = ("gnss.use=window", "gnss.window_s=[0,3]")


def driven(rate_b: Array) -> tuple[Array, Array]:
    """Rotation and way of a vehicle that goes ahead and turns at a constant rate."""
    from scipy.spatial.transform import Rotation

    t = np.arange(0.5 * STEP_S, DURATION_S, STEP_S)
    R = Rotation.from_rotvec(t[:, None] * rate_b).as_matrix()
    ahead = STEP_S * SPEED_M_S * np.sum(R[:, :, 0], axis=0)
    return Rotation.from_rotvec(DURATION_S * rate_b).as_matrix(), ahead


def residual(measured: tuple[Array, Array], true: tuple[Array, Array]) -> Array:
    """Translation's, m, where the estimate is right."""
    import gtsam

    factor = factors.increment(X(0), X(1), *measured, np.zeros(3), np.full(3, SIGMA_M), bends=True)
    values = gtsam.Values()
    R_na, p_n = rotation_from_rpy(np.array([0.1, -0.05, 2.0])), np.array([3.0, -1.0, 2.0])
    factors.insert(values, X(0), factors.nav_state(R_na, p_n, np.zeros(3)))
    R_ab, p_a = true
    factors.insert(values, X(1), factors.nav_state(R_na @ R_ab, p_n + R_na @ p_a, np.zeros(3)))
    return np.asarray(SIGMA_M * factor.whitenedError(values)[3:6])


def test_the_true_way_has_no_residual() -> None:
    true = driven(np.array([0.01, 0.02, 0.1]))
    assert np.allclose(residual(true, true), 0.0, atol=1e-12)


@pytest.mark.parametrize("bias", [[0.0, 0.0, 0.01], [0.0, 0.01, 0.0], [0.005, -0.01, 0.01]])
def test_a_gyro_bias_that_the_estimate_knows_leaves_no_contradiction(bias: list[float]) -> None:
    rate_b = np.array([0.0, 0.0, 0.05])
    measured, true = driven(rate_b + bias), driven(rate_b)
    assert np.linalg.norm(measured[1] - true[1]) > 0.1
    assert np.linalg.norm(residual(measured, true)) < 0.01


def test_a_displacement_in_error_shows() -> None:
    R_ab, p_a = driven(np.array([0.0, 0.0, 0.05]))
    error = residual((R_ab, p_a), (R_ab, p_a + np.array([0.1, -0.2, 0.3])))
    assert np.linalg.norm(error) == pytest.approx(np.linalg.norm([0.1, -0.2, 0.3]))


@pytest.mark.parametrize("velocities", ["odometry", "dvl"])
@pytest.mark.parametrize("headings", [0, 1])
def test_yaws_that_the_ways_alone_tell_do_not_swing_against_each_other(
    velocities: str, headings: int
) -> None:
    mission = gn.simulate("marina", 1, 150.0, SimulationSettings(sonar=None, landmarks=None))
    compass = mission.sensors["heading"]
    once = replace(compass, series=compass.series.select(slice(700, 700 + headings)))
    others = {*mission.sensors} - {velocities, "gnss", "reference", "heading"}
    few = mission.with_sensor(once).without(*others, *["heading"][headings:])
    solution = gn.estimate(few, "graph")
    ate = gn.evaluate(solution).ate.none
    assert ate is not None
    assert ate.mean < 0.4
    assert not any("settled" in said for said in solution.warnings)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 3])
def test_a_clean_mission_without_a_compass_contradicts_nothing(seed: int) -> None:
    mission = gn.simulate("marina", seed, 200.0)
    mission = mission.without("heading", "attitude", "odometry", "landmarks", "gnss")
    assert not gn.estimate(mission, "graph").warnings


@pytest.mark.slow
def test_fixes_too_close_to_show_a_yaw_do_not_swing_the_track() -> None:
    mission = gn.simulate("marina", 1, 150.0, SimulationSettings(sonar=None))
    mission = mission.without("heading", "attitude", "odometry", "landmarks")
    solution = gn.estimate(mission, "graph", gn.load_config(None, SHORTLY_SURFACED))
    assert not solution.georeferenced
    ate = gn.evaluate(solution).ate.se2
    assert ate is not None
    assert ate.mean < 3.0  # the gyro's bias is unknown: it turns by so much


def wheeled(missing_deg_m: float, stated_deg_m: float) -> Mission:
    """Straight ahead for 60 m by wheels that miss a turn."""
    t = np.arange(0.0, 60.0, 0.1)
    n = len(t)
    wheels = OdometrySeries(
        t=t,
        v_b=np.tile([1.0, 0.0], (n, 1)),
        yaw_rate=np.full(n, np.radians(1.0 - missing_deg_m)),
        sigma_v=np.full(n, 0.02),
        sigma_yaw_rate=np.full(n, 0.002),
    )
    noise = {"curvature_sigma_deg_m": stated_deg_m}
    start = InitialState(p_n=np.zeros(3), sigma_p=0.1, heading=0.0, sigma_heading=0.01)
    sensor = Sensor("odometry", "odometry", wheels, noise=noise)
    return Mission("bent", {"odometry": sensor}, initial=start)


@pytest.mark.parametrize("missing_deg_m", [-0.2, 0.2])
def test_a_turn_that_wheels_miss_is_in_the_covariance(missing_deg_m: float) -> None:
    """The vehicle turns by a degree a metre; the wheels say a fifth less, or more."""
    track = gn.estimate(wheeled(missing_deg_m, 0.3), "graph").trajectory
    turned = np.radians(track.t[-1])
    truth = np.array([np.sin(turned), 1.0 - np.cos(turned)]) / np.radians(1.0)
    error = track.p_n[-1, :2] - truth
    assert track.cov_pose_n is not None
    assert np.linalg.norm(error) > 2.0
    assert error @ np.linalg.solve(track.cov_pose_n[-1, :2, :2], error) < 6.0
    assert np.sqrt(track.cov_pose_n[-1, 5, 5]) == pytest.approx(np.radians(0.3 * 60.0), rel=0.1)


def test_a_fix_shows_the_turn_that_wheels_miss() -> None:
    mission = wheeled(0.2, 0.3)
    t = np.array([20.0, 40.0, 59.0])
    turned = np.radians(t)
    p_n = np.column_stack([np.sin(turned), 1.0 - np.cos(turned), 0.0 * t]) / np.radians(1.0)
    fixes = GnssSeries(t=t, p_n=p_n, sigma=np.full((3, 3), 0.05))
    mission = mission.with_sensor(Sensor("gnss", "gnss", fixes))
    found = gn.estimate(mission, "graph", gn.load_config(None, ["gnss.use=all"])).slow_states
    assert found is not None
    value, sigma = found.columns["odometry_curvature_rad_m"]
    assert np.degrees(value[0]) == pytest.approx(0.2, abs=0.03)
    assert np.degrees(sigma[0]) < 0.1
