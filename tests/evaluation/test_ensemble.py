"""Averages over runs whose errors are drawn from known distributions."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from gtsam_nav.evaluation.ensemble import (
    NormalisedErrors,
    band_coverage,
    ensemble_nees,
    ensemble_nis,
    normalised_errors,
    whiteness,
)
from gtsam_nav.evaluation.plots import ensemble_figure
from gtsam_nav.frames import quaternion_from_rpy
from gtsam_nav.mission import Sensor
from gtsam_nav.series import ReferenceSeries
from gtsam_nav.solution import Innovations
from gtsam_nav.trajectory import Trajectory

T = np.arange(0.0, 200.0, 0.1)
SIGMA_P, SIGMA_YAW, SIGMA_V = np.array([0.5, 2.0, 1.0]), 0.03, np.array([0.1, 0.2, 0.3])
V_N = np.array([1.5, -0.5, 0.0])


def truth() -> Sensor:
    rpy = np.column_stack([np.zeros_like(T), np.zeros_like(T), np.pi - 1e-3 + 0 * T])
    series = ReferenceSeries(t=T, p_n=T[:, None] * V_N, rpy=rpy)
    return Sensor("reference", "reference", series)


def run(seed: int, claimed: float = 1.0) -> NormalisedErrors:
    """One run whose estimator claims so many times the sigmas that its errors have."""
    rng = np.random.default_rng(seed)
    n = len(T)
    reference = truth().series
    assert isinstance(reference, ReferenceSeries)
    rpy = np.zeros((n, 3))
    rpy[:, 2] = np.pi - 1e-3 + SIGMA_YAW * rng.normal(size=n)  # crosses the wrap
    sigma = np.array([*SIGMA_P, SIGMA_YAW, SIGMA_YAW, SIGMA_YAW]) * claimed
    estimate = Trajectory(
        t=T,
        p_n=reference.p_n + SIGMA_P * rng.normal(size=(n, 3)),
        q_nb_wxyz=quaternion_from_rpy(rpy),
        v_n=V_N + SIGMA_V * rng.normal(size=(n, 3)),
        sigma_v_n=np.tile(SIGMA_V * claimed, (n, 1)),
        cov_pose_n=np.tile(np.diag(sigma**2), (n, 1, 1)),
    )
    return normalised_errors(estimate, truth(), np.arange(1.0, 199.0, 1.0))


def test_honest_runs_lie_inside_their_bounds() -> None:
    found = ensemble_nees([run(seed) for seed in range(50)])
    assert set(found) == {"position", "heading", "velocity_n", "velocity_e"}
    for quantity in found.values():
        assert quantity.fraction_inside > 0.9
        assert quantity.mean == pytest.approx(quantity.dof, rel=0.05)
    expected = chi2.ppf([0.025, 0.975], 100) / 50
    assert [found["position"].lower95[0], found["position"].upper95[0]] == pytest.approx(expected)


def test_velocities_are_judged_axis_by_axis() -> None:
    reference = truth().series
    assert isinstance(reference, ReferenceSeries)
    estimate = Trajectory(
        t=T,
        p_n=reference.p_n,
        q_nb_wxyz=quaternion_from_rpy(np.zeros((len(T), 3))),
        v_n=V_N + np.tile([0.1, 0.6, 0.0], (len(T), 1)),
        sigma_v_n=np.tile(SIGMA_V, (len(T), 1)),
        cov_pose_n=np.tile(np.eye(6), (len(T), 1, 1)),
    )
    found = normalised_errors(estimate, truth(), np.arange(1.0, 199.0, 10.0)).values
    np.testing.assert_allclose(found["velocity_n"], 1.0, rtol=1e-6)
    np.testing.assert_allclose(found["velocity_e"], 9.0, rtol=1e-6)


@pytest.mark.parametrize("claimed", [0.8, 1.3])
def test_over_and_underconfidence_show(claimed: float) -> None:
    found = ensemble_nees([run(seed, claimed) for seed in range(50)])
    for quantity in found.values():
        assert quantity.fraction_inside < 0.8


def test_a_time_that_is_not_covered_is_refused() -> None:
    estimate = Trajectory(
        t=T[:10],
        p_n=np.zeros((10, 3)),
        q_nb_wxyz=quaternion_from_rpy(np.zeros((10, 3))),
        cov_pose_n=np.tile(np.eye(6), (10, 1, 1)),
    )
    with pytest.raises(ValueError, match="cover"):
        normalised_errors(estimate, truth(), np.array([150.0]))


def test_innovations_are_averaged_over_spans() -> None:
    rng = np.random.default_rng(5)
    t = np.arange(0.0, 100.0, 0.5)
    runs = [Innovations(t, rng.chisquare(3, len(t)), 3) for _ in range(20)]
    found = ensemble_nis(runs, bin_s=10.0)
    assert found.t.tolist() == pytest.approx(np.arange(5.0, 100.0, 10.0).tolist())
    assert found.mean == pytest.approx(3.0, rel=0.05)
    expected = chi2.ppf([0.025, 0.975], 20 * 20 * 3) / (20 * 20)
    assert [found.lower95[0], found.upper95[0]] == pytest.approx(expected)
    assert len(ensemble_figure({"ins-ekf": {"gnss": found}}).axes) == 1


def test_bands_of_an_honest_estimator_hold_their_shares() -> None:
    for shares in band_coverage([run(seed, 1.0) for seed in range(50)]).values():
        assert shares == pytest.approx((0.683, 0.954, 0.997), abs=0.02)
    for shares in band_coverage([run(seed, 0.5) for seed in range(50)]).values():
        assert shares[0] < 0.5


def correlated(seed: int, kept: float) -> Innovations:
    steps = np.random.default_rng(seed).normal(size=(400, 2))
    for k in range(1, len(steps)):
        steps[k] = kept * steps[k - 1] + np.sqrt(1 - kept**2) * steps[k]
    return Innovations(np.arange(400.0), np.sum(steps**2, axis=1), 2, steps)


def test_innovations_that_hang_together_are_not_white() -> None:
    white = whiteness([correlated(seed, 0.0) for seed in range(100)])
    assert white is not None
    assert white.fraction_inside >= 0.9
    assert abs(white.autocorrelation) < 0.02
    assert white.bound95 == pytest.approx(1.96 / np.sqrt(2 * 399))
    coloured = whiteness([correlated(seed, 0.3) for seed in range(20)])
    assert coloured is not None
    assert coloured.fraction_inside < 0.1
    assert coloured.autocorrelation == pytest.approx(0.3, abs=0.05)
    assert whiteness([Innovations(np.arange(5.0), np.ones(5), 1)]) is None
