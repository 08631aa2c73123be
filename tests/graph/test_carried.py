"""Readings of many intervals at once, against GTSAM's own prediction of each."""

from __future__ import annotations

from functools import partial
from typing import Any

import gtsam
import numpy as np

from gtsam_nav.frames import Array, rotation_from_rpy
from gtsam_nav.graph.carried import carried, coasted
from gtsam_nav.graph.preintegration import InertialStep, Readings

EARTH_N = np.array([5e-5, 0.0, -5e-5])
MOUNT = gtsam.Pose3(gtsam.Rot3(rotation_from_rpy([3.1, 0.1, 0.4])), np.array([0.3, -0.2, 0.1]))
BIAS = gtsam.imuBias.ConstantBias(np.array([0.05, -0.02, 0.03]), np.array([2e-3, -1e-3, 3e-3]))


def step_of(rng: np.random.Generator, k: int, readings: int, *, mounted: bool) -> InertialStep:
    parameters = gtsam.PreintegrationParams(np.array([0.0, 0.0, 9.81]))
    if mounted:
        parameters.setBodyPSensor(MOUNT)
        parameters.setOmegaCoriolis(EARTH_N)
    swing = np.linspace(0.0, 5.0, readings)[:, None]
    gyro = 0.2 * np.sin(swing + rng.uniform(0, 6, 3)) + rng.normal(scale=1e-3, size=(readings, 3))
    accel = np.array([0.5, 0.2, 9.6]) + rng.normal(scale=0.3, size=(readings, 3))
    given = Readings(accel, gyro, rng.uniform(0.008, 0.012, readings))
    return InertialStep(k, BIAS, parameters, lambda: given, float(np.sum(given.dt)))


def predicted(step: InertialStep, before: Any, t: float) -> Any:
    """By GTSAM, reading by reading until that time."""
    pim = gtsam.PreintegratedImuMeasurements(step.parameters, BIAS)
    begin = 0.0
    accel, gyro, durations = step.readings()
    for f, omega, dt in zip(accel, gyro, durations.tolist(), strict=True):
        if begin < t:
            pim.integrateMeasurement(f, omega, min(dt, t - begin))
        begin += dt
    return before if t == 0.0 else pim.predict(before, BIAS)


def states(rng: np.random.Generator, n: int) -> list[Any]:
    return [
        gtsam.NavState(
            gtsam.Rot3(rotation_from_rpy(rng.uniform(-0.5, 0.5, 3))),
            rng.normal(scale=50.0, size=3),
            rng.normal(size=3),
        )
        for _ in range(n)
    ]


def test_all_intervals_are_carried_as_each_one_is() -> None:
    rng = np.random.default_rng(3)
    steps = [step_of(rng, k, 200 + 40 * k, mounted=k != 1) for k in range(3)]
    before = states(rng, 3)
    elapsed: list[Array] = [
        np.append(np.sort(rng.uniform(0, step.span_s, 5)), step.span_s) for step in steps
    ]
    elapsed[0] = np.append(0.0, elapsed[0])
    got = carried(steps, before, [BIAS] * 3, elapsed)
    wanted = [
        predicted(step, state, t)
        for step, state, times in zip(steps, before, elapsed, strict=True)
        for t in times.tolist()
    ]
    # what single readings turn, 2e-3 rad, squared and added up is what GTSAM's tangent neglects
    for n, state in enumerate(wanted):
        apart = got.R_nb[n].T @ state.attitude().matrix()
        assert np.abs(apart - np.eye(3)).max() < 3e-4
        np.testing.assert_allclose(got.v_n[n], state.velocity(), atol=2e-3)
        np.testing.assert_allclose(got.p_n[n], state.position(), atol=3e-3)


def test_without_readings_it_keeps_its_velocity_and_attitude() -> None:
    (before,) = states(np.random.default_rng(4), 1)
    got = coasted(before, np.array([0.0, 0.5, 2.0]))
    np.testing.assert_array_equal(got.R_nb, [before.attitude().matrix()] * 3)
    np.testing.assert_array_equal(got.v_n, [before.velocity()] * 3)
    way = np.outer([0.0, 0.5, 2.0], before.velocity())
    np.testing.assert_allclose(got.p_n, before.position() + way)


def test_readings_a_tenth_as_long_are_ten_times_as_near() -> None:
    """What is left is GTSAM's step; nothing else, such as the Earth's turn, is missing."""
    apart = []
    for n in (100, 1000):
        rng = np.random.default_rng(5)
        parameters = gtsam.PreintegrationParams(np.array([0.0, 0.0, 9.81]))
        parameters.setBodyPSensor(MOUNT)
        parameters.setOmegaCoriolis(EARTH_N)
        swing = np.linspace(0.0, 5.0, n)[:, None]
        gyro, accel = 0.2 * np.sin(swing + np.arange(3)), np.cos(swing - np.arange(3))
        given = Readings(accel, gyro, np.full(n, 4.0 / n))
        step = InertialStep(1, BIAS, parameters, partial(Readings, *given), 4.0)
        (before,) = states(rng, 1)
        got = carried([step], [before], [BIAS], [np.array([4.0])])
        state = predicted(step, before, 4.0)
        apart.append(np.linalg.norm(got.v_n[0] - state.velocity()))
    assert apart[1] < 0.15 * apart[0]
