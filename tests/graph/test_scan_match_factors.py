"""Scan matches and preintegration as factors: residual, cost, and prediction."""

from __future__ import annotations

import gtsam
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gtsam_nav.frames import rotation_from_rpy, wrap_angle
from gtsam_nav.graph import factors
from gtsam_nav.graph.factors import B, X
from gtsam_nav.mission import ImuSeries, Sensor
from gtsam_nav.simulation.marina import ORIGIN, marina
from gtsam_nav.simulation.motion import Motion, MotionSettings
from gtsam_nav.simulation.sensors import ideal_imu

angles = st.floats(-3.1, 3.1)
offsets = st.floats(-20.0, 20.0)
small = st.floats(-0.3, 0.3)


def cauchy_cost(d2: float, k: float) -> float:
    return 0.5 * k**2 * float(np.log1p(d2 / k**2))


@given(
    yaw_a=angles,
    x=offsets,
    y=offsets,
    yaw=angles,
    ex=small,
    ey=small,
    eyaw=small,
    seed=st.integers(0, 99),
)
def test_planar_match_costs_its_mahalanobis_distance(
    yaw_a: float, x: float, y: float, yaw: float, ex: float, ey: float, eyaw: float, seed: int
) -> None:
    root = np.random.default_rng(seed).normal(scale=0.3, size=(3, 3))
    cov = root @ root.T + 0.05**2 * np.eye(3)
    q = np.array([x, y, yaw])
    factor = factors.planar_match(X(0), X(1), q, cov, cauchy_k=1.5)

    def cost(error: np.ndarray) -> float:
        R_a = rotation_from_rpy([0.0, 0.0, yaw_a])
        p_a = np.array([4.0, -7.0, 1.5])
        there = q + error
        # depth and velocity may be anything
        p_b = p_a + R_a @ [there[0], there[1], 2.0]
        values = gtsam.Values()
        values.insert(X(0), factors.nav_state(R_a, p_a, np.array([0.5, 0.1, 0.0])))
        R_b = R_a @ rotation_from_rpy([0.0, 0.0, there[2]])
        values.insert(X(1), factors.nav_state(R_b, p_b, np.array([-0.2, 0.3, 0.1])))
        return float(factor.error(values))

    assert cost(np.zeros(3)) == pytest.approx(0.0, abs=1e-9)
    error = np.array([ex, ey, eyaw])
    # the native residual is the Logmap of a pose: its translation is exact only without a turn
    straight = error * [1.0, 1.0, 0.0]
    for e in (straight, error * [0.0, 0.0, 1.0]):
        d2 = float(e @ np.linalg.solve(cov, e))
        assert cost(e) == pytest.approx(cauchy_cost(d2, 1.5), rel=1e-6, abs=1e-9)


def test_planar_match_leaves_tilt_depth_and_velocity_free() -> None:
    factor = factors.planar_match(X(0), X(1), np.array([3.0, -1.0, 0.4]), 0.01 * np.eye(3), 1.5)
    values = gtsam.Values()
    values.insert(X(0), gtsam.NavState())
    R_ab = rotation_from_rpy([0.0, 0.0, 0.4])
    values.insert(X(1), factors.nav_state(R_ab, np.array([3.0, -1.0, 0.0]), np.zeros(3)))
    A, _ = factor.linearize(values).jacobian()
    free = [0, 1, 5, 6, 7, 8]  # roll, pitch, down, velocity
    np.testing.assert_allclose(A[:, [9 + c for c in free]], 0.0, atol=1e-9)
    assert np.linalg.matrix_rank(A[:, 9:]) == 3


@pytest.mark.parametrize("begin", [5.0, 30.03, 61.7])
def test_preintegration_predicts_the_next_keyframe(begin: float) -> None:
    """A noise-free IMU, mounted askew, Earth's rotation and gravity included.

    Preintegration is of first order in the sample time: 4 kHz leaves 0.07 mm, 100 Hz 3 mm.
    """
    rate_hz, span_s = 4000.0, 2.0
    motion = Motion(marina(), MotionSettings(), np.random.default_rng(4))
    t = begin - 0.1 + np.arange(int((span_s + 0.3) * rate_hz)) / rate_hz
    # each reading holds until the next: take the interval's middle
    gyro_b, accel_b = ideal_imu(motion.at(t + 0.5 / rate_hz), ORIGIN)
    R_bi = rotation_from_rpy([0.1, -0.2, 1.3])
    imu = Sensor(
        name="imu",
        type="imu",
        series=ImuSeries(t=t, gyro_i=gyro_b @ R_bi, accel_i=accel_b @ R_bi),
        R_bs=R_bi,
        noise={},
    )
    ends = motion.at(np.array([begin, begin + span_s]))
    before, after = (
        factors.nav_state(R, p, v) for R, p, v in zip(ends.R_nb, ends.p_n, ends.v_n, strict=True)
    )
    bias = gtsam.imuBias.ConstantBias()
    assert isinstance(imu.series, ImuSeries)
    pim = factors.preintegrate(
        imu.series, factors.imu_parameters(imu, ORIGIN), bias, begin, begin + span_s
    )
    assert pim.deltaTij() == pytest.approx(span_s, abs=1e-9)
    predicted = pim.predict(before, bias)
    np.testing.assert_allclose(predicted.position(), after.position(), atol=1e-4)
    np.testing.assert_allclose(predicted.velocity(), after.velocity(), atol=1e-4)
    turn = after.attitude().between(predicted.attitude())
    assert np.linalg.norm(gtsam.Rot3.Logmap(turn)) < 1e-6
    values = gtsam.Values()
    values.insert(X(0), before)
    values.insert(X(1), after)
    values.insert(B(0), bias)
    assert gtsam.ImuFactor2(X(0), X(1), B(0), pim).error(values) < 0.05


def test_preintegration_holds_readings_over_uneven_edges() -> None:
    """Keyframes between samples: the sample before the first still counts."""
    t = np.array([0.0, 0.1, 0.25, 0.3])
    imu = ImuSeries(
        t=t, gyro_i=np.tile([0.0, 0.0, 1.0], (4, 1)) * t[:, None], accel_i=np.zeros((4, 3))
    )
    sensor = Sensor(name="imu", type="imu", series=imu)
    parameters = factors.imu_parameters(sensor, None)
    pim = factors.preintegrate(imu, parameters, gtsam.imuBias.ConstantBias(), 0.15, 0.45)
    assert pim.deltaTij() == pytest.approx(0.3)
    turned = 0.1 * 0.1 + 0.25 * 0.05 + 0.3 * 0.15
    assert wrap_angle(pim.deltaRij().yaw()) == pytest.approx(turned, abs=1e-9)
