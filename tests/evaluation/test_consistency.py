"""NEES and NIS of errors whose distribution is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from gtsam_nav.evaluation.consistency import consistency, horizontal_nees
from gtsam_nav.evaluation.matching import match
from gtsam_nav.evaluation.metrics import TrajectoryMetrics, evaluate_trajectory
from gtsam_nav.frames import Array, quaternion_from_rpy
from gtsam_nav.series import ReferenceSeries
from gtsam_nav.trajectory import Trajectory

N = 4000


def drawn(
    sigma_factor: float = 1.0, sigma_reference: float = 0.4
) -> tuple[Trajectory, ReferenceSeries]:
    """Errors drawn from correlated covariances, the reference's noise among them."""
    rng = np.random.default_rng(17)
    t = np.arange(N, dtype=float)
    truth = np.column_stack([t, np.sin(t / 50), np.ones(N)])
    factor = rng.normal(size=(N, 3, 3))
    cov = np.zeros((N, 6, 6))
    cov[:, :3, :3] = factor @ np.swapaxes(factor, 1, 2) + 0.1 * np.eye(3)
    error = (np.linalg.cholesky(cov[:, :3, :3]) @ rng.normal(size=(N, 3, 1)))[:, :, 0]
    noise = rng.normal(size=(N, 3)) * sigma_reference
    estimate = Trajectory(
        t=t,
        p_n=truth + error,
        q_nb_wxyz=quaternion_from_rpy(np.zeros((N, 3))),
        cov_pose_n=cov * sigma_factor**2,
    )
    reference = ReferenceSeries(t=t, p_n=truth + noise, sigma=np.full(N, sigma_reference))
    return estimate, reference


def mean_bounds(dof: int, n: int) -> tuple[float, float]:
    """Where the mean of n chi-square samples lies, 999 times in 1000."""
    lower, upper = chi2.ppf([0.0005, 0.9995], dof * n) / n
    return float(lower), float(upper)


def test_honest_covariances_are_calibrated() -> None:
    nees = evaluate_trajectory(*drawn()).nees
    assert nees is not None
    lower, upper = mean_bounds(2, N)
    assert lower < nees.mean < upper
    assert nees.fraction_inside == pytest.approx(0.95, abs=0.015)
    assert nees.dof == 2
    assert [nees.lower95, nees.upper95] == pytest.approx(chi2.ppf([0.025, 0.975], 2))


def test_overconfidence_shows() -> None:
    nees = evaluate_trajectory(*drawn(sigma_factor=0.5, sigma_reference=1e-3)).nees
    assert nees is not None
    assert nees.mean == pytest.approx(8.0, rel=0.1)
    assert nees.fraction_inside < 0.8


def test_the_reference_s_own_noise_counts_along_each_axis() -> None:
    """The estimate's sigma is 0.3 m, the reference's 0.4 m; the errors are 0.5 m each way."""
    t = np.arange(2.0)
    estimate = Trajectory(
        t=t,
        p_n=np.tile([0.5, 0.5, 0.0], (2, 1)),
        q_nb_wxyz=np.tile([1.0, 0, 0, 0], (2, 1)),
        cov_pose_n=np.tile(0.09 * np.eye(6), (2, 1, 1)),
    )
    reference = ReferenceSeries(t=t, p_n=np.zeros((2, 3)), sigma=np.full(2, 0.4))
    matched = match(estimate, reference)
    assert matched is not None
    np.testing.assert_allclose(horizontal_nees(matched), 2.0)


def test_the_lever_arm_carries_the_heading_uncertainty() -> None:
    """With a lever of 10 m forward, a heading error of 0.1 rad is 1 m to the east."""
    t = np.arange(3.0)
    cov = np.zeros((3, 6, 6))
    cov[:, 5, 5] = 0.1**2
    cov[:, 0, 0] = cov[:, 1, 1] = 1e-6
    estimate = Trajectory(
        t=t, p_n=np.zeros((3, 3)), q_nb_wxyz=np.tile([1.0, 0, 0, 0], (3, 1)), cov_pose_n=cov
    )
    antenna = np.tile([10.0, 2.0, 0.0], (3, 1))
    matched = match(estimate, ReferenceSeries(t=t, p_n=antenna), lever_b=(10.0, 0.0, 0.0))
    assert matched is not None
    np.testing.assert_allclose(horizontal_nees(matched), 4.0, rtol=1e-4)


def test_scores_do_not_depend_on_how_many_samples_are_matched_at_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    estimate, reference = drawn()
    at_once = match(estimate, reference, (1.0, 2.0, 3.0))
    monkeypatch.setattr("gtsam_nav.evaluation.matching.SAMPLES_AT_ONCE", 300)
    in_parts = match(estimate, reference, (1.0, 2.0, 3.0))
    assert at_once is not None
    assert in_parts is not None
    np.testing.assert_allclose(in_parts.estimate.p_n, at_once.estimate.p_n, rtol=1e-12)
    np.testing.assert_allclose(in_parts.cov_ne, at_once.cov_ne, rtol=1e-12)


def test_without_a_covariance_there_is_no_nees() -> None:
    estimate, reference = drawn()
    bare = Trajectory(t=estimate.t, p_n=estimate.p_n, q_nb_wxyz=estimate.q_nb_wxyz)
    assert evaluate_trajectory(bare, reference).nees is None


def test_a_start_declared_perfect_is_left_out() -> None:
    estimate, reference = drawn()
    assert estimate.cov_pose_n is not None
    cov = estimate.cov_pose_n.copy()
    cov[0] = 0.0
    perfect = Trajectory(
        t=estimate.t, p_n=estimate.p_n, q_nb_wxyz=estimate.q_nb_wxyz, cov_pose_n=cov
    )
    matched = match(perfect, ReferenceSeries(t=reference.t, p_n=reference.p_n))
    assert matched is not None
    nees = horizontal_nees(matched)
    assert nees is not None
    assert len(nees) == N - 1


def test_what_is_known_along_one_line_only_is_left_out() -> None:
    """North and east that err as one have a covariance that cannot be inverted."""
    estimate, reference = drawn()
    assert estimate.cov_pose_n is not None
    cov = estimate.cov_pose_n.copy()
    cov[7, :2, :2] = 1.0
    tied = replace(estimate, cov_pose_n=cov)
    matched = match(tied, ReferenceSeries(t=reference.t, p_n=reference.p_n))
    assert matched is not None
    nees = horizontal_nees(matched)
    assert nees is not None
    assert len(nees) == N - 1


@pytest.mark.parametrize("dof", [1, 3])
def test_nis_against_its_own_degrees_of_freedom(dof: int) -> None:
    squared: Array = np.random.default_rng(dof).chisquare(dof, 5000)
    found = consistency(squared, dof)
    assert found is not None
    lower, upper = mean_bounds(dof, 5000)
    assert lower < found.mean < upper
    assert found.fraction_inside == pytest.approx(0.95, abs=0.012)
    assert consistency(np.empty(0), dof) is None


def test_far_too_little_or_too_much_covariance_is_said_in_words() -> None:
    honest, timid = consistency(np.full(10, 2.0), 2), consistency(np.full(10, 0.1), 2)
    sure = consistency(np.full(10, 18.0), 2)
    assert honest is not None
    assert timid is not None
    assert sure is not None
    assert honest.doubt == ""
    assert timid.doubt == "the covariance states errors 4.5 times what they are"
    assert sure.doubt == "the errors are 3.0 times what the covariance states"
    metrics = TrajectoryMetrics(nees=sure, coverage=1.0)
    assert "nees       18.00 (2 degrees of freedom): the errors are 3.0 times" in str(metrics)
