"""Preintegrated readings between keyframes: mounting, Earth rate, silences."""

from __future__ import annotations

import gtsam
import numpy as np
import pytest

import gtsam_nav as gn
from gtsam_nav.config import Config, load_config
from gtsam_nav.frames import Array, rotation_from_rpy
from gtsam_nav.graph import factors
from gtsam_nav.graph.coasting import CoastingStep
from gtsam_nav.graph.factors import B, X
from gtsam_nav.graph.indeterminacy import check_anchored
from gtsam_nav.graph.measurements import build_problem
from gtsam_nav.graph.measurements.imu import silences
from gtsam_nav.graph.preintegration import SECOND_ORDER_SIGMAS, InertialStep
from gtsam_nav.graph.problem import Problem
from gtsam_nav.mission import Constraints, InitialState, Mission, Sensor
from gtsam_nav.preprocess.alignment import align
from gtsam_nav.preprocess.inertial_motion import inertial_motion
from gtsam_nav.preprocess.strapdown import gravity_at
from gtsam_nav.sensors.noise import ImuNoise
from gtsam_nav.series import DvlSeries, HeadingSeries, ImuSeries
from gtsam_nav.simulation.inertia import ideal_imu
from gtsam_nav.simulation.marina import ORIGIN, marina
from gtsam_nav.simulation.motion import Motion, MotionSettings

LEVER_B = np.array([0.8, -0.3, 0.5])
R_BI = rotation_from_rpy([0.1, -0.2, 1.3])


CONFIG = load_config(None, ["graph.imu_min_rate_hz=5"])


def problem_of(
    imu: Sensor,
    keyframes: Array,
    mission_origin: bool = True,
    config: Config = CONFIG,
    constraints: Constraints = Constraints(),  # noqa: B008
) -> Problem:
    mission = Mission(
        name="inertial",
        sensors={"imu": imu},
        origin=ORIGIN if mission_origin else None,
        initial=InitialState(np.zeros(3), 1.0, 0.0, 0.1),
        constraints=constraints,
    )
    start = align(mission)
    return build_problem(
        mission, start, inertial_motion(mission, start, config.motion), keyframes, config
    )


@pytest.mark.parametrize("begin", [5.0, 30.03, 61.7])
def test_preintegration_predicts_the_next_keyframe(begin: float) -> None:
    """A noise-free IMU at 100 Hz, mounted askew and off the origin; the Earth turns."""
    rate_hz, span_s = 100.0, 2.0
    motion = Motion(marina(), MotionSettings(), np.random.default_rng(4))
    t = begin - 0.1 + np.arange(int((span_s + 0.3) * rate_hz)) / rate_hz
    gyro_b, accel_b = ideal_imu(motion.at(t), ORIGIN, flat=True)
    turning = np.gradient(gyro_b, t, axis=0)
    accel_b += np.cross(turning, LEVER_B) + np.cross(gyro_b, np.cross(gyro_b, LEVER_B))
    imu = Sensor(
        name="imu",
        type="imu",
        series=ImuSeries(t=t, gyro_i=gyro_b @ R_BI, accel_i=accel_b @ R_BI),
        xyz_b=LEVER_B,
        R_bs=R_BI,
    )
    step = problem_of(imu, np.array([begin, begin + span_s])).steps[1]
    assert isinstance(step, InertialStep)
    ends = motion.at(np.array([begin, begin + span_s]))
    before, after = (
        factors.nav_state(R, p, v) for R, p, v in zip(ends.R_nb, ends.p_n, ends.v_n, strict=True)
    )
    bias = gtsam.imuBias.ConstantBias()
    step.parameters.n_gravity = gravity_at(np.zeros(3), ORIGIN)
    assert step.pim.deltaTij() == pytest.approx(span_s, abs=1e-9)
    predicted = step.pim.predict(before, bias)
    np.testing.assert_allclose(predicted.position(), after.position(), atol=1e-2)
    np.testing.assert_allclose(predicted.velocity(), after.velocity(), atol=1e-2)
    turn = after.attitude().between(predicted.attitude())
    assert np.linalg.norm(gtsam.Rot3.Logmap(turn)) < 1e-4


