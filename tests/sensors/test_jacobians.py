"""Models of the filters alone: their Jacobians against central differences, and what they mean."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gtsam_nav.frames import Array, rotation_from_rpy
from gtsam_nav.sensors import dvl, gnss, motion_constraints, orientation
from gtsam_nav.sensors.prediction import BodyState, Prediction

Model = Callable[[BodyState], Prediction]


def gnss_velocity(rng: np.random.Generator) -> Model:
    v_n, rate_b, lever_b = rng.normal(size=(3, 3))
    return lambda s: gnss.predict_velocity(s, v_n, rate_b, lever_b, 0.1)


def heading(rng: np.random.Generator) -> Model:
    reading, bias = rng.uniform(-np.pi, np.pi), rng.normal()
    return lambda s: orientation.predict_heading(s, reading, bias, 0.1)


def tilt(rng: np.random.Generator) -> Model:
    roll, pitch = rng.uniform(-1.0, 1.0, 2)
    return lambda s: orientation.predict_tilt(s, roll, pitch, 0.1)


def body_velocity(rng: np.random.Generator) -> Model:
    v_b = rng.normal(size=3)
    return lambda s: dvl.predict(s, v_b, 0.1)


def rest(_: np.random.Generator) -> Model:
    return lambda s: motion_constraints.zero_velocity(s, 0.1)


def no_way(_: np.random.Generator) -> Model:
    return lambda s: motion_constraints.zero_horizontal_velocity(s, 0.1)


def no_slip(_: np.random.Generator) -> Model:
    return lambda s: motion_constraints.nonholonomic(s, 0.1)


MODELS = {
    make.__name__: make
    for make in (gnss_velocity, heading, tilt, body_velocity, rest, no_way, no_slip)
}


def moved(state: BodyState, error: Array) -> BodyState:
    return BodyState(
        state.R_nb @ Rotation.from_rotvec(error[:3]).as_matrix(),
        state.p_n + state.R_nb @ error[3:6],
        state.v_n + state.R_nb @ error[6:],
    )


@pytest.mark.parametrize("name", MODELS)
@given(st.integers(0, 2**32 - 1))
def test_jacobians_are_those_of_the_residual(name: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    # Euler angles end at a pitch of 90 degrees
    rpy = rng.uniform([-np.pi, -1.2, -np.pi], [np.pi, 1.2, np.pi])
    state = BodyState(rotation_from_rpy(rpy), 100 * rng.normal(size=3), 2 * rng.normal(size=3))
    model = MODELS[name](rng)

    def change(error: Array) -> Array:
        difference = model(moved(state, error)).residual - model(moved(state, -error)).residual
        if name in ("heading", "tilt"):
            difference = (difference + np.pi) % (2 * np.pi) - np.pi
        return difference / 2e-5

    numeric = np.array([change(e) for e in 1e-5 * np.eye(9)]).T
    prediction = model(state)
    np.testing.assert_allclose(prediction.jacobian, numeric, atol=1e-6)
    assert prediction.residual.shape == (len(numeric),)
    np.testing.assert_allclose(prediction.cov, 0.1**2 * np.eye(len(numeric)))


def test_a_heading_is_wrapped_and_biased_as_the_whole_orientation_is() -> None:
    state = BodyState(rotation_from_rpy([0.0, 0.0, np.radians(179.0)]), np.zeros(3), np.zeros(3))
    across = orientation.predict_heading(state, np.radians(-179.0), 0.0, 0.1)
    assert np.degrees(across.residual[0]) == pytest.approx(-2.0)
    bias = 0.1
    R_measured = rotation_from_rpy([0.0, 0.0, -bias]) @ state.R_nb
    whole = orientation.predict(state, R_measured, bias, np.full(3, 0.1))
    alone = orientation.predict_heading(state, np.radians(179.0) - bias, bias, 0.1)
    np.testing.assert_allclose(whole.residual, 0.0, atol=1e-12)
    np.testing.assert_allclose(alone.residual, 0.0, atol=1e-12)


def test_an_antenna_swings_about_the_body() -> None:
    state = BodyState(rotation_from_rpy([0.0, 0.0, np.pi / 2]), np.zeros(3), np.array([1.0, 0, 0]))
    rate_b, lever_b = np.array([0.0, 0.0, 0.5]), np.array([2.0, 0.0, -1.0])
    found = gnss.predict_velocity(state, np.zeros(3), rate_b, lever_b, 0.1)
    np.testing.assert_allclose(found.residual, [0.0, 0.0, 0.0], atol=1e-12)


def test_what_rolls_without_slip_is_free_ahead() -> None:
    R_nb = rotation_from_rpy([0.0, 0.0, 0.7])
    state = BodyState(R_nb, np.zeros(3), R_nb @ [5.0, 0.3, -0.2])
    np.testing.assert_allclose(motion_constraints.nonholonomic(state, 0.1).residual, [0.3, -0.2])
    np.testing.assert_allclose(
        motion_constraints.zero_velocity(state, 0.1).residual, [5.0, 0.3, -0.2]
    )
