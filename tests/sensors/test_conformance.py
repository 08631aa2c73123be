"""Every sensor model against itself and against the graph: one row of `SENSORS` a sensor.

A row draws a measurement near a state (``spread``: how near) and gives it to the model in
``sensors`` and to the native factor that the graph uses for it. Residual, whitened cost and
Jacobian must agree on any state.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import gtsam
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gtsam_nav.frames import Array, rotation_from_rpy
from gtsam_nav.graph import factors
from gtsam_nav.graph.factors import G, L, M, X
from gtsam_nav.graph.measurements.sightings import Seen, SightingFactors
from gtsam_nav.mission import Sensor
from gtsam_nav.sensors import depth, dvl, gnss, landmarks, motion_constraints, orientation
from gtsam_nav.sensors.prediction import BodyState, Prediction
from gtsam_nav.series import LandmarkSeries

NO_SIGHTINGS = LandmarkSeries(
    t=np.empty(0),
    id=np.empty(0),
    range_m=np.empty(0),
    bearing=np.empty(0),
    sigma_range=np.empty(0),
    sigma_bearing=np.empty(0),
)


@dataclass(frozen=True)
class Case:
    """One measurement in both worlds; ``rows`` are those of the native residual that are observed,
    ``others`` the native states beside the keyframe."""

    predict: Callable[[BodyState], Prediction]
    factor: Any
    rows: slice
    others: Mapping[int, Any] = field(default_factory=dict)


def dvl_velocity(state: BodyState, rng: np.random.Generator, spread: float) -> Case:
    sigma = rng.uniform(0.01, 0.2)
    v_b = state.R_nb.T @ state.v_n + spread * rng.normal(size=3)
    factor = factors.velocity(X(0), v_b, sigma)
    return Case(lambda s: dvl.predict(s, v_b, sigma), factor, slice(6, 9))


def gnss_position(state: BodyState, rng: np.random.Generator, spread: float) -> Case:
    sigma, lever_b = rng.uniform(0.2, 3.0, size=3), rng.normal(size=3)
    p_antenna_n = state.p_n + 5 * spread * rng.normal(size=3)
    factor = factors.gnss(X(0), p_antenna_n, lever_b, sigma)
    return Case(lambda s: gnss.predict(s, p_antenna_n, lever_b, sigma), factor, slice(0, 3))


def gnss_with_shared_error(state: BodyState, rng: np.random.Generator, spread: float) -> Case:
    """Its axes are the body's as they lie at present: a sigma for all of them."""
    sigma, error_n, arm_b = (
        np.full(3, rng.uniform(0.2, 3.0)),
        rng.normal(size=3),
        rng.normal(size=3),
    )
    p_n = state.p_n + state.R_nb @ arm_b + 5 * spread * rng.normal(size=3)
    factor = factors.gnss_with_error(G(0), X(0), p_n, arm_b, state.R_nb, sigma)
    error = factors.nav_state(np.eye(3), error_n, np.zeros(3))
    return Case(
        lambda s: gnss.predict(s, p_n + error_n, arm_b, sigma),
        factor,
        slice(3, 6),
        {G(0): error},
    )


def depth_reading(state: BodyState, rng: np.random.Generator, spread: float) -> Case:
    sigma, lever_b = rng.uniform(0.01, 0.5), rng.normal(size=3)
    depth_m = state.p_n[2] + spread * rng.normal()
    factor = factors.depth(X(0), depth_m, lever_b, sigma)
    return Case(lambda s: depth.predict(s, depth_m, lever_b, sigma), factor, slice(2, 3))


def ahrs_orientation(state: BodyState, rng: np.random.Generator, spread: float) -> Case:
    sigma_rpy, bias = rng.uniform(0.005, 0.1, size=3), rng.normal(scale=0.2)
    R_bias = rotation_from_rpy([0.0, 0.0, bias])
    error = Rotation.from_rotvec(0.3 * spread * rng.normal(size=3)).as_matrix()
    R_measured = R_bias.T @ state.R_nb @ error
    compass = factors.nav_state(R_bias, np.zeros(3), np.zeros(3))
    factor = factors.orientation(M(0), X(0), R_measured, sigma_rpy)
    return Case(
        lambda s: orientation.predict(s, R_measured, bias, sigma_rpy),
        factor,
        slice(0, 3),
        {M(0): compass},
    )