def test_readings_are_linear_between_samples_and_held_beyond_them() -> None:
    t = np.array([0.0, 0.1, 0.25, 0.3])
    rates = np.array([0.0, 0.1, 0.4, 0.2])
    series = ImuSeries(
        t=t, gyro_i=np.outer(rates, [0.0, 0.0, 1.0]), accel_i=np.tile([0, 0, -9.8], (4, 1))
    )
    imu = Sensor(name="imu", type="imu", series=series)
    problem = problem_of(imu, np.array([0.05, 0.45]), mission_origin=False)
    step = problem.steps[1]
    assert isinstance(step, InertialStep)
    _, gyro, dt = step.readings()
    assert np.sum(dt) == pytest.approx(0.4)
    assert step.span_s == pytest.approx(0.4)
    turned = 0.05 * 0.075 + 0.15 * 0.25 + 0.05 * 0.3 + 0.15 * 0.2
    assert gyro[:, 2] @ dt == pytest.approx(turned)


def test_silences() -> None:
    t = np.array([0.5, 0.6, 0.7, 3.0, 3.1])
    imu = ImuSeries(t=t, gyro_i=np.zeros((5, 3)), accel_i=np.zeros((5, 3)))
    np.testing.assert_allclose(silences(imu, 0.0, 4.0), [[0.0, 0.5], [0.7, 3.0], [3.1, 4.0]])
    assert len(silences(imu, 0.5, 0.7)) == 0


def test_a_silence_is_bridged_at_constant_velocity_and_said() -> None:
    t = np.arange(0.0, 20.0, 0.01)
    rng = np.random.default_rng(0)
    t = t[(t < 8.0) | (t > 12.0)]
    accel = np.array([0.0, 0.0, -9.80665]) + 0.3 * rng.normal(size=(len(t), 3))
    series = ImuSeries(t=t, gyro_i=0.01 * rng.normal(size=(len(t), 3)), accel_i=accel)
    imu = Sensor(name="imu", type="imu", series=series)
    problem = problem_of(imu, np.array([0.0, 5.0, 8.0, 12.0, 19.99]), mission_origin=False)
    assert [w for w in problem.warnings if "silent from 8.0 s to 12.0 s" in w]
    working, coasting = problem.steps[1], problem.steps[3]
    assert isinstance(working, InertialStep)
    assert isinstance(coasting, CoastingStep)
    R_nb = problem.R_nb[2]
    moving = factors.nav_state(R_nb, np.zeros(3), np.array([2.0, 1.0, 0.0]))
    after = coasting.predicted(moving, problem.bias)
    np.testing.assert_allclose(after.velocity(), moving.velocity(), atol=1e-9)
    np.testing.assert_allclose(after.position(), 4.0 * moving.velocity(), atol=1e-9)
    grown = coasting.factor.noiseModel().covariance() - working.pim.preintMeasCov()
    assert np.all(np.diag(grown) > 0)
    graph = gtsam.NonlinearFactorGraph()
    for entry in problem.brought(3):
        graph.add(entry.factor)
    values = gtsam.Values()
    values.insert(X(2), moving)
    values.insert(X(3), after)
    for k in (2, 3):
        values.insert(B(k), problem.bias)
    assert graph.error(values) == pytest.approx(0.0, abs=1e-12)


