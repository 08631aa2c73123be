"""Displacements between keyframes: they bend with the turn that the estimate makes of a gyro's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import gtsam_nav as gn
from gtsam_nav.frames import Array, rotation_from_rpy
from gtsam_nav.graph import factors
from gtsam_nav.graph.factors import X
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