def gnss_velocity(state: BodyState, rng: np.random.Generator, spread: float) -> Case:
    sigma, rate_b, lever_b = rng.uniform(0.02, 0.5), rng.normal(size=3), rng.normal(size=3)
    swing_b = np.cross(rate_b, lever_b)
    v_n = state.v_n + state.R_nb @ swing_b + spread * rng.normal(size=3)
    present = factors.nav_state(state.R_nb, state.p_n, state.v_n)
    factor = factors.gnss_velocity(X(0), present, v_n, swing_b, np.full(3, sigma))
    return Case(
        lambda s: gnss.predict_velocity(s, v_n, rate_b, lever_b, sigma), factor, slice(0, 3)
    )


def heading_alone(state: BodyState, rng: np.random.Generator, spread: float) -> Case:
    sigma, bias = rng.uniform(0.005, 0.1), rng.normal(scale=0.2)
    reading = np.arctan2(state.R_nb[1, 0], state.R_nb[0, 0]) - bias + 0.3 * spread * rng.normal()
    compass = factors.nav_state(rotation_from_rpy([0.0, 0.0, bias]), np.zeros(3), np.zeros(3))
    factor = factors.heading(M(0), X(0), reading, state.R_nb, sigma)
    return Case(
        lambda s: orientation.predict_heading(s, reading, bias, sigma),
        factor,
        slice(0, 1),
        {M(0): compass},
    )


def sighting(state: BodyState, rng: np.random.Generator, spread: float, *, elevation: bool) -> Case:
    sensor = Sensor(
        name="landmarks",
        type="landmarks",
        series=NO_SIGHTINGS,
        xyz_b=rng.normal(size=3),
        R_bs=Rotation.from_rotvec(rng.normal(size=3)).as_matrix(),
    )
    landmark_n = state.p_n + 10 * rng.normal(size=3)
    truth = landmarks.observe(state, landmark_n[None], sensor, elevation=True).values[0]
    truth += spread * np.array([0.3, 0.1, 0.1]) * rng.normal(size=3)
    seen = landmarks.Sighting(
        range_m=abs(truth[0]),
        bearing=truth[1],
        elevation=truth[2] if elevation else None,
        sigma_range=rng.uniform(0.1, 1.0),
        sigma_bearing=rng.uniform(0.01, 0.1),
    )
    body = factors.nav_state(state.R_nb, state.p_n, state.v_n)
    landmark = factors.nav_state(np.eye(3), landmark_n, np.zeros(3))
    states = {int(X(0)): body, int(L(0)): landmark}
    made = SightingFactors([Seen(0, int(L(0)), seen, sensor, level=False)])
    (factor,) = made([0], states.__getitem__)
    return Case(
        lambda s: landmarks.predict(s, landmark_n, seen, sensor),
        factor,
        slice(0, len(seen.measured)),
        {L(0): landmark},
    )


def planar_sighting(state: BodyState, rng: np.random.Generator, spread: float) -> Case:
    return sighting(state, rng, spread, elevation=False)


def spatial_sighting(state: BodyState, rng: np.random.Generator, spread: float) -> Case:
    return sighting(state, rng, spread, elevation=True)


def standing_still(_state: BodyState, rng: np.random.Generator, _spread: float) -> Case:
    sigma = rng.uniform(0.01, 0.2)
    factor = factors.velocity(X(0), np.zeros(3), sigma)
    return Case(lambda s: motion_constraints.zero_velocity(s, sigma), factor, slice(6, 9))


def on_wheels(_state: BodyState, rng: np.random.Generator, _spread: float) -> Case:
    sigma = rng.uniform(0.01, 0.2)
    factor = factors.nonholonomic(X(0), sigma)
    return Case(lambda s: motion_constraints.nonholonomic(s, sigma), factor, slice(7, 9))


SENSORS = {
    make.__name__: make
    for make in (
        dvl_velocity,
        gnss_position,
        gnss_with_shared_error,
        depth_reading,
        ahrs_orientation,
        gnss_velocity,
        heading_alone,
        planar_sighting,
        spatial_sighting,
        standing_still,
        on_wheels,
    )
}
SIGHTINGS = ("planar_sighting", "spatial_sighting")
STEEPEST = 0.95
"""Where the bow points further up or down than this sine, a heading says next to nothing."""