def test_a_silent_imu_measures_no_bias() -> None:
    """Whatever is believed of the biases later, it coasts as before, and tells nothing of them."""
    t = np.arange(0.0, 20.0, 0.01)
    t = t[(t < 8.0) | (t > 12.0)]
    force = np.tile([0.0, 0.0, -9.80665], (len(t), 1))
    rates = np.tile([0.0, 0.0, 0.05], (len(t), 1))
    imu = Sensor(name="imu", type="imu", series=ImuSeries(t=t, gyro_i=rates, accel_i=force))
    problem = problem_of(imu, np.array([0.0, 8.0, 12.0, 19.99]), mission_origin=False)
    believed = gtsam.imuBias.ConstantBias(np.array([0.3, 0.0, 0.1]), np.array([0.0, 0.0, 0.05]))
    problem.integrate_at(2, believed)
    coasting = problem.steps[2]
    assert isinstance(coasting, CoastingStep)
    assert coasting.factor.keys() == [X(1), X(2)]
    tilted = factors.nav_state(R_BI, np.zeros(3), np.array([2.0, 1.0, 0.0]))
    after = coasting.predicted(tilted, believed)
    np.testing.assert_allclose(after.attitude().matrix(), R_BI, atol=1e-12)
    np.testing.assert_allclose(after.velocity(), tilted.velocity(), atol=1e-12)
    values = gtsam.Values()
    values.insert(X(1), tilted)
    values.insert(X(2), after)
    assert coasting.factor.error(values) == pytest.approx(0.0, abs=1e-12)


def test_a_silence_is_bridged_by_the_turn_that_the_compass_saw() -> None:
    """At 1 m/s, along a quarter of a circle; no AHRS tells the tilt meanwhile."""
    t, rate = np.arange(0.0, 20.0, 0.1), np.pi / 2 / 10.0
    yaw, one = rate * np.clip(t - 5.0, 0.0, 10.0), np.ones(len(t))
    heard = (t < 4.0) | (t > 16.0)
    still = np.zeros((int(heard.sum()), 3))
    v_d = np.outer(one, [1.0, 0.0, 0.0])
    series = (
        ImuSeries(t=t[heard], gyro_i=still, accel_i=still - [0.0, 0.0, 9.80665]),
        HeadingSeries(t=t, heading=yaw, sigma=0.01 * one),
        DvlSeries(t=t, v_d=v_d, sigma=0.01 * one, valid=one > 0, bottom_lock=one > 0),
    )
    sensors = zip(("imu", "heading", "dvl"), series, strict=True)
    stated = InitialState(np.zeros(3), 0.1, 0.0, 0.01)
    mission = Mission("turn", {name: Sensor(name, name, s) for name, s in sensors}, initial=stated)
    solution = gn.estimate(mission, "graph", CONFIG)
    assert "silent from 3.9 s to 16.1 s: the other sensors carry on" in " ".join(solution.warnings)
    trajectory = solution.trajectory
    end = 5.0 + 1 / rate, 1 / rate + 4.9, 0.0
    np.testing.assert_allclose(trajectory.p_n[-1], end, atol=0.1)
    np.testing.assert_allclose(trajectory.rpy[-1], [0.0, 0.0, np.pi / 2], atol=np.radians(1.0))


@pytest.mark.parametrize(("silent_s", "held"), [(0.3, True), (6.0, False)], ids=["short", "long"])
def test_a_tilt_outlasts_a_short_silence_of_the_imu(silent_s: float, held: bool) -> None:
    """Without an AHRS; of a long one it is only known that the vehicle is a stable one."""
    t = np.arange(0.0, 20.0, 0.02)
    heard = (t < 10.0) | (t > 10.0 + silent_s)
    n, one = int(heard.sum()), np.ones(len(t))
    rates = 0.05 * np.sin(np.outer(t[heard], [2.0, 3.0, 1.0]))
    force_b = np.tile([0.0, 0.0, -9.80665], (n, 1))
    v_d, good = np.zeros((len(t), 3)), one > 0
    series = (
        ImuSeries(t=t[heard], gyro_i=rates, accel_i=force_b),
        HeadingSeries(t=t, heading=0.0 * one, sigma=0.01 * one),
        DvlSeries(t=t, v_d=v_d, sigma=0.01 * one, valid=good, bottom_lock=good),
    )
    sensors = zip(("imu", "heading", "dvl"), series, strict=True)
    stated = InitialState(np.zeros(3), 0.1, 0.0, 0.01)
    mission = Mission("rock", {name: Sensor(name, name, s) for name, s in sensors}, initial=stated)
    trajectory = gn.estimate(mission, "graph", CONFIG).trajectory
    sigma_rpy = trajectory.sigma_rpy
    assert sigma_rpy is not None
    worst = np.degrees(np.max(sigma_rpy[:, :2]))
    assert worst < 3.0 if held else 4.0 < worst < 10.0


