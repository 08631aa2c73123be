"""Inertial readings preintegrated into one factor, at the biases that are believed.

A preintegrated factor is linear in what the biases differ from those it was integrated at. A gyro's
0.02 rad/s turn 5 s of readings by 0.1 rad: of the second order of that, gravity makes 0.1 m/s and
0.1 m along the vertical, many times the readings' noise, which the rest of the solution would
bend to explain. So the readings are integrated anew wherever the biases have moved too far.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import gtsam
import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.graph.factors import B, X
from gtsam_nav.graph.problem import InertialStep, Problem, SensorFactor

MAX_TURN_RAD = 1e-3
"""What a gyro bias may turn a step's readings by beside the one they were integrated at."""


def add_step(
    problem: Problem,
    k: int,
    parameters: Any,
    accel: Array,
    gyro: Array,
    dt: Array,
    walking: Any = None,
) -> None:
    """One preintegrated factor into keyframe k, at the problem's first value of the bias.

    With ``walking`` parameters, its noise is the combined form's. GTSAM's combined factor knows no
    NavState, and ties the walk of the biases to what it does to the motion; here the one is a
    factor of its own and the other widens the noise.
    """
    pim = gtsam.PreintegratedImuMeasurements(parameters, problem.bias)
    step = InertialStep(pim, parameters, accel, gyro, dt, walking)
    problem.steps[k], factor = _integrated(k, step, problem.bias)
    problem.add(k, "imu", factor)


def integrate_anew(problem: Problem, k: int, bias: Any) -> bool:
    """Integrate the readings into keyframe k at another bias where theirs is too far from it.

    The new factor takes the place of the old; returns whether there is one.
    """
    step = problem.steps[k]
    if step is None:
        return False
    moved = bias.gyroscope() - step.pim.biasHat().gyroscope()
    if np.linalg.norm(moved) * np.sum(step.dt) < MAX_TURN_RAD:
        return False
    problem.steps[k], factor = _integrated(k, step, bias)
    brought = problem.factors[k]
    (old,) = (i for i, entry in enumerate(brought) if isinstance(entry.gaussian, gtsam.ImuFactor2))
    brought[old] = SensorFactor("imu", factor)
    return True


def integrate_all_anew(problem: Problem, values: Any) -> int:
    """The same of all keyframes at the biases of an estimate; returns how many were."""
    if not problem.uses_imu:
        return 0
    return sum(
        integrate_anew(problem, k, values.atConstantBias(B(k - 1)))
        for k in range(1, len(problem.t))
    )


def _integrated(k: int, step: InertialStep, bias: Any) -> tuple[InertialStep, Any]:
    """The step at a bias, and its factor."""
    pim = gtsam.PreintegratedImuMeasurements(step.parameters, bias)
    _integrate(pim, step)
    factor: Any = gtsam.ImuFactor2(X(k - 1), X(k), B(k - 1), pim)
    if step.walking is not None:
        combined = gtsam.PreintegratedCombinedMeasurements(step.walking, bias)
        _integrate(combined, step)
        cov = combined.preintMeasCov()[:9, :9]
        factor = factor.cloneWithNewNoiseModel(gtsam.noiseModel.Gaussian.Covariance(cov))
    return replace(step, pim=pim), factor


def _integrate(pim: Any, step: InertialStep) -> None:
    for f, omega, dt in zip(list(step.accel), list(step.gyro), step.dt.tolist(), strict=True):
        pim.integrateMeasurement(f, omega, dt)