every_sensor = pytest.mark.parametrize("sensor", SENSORS)
seeds = given(st.integers(0, 2**32 - 1))


def drawn(sensor: str, seed: int, spread: float = 1.0) -> tuple[BodyState, Case]:
    """Some state, and a measurement of it."""
    rng = np.random.default_rng(seed)
    R_nb = Rotation.random(random_state=int(seed)).as_matrix()
    assume(sensor != "heading_alone" or abs(R_nb[2, 0]) < STEEPEST)
    state = BodyState(R_nb, 100 * rng.normal(size=3), 2 * rng.normal(size=3))
    return state, SENSORS[sensor](state, rng, spread)


def moved(state: BodyState, error: Array) -> BodyState:
    """The state with an error as `BodyState` defines it."""
    return BodyState(
        state.R_nb @ Rotation.from_rotvec(error[:3]).as_matrix(),
        state.p_n + state.R_nb @ error[3:6],
        state.v_n + state.R_nb @ error[6:],
    )


def native_values(state: BodyState, case: Case) -> Any:
    values = gtsam.Values()
    values.insert(X(0), factors.nav_state(state.R_nb, state.p_n, state.v_n))
    for key, other in case.others.items():
        values.insert(key, other)
    return values


@every_sensor
@seeds
def test_jacobians_are_those_of_the_residual(sensor: str, seed: int) -> None:
    state, case = drawn(sensor, seed)
    steps = 1e-5 * np.eye(9)
    numeric = [
        (case.predict(moved(state, e)).residual - case.predict(moved(state, -e)).residual) / 2e-5
        for e in steps
    ]
    np.testing.assert_allclose(case.predict(state).jacobian, np.array(numeric).T, atol=1e-6)


@seeds
def test_the_jacobian_of_a_large_turn_is_exact(seed: int) -> None:
    rng = np.random.default_rng(seed)
    state, _ = drawn("ahrs_orientation", seed)
    far = rng.normal(size=3)
    far *= rng.uniform(0.0, 3.0) / np.linalg.norm(far)
    R_measured = state.R_nb @ Rotation.from_rotvec(far).as_matrix()

    def residual(error: Array) -> Array:
        return orientation.predict(moved(state, error), R_measured, 0.0, np.ones(3)).residual

    numeric = [(residual(e) - residual(-e)) / 2e-5 for e in 1e-5 * np.eye(9)]
    jacobian = orientation.predict(state, R_measured, 0.0, np.ones(3)).jacobian
    np.testing.assert_allclose(jacobian, np.array(numeric).T, atol=1e-6)


@every_sensor
@seeds
def test_the_graph_has_the_same_residual(sensor: str, seed: int) -> None:
    state, case = drawn(sensor, seed)
    native = case.factor.whitenedError(native_values(state, case))
    prediction = case.predict(state)
    wanted = whitening_of(prediction) @ prediction.residual
    np.testing.assert_allclose(native[case.rows], wanted, rtol=1e-9, atol=1e-7)


def whitening_of(prediction: Prediction) -> Array:
    return np.asarray(np.linalg.cholesky(np.linalg.inv(prediction.cov)).T)


@every_sensor
@seeds
def test_the_graph_has_the_same_cost(sensor: str, seed: int) -> None:
    state, case = drawn(sensor, seed)
    graph = gtsam.NonlinearFactorGraph()
    graph.add(case.factor)
    cost = 2 * graph.error(native_values(state, case))
    assert cost == pytest.approx(case.predict(state).whitened_cost, rel=1e-9)