def test_springs_let_the_bow_rise_as_a_vehicle_on_wheels_speeds_up() -> None:
    """A body pitched up by a moves along its own z axis with the sine of a of its speed."""
    t = np.arange(0.0, 10.0, 0.02)
    accel_b = np.column_stack(
        [np.where(t > 4.0, 1.5, 0.0), np.zeros(len(t)), np.full(len(t), -9.8)]
    )
    imu = Sensor("imu", "imu", ImuSeries(t=t, gyro_i=np.zeros((len(t), 3)), accel_i=accel_b))
    wheels = Constraints(nonholonomic=True)
    problem = problem_of(imu, np.arange(0.0, 10.0, 0.5), constraints=wheels)
    (springs,) = problem.constants
    assert springs.name == "pitch_by_acceleration_rad_s2_m"
    assert springs.sigma == pytest.approx(np.radians(0.5))
    assert len(springs.effect) == len(problem.t)
    k, softness, h = 16, 0.01, 1e-6
    entry, derivative = springs.effect[k]
    speed = float(problem.v_b[k, 0])
    assert speed > 5.0
    values = gtsam.Values()

    def residual(pitch_by_acceleration: float) -> Array:
        """Of a body that the springs pitch, while it moves level."""
        pitched = gtsam.Rot3.Pitch((softness - pitch_by_acceleration) * 1.5)
        values.insert_or_assign(X(k), gtsam.NavState(pitched, np.zeros(3), [speed, 0.0, 0.0]))
        return np.asarray(entry.gaussian.unwhitenedError(values))

    assert residual(softness)[8] == pytest.approx(0.0, abs=1e-9)
    slope = (residual(softness + h) - residual(softness - h)) / (2 * h)
    np.testing.assert_allclose(derivative[8], slope[8], rtol=0.02)


def test_a_turn_between_two_rests_is_not_forbidden() -> None:
    """Still at 10 s and at 15 s, on another heading: no rest lasts from the one to the other."""
    t = np.arange(0.0, 20.0, 0.02)
    turning = (t > 11.3) & (t < 12.7)
    gyro_b = np.column_stack([np.zeros((len(t), 2)), np.where(turning, 0.7, 0.0)])
    force = np.tile([0.0, 0.0, -9.80665], (len(t), 1))
    imu = Sensor("imu", "imu", ImuSeries(t=t, gyro_i=gyro_b, accel_i=force))
    resting = Constraints(zero_velocity=True)
    problem = problem_of(imu, np.array([0.0, 5.0, 10.0, 15.0]), constraints=resting)
    stated = [
        [e.gaussian.keys() for e in own if e.sensor == "constraints"] for own in problem.factors
    ]
    assert stated == [[[X(0)]], [[X(1)], [X(0), X(1)]], [[X(2)], [X(1), X(2)]], [[X(3)]]]


def biased_rest(bias: Array, span_s: float) -> tuple[Problem, object]:
    """A still vehicle whose gyro is biased; that bias, which the problem does not know at first."""
    t = np.arange(0.0, span_s + 0.01, 0.01)
    force = np.tile([0.0, 0.0, -9.80665], (len(t), 1))
    series = ImuSeries(t=t, gyro_i=np.tile(bias, (len(t), 1)), accel_i=force)
    noise = {"gyro_bias_sigma_rad_s": 0.02, "gyro_noise_density_rad_s_sqrt_hz": 1.0}
    imu = Sensor(name="imu", type="imu", series=series, noise=noise)
    problem = problem_of(imu, np.array([0.0, span_s]), mission_origin=False)
    return problem, gtsam.imuBias.ConstantBias(np.zeros(3), bias)