@every_sensor
@seeds
def test_the_graph_has_the_same_jacobian(sensor: str, seed: int) -> None:
    # the native orientation is linearised as if its residual were small
    state, case = drawn(sensor, seed, spread=1e-9)
    linear = case.factor.linearize(native_values(state, case))
    keys = list(linear.keys())
    A, b = linear.jacobian()
    own = A[:, 9 * keys.index(X(0)) : 9 * keys.index(X(0)) + 9]
    prediction = case.predict(state)
    whitening = whitening_of(prediction)
    np.testing.assert_allclose(own[case.rows], whitening @ prediction.jacobian, atol=1e-5)
    np.testing.assert_allclose(-b[case.rows], whitening @ prediction.residual, atol=1e-7)
    unobserved = np.ones(len(b), dtype=bool)
    unobserved[case.rows] = False
    np.testing.assert_array_equal(A[unobserved], 0.0)
    np.testing.assert_array_equal(b[unobserved], 0.0)


@pytest.mark.parametrize("pitch_deg", [0.0, 25.0, -70.0])
@pytest.mark.parametrize("roll_deg", [0.0, 40.0])
def test_a_heading_is_as_sure_about_the_vertical_however_the_body_is_tilted(
    pitch_deg: float, roll_deg: float
) -> None:
    """Level axes have the tilt's sigma, the vertical one the yaw's: of a start, of an AHRS."""
    R_nb = rotation_from_rpy(np.radians([roll_deg, pitch_deg, 130.0]))
    sigma_rpy = np.radians([0.5, 0.5, 20.0])
    state = factors.nav_state(R_nb, np.zeros(3), np.zeros(3))
    values = gtsam.Values()
    values.insert(X(0), state)
    for factor in (
        factors.orientation(None, X(0), R_nb, sigma_rpy),
        factors.start_prior(X(0), state, R_nb, sigma_rpy, np.ones(3), 1.0),
    ):
        A, _ = factor.linearize(values).jacobian()
        information_n = R_nb @ (A.T @ A)[:3, :3] @ R_nb.T
        np.testing.assert_allclose(information_n, np.diag(sigma_rpy**-2.0), rtol=1e-6, atol=1e-3)
    own = orientation.predict(BodyState(R_nb, np.zeros(3), np.zeros(3)), R_nb, 0.0, sigma_rpy)
    np.testing.assert_allclose(R_nb @ own.cov @ R_nb.T, np.diag(sigma_rpy**2), atol=1e-12)


@pytest.mark.parametrize("sensor", ["gnss_position", "gnss_with_shared_error", "gnss_velocity"])
@seeds
def test_what_receivers_measure_seems_to_tell_no_yaw_by_its_noise(sensor: str, seed: int) -> None:
    """The attitude enters by the arm alone, whatever the residual."""
    (state, quiet), (_, noisy) = drawn(sensor, seed, spread=1e-9), drawn(sensor, seed, spread=3.0)
    slopes = []
    for case in (quiet, noisy):
        linear = case.factor.linearize(native_values(state, case))
        first = 9 * list(linear.keys()).index(X(0))
        slopes.append(linear.jacobian()[0][:, first : first + 3])
    np.testing.assert_allclose(slopes[0], slopes[1], atol=1e-6)


@pytest.mark.parametrize("sensor", SIGHTINGS)
@seeds
def test_the_graph_moves_the_landmark_as_the_sensor_model_does(sensor: str, seed: int) -> None:
    state, case = drawn(sensor, seed)
    linear = case.factor.linearize(native_values(state, case))
    keys = list(linear.keys())
    A, _ = linear.jacobian()
    first = 9 * keys.index(L(0))
    prediction = case.predict(state)
    assert isinstance(prediction, landmarks.LandmarkPrediction)
    wanted = whitening_of(prediction) @ prediction.jacobian_landmark
    np.testing.assert_allclose(A[case.rows, first + 3 : first + 6], wanted, atol=1e-6)


@pytest.mark.parametrize("sensor", SIGHTINGS)
@seeds
def test_away_from_its_estimate_a_sighting_is_wrong_to_second_order(sensor: str, seed: int) -> None:
    """A tenth of the step, a hundredth of the error: made anew, the factor is the sensor's own."""
    state, case = drawn(sensor, seed)
    direction = np.random.default_rng(seed + 1).normal(size=9) * 0.03

    def error(scale: float) -> float:
        there = moved(state, scale * direction)
        native = case.factor.whitenedError(native_values(there, case))[case.rows]
        prediction = case.predict(there)
        return float(np.linalg.norm(native - whitening_of(prediction) @ prediction.residual))

    assert error(0.1) <= 0.05 * error(1.0) + 1e-6