def test_readings_are_integrated_anew_where_the_bias_is_another() -> None:
    """0.1 rad of bias over 5 s: its square, by gravity, would be 0.1 m along the vertical."""
    problem, believed = biased_rest(np.array([0.02, 0.0, 0.0]), 5.0)
    still = factors.nav_state(np.eye(3), np.zeros(3), np.zeros(3))
    step = problem.steps[1]
    assert isinstance(step, InertialStep)
    assert abs(step.pim.predict(still, believed).position()[2]) > 0.05
    problem.integrate_at(1, believed)
    step = problem.steps[1]
    assert isinstance(step, InertialStep)
    np.testing.assert_allclose(step.pim.predict(still, believed).position(), 0.0, atol=1e-3)
    (imu,) = (e for e in problem.brought(1) if isinstance(e.gaussian, gtsam.ImuFactor2))
    values = gtsam.Values()
    for k in (0, 1):
        values.insert(X(k), still)
    values.insert(B(0), believed)
    np.testing.assert_allclose(imu.gaussian.unwhitenedError(values), 0.0, atol=1e-3)


@pytest.mark.parametrize("moved", [1e-4, 1e-3, 1e-2])
def test_what_the_linear_factor_leaves_out_stays_within_the_noise(moved: float) -> None:
    """Kept where its second order is a small share of the readings' noise, else done anew."""
    problem, believed = biased_rest(np.array([moved, 0.0, 0.0]), 5.0)
    step = problem.steps[1]
    assert isinstance(step, InertialStep)
    noise_m_s = ImuNoise().accel_noise_density_m_s2_sqrt_hz * np.sqrt(5.0)
    still = factors.nav_state(np.eye(3), np.zeros(3), np.zeros(3))
    left_out_m_s = abs(step.pim.predict(still, believed).velocity()[2])
    assert step._second_order_sigmas(believed) == pytest.approx(left_out_m_s / noise_m_s, rel=0.3)
    problem.integrate_at(1, believed)
    later = problem.steps[1]
    assert isinstance(later, InertialStep)
    assert (later is step) == (left_out_m_s / noise_m_s < SECOND_ORDER_SIGMAS)
    predicted = later.pim.predict(still, believed)
    assert abs(predicted.velocity()[2]) < 1.5 * SECOND_ORDER_SIGMAS * noise_m_s


def test_readings_are_not_integrated_before_a_bias_is_believed() -> None:
    problem, believed = biased_rest(np.array([1e-4, 0.0, 0.0]), 5.0)
    check_anchored(problem)
    problem.integrate_at(1, believed)
    step = problem.steps[1]
    assert isinstance(step, InertialStep)
    np.testing.assert_array_equal(step.pim.biasHat().vector(), believed.vector())


def test_coasting_is_no_surer_than_the_readings_it_stands_for() -> None:
    """Even of a vehicle that never moved, whose readings are all the same to the last digit."""
    t = np.arange(0.0, 20.0, 0.01)
    t = t[(t < 8.0) | (t > 12.0)]
    force = np.tile([0.0, 0.0, -9.8125], (len(t), 1))
    series = ImuSeries(t=t, gyro_i=np.zeros((len(t), 3)), accel_i=force)
    imu = Sensor(name="imu", type="imu", series=series)
    step = problem_of(imu, np.arange(0.0, 20.0, 4.0), mission_origin=False).steps[3]
    assert isinstance(step, CoastingStep)
    noise = ImuNoise()
    for covariance, density in (
        (step.parameters.getAccelerometerCovariance(), noise.accel_noise_density_m_s2_sqrt_hz),
        (step.parameters.getGyroscopeCovariance(), noise.gyro_noise_density_rad_s_sqrt_hz),
    ):
        np.testing.assert_allclose(covariance, density**2 * np.eye(3))
