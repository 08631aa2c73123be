"""Relative errors, in hand-made cases and against evo."""

from __future__ import annotations

import numpy as np
import pytest
import solutions
from evo.core import metrics as evo_metrics
from evo.core.trajectory import PoseTrajectory3D
from evo.core.units import Unit

from gtsam_nav.evaluation.matching import match
from gtsam_nav.evaluation.metrics import evaluate_trajectory
from gtsam_nav.evaluation.relative import relative_error
from gtsam_nav.evaluation.statistics import ErrorStatistics
from gtsam_nav.frames import Array, quaternion_from_rpy
from gtsam_nav.series import ReferenceSeries
from gtsam_nav.trajectory import Trajectory

T = np.arange(0.0, 101.0)


def along_north(yaw: Array | float = 0.0) -> tuple[Array, Array]:
    """One metre a second northwards; roll, pitch, yaw."""
    zero = np.zeros_like(T)
    return np.column_stack([T, zero, zero]), np.column_stack([zero, zero, zero + yaw])


def as_trajectory(p_n: Array, rpy: Array) -> Trajectory:
    return Trajectory(t=T, p_n=p_n, q_nb_wxyz=quaternion_from_rpy(rpy))


def test_a_scale_error_of_one_percent_is_one_percent() -> None:
    p_n, rpy = along_north()
    for reference in (ReferenceSeries(t=T, p_n=p_n, rpy=rpy), ReferenceSeries(t=T, p_n=p_n)):
        rpe = evaluate_trajectory(as_trajectory(1.01 * p_n, rpy), reference).rpe
        for error in (rpe.per_10_m, rpe.per_50_m, rpe.per_10_percent):
            assert error is not None
            assert error.percent == pytest.approx(1.0)


def test_a_steady_turn_of_the_heading_is_degrees_per_metre() -> None:
    p_n, rpy = along_north()
    _, turning = along_north(np.radians(0.5 * T))
    matched = match(as_trajectory(p_n, turning), ReferenceSeries(t=T, p_n=p_n, rpy=rpy))
    assert matched is not None
    error = relative_error(matched, 10.0)
    assert error is not None
    assert error.deg_per_m == pytest.approx(0.5)


def test_without_a_length_a_segment_is_a_tenth_of_the_path() -> None:
    """An error that comes back every ten metres shows over other lengths only."""
    p_n, rpy = along_north()
    swaying = as_trajectory(p_n + np.column_stack([0 * T, np.sin(0.2 * np.pi * T), 0 * T]), rpy)
    reference = ReferenceSeries(t=T, p_n=p_n, rpy=rpy)
    whole_swings = evaluate_trajectory(swaying, reference).rpe
    for error in (whole_swings.per_10_m, whole_swings.per_50_m):
        assert error is not None
        assert error.percent == pytest.approx(0.0, abs=1e-9)
    matched = match(swaying, reference)
    assert matched is not None
    tenth, nine = relative_error(matched, None), relative_error(matched, 9.0)
    assert tenth is not None
    assert nine is not None
    assert tenth.percent == pytest.approx(0.0, abs=1e-9)
    assert nine.percent > 1.0


def test_without_a_reference_heading_there_is_no_heading_error() -> None:
    p_n, rpy = along_north()
    matched = match(as_trajectory(p_n, rpy), ReferenceSeries(t=T, p_n=p_n))
    assert matched is not None
    error = relative_error(matched, 10.0)
    assert error is not None
    assert error.deg_per_m is None
    assert error.percent == pytest.approx(0.0, abs=1e-9)


def test_a_vehicle_at_rest_has_no_relative_error() -> None:
    p_n = np.zeros((len(T), 3))
    matched = match(as_trajectory(p_n, p_n), ReferenceSeries(t=T, p_n=p_n))
    assert matched is not None
    assert relative_error(matched, 10.0) is None
    assert relative_error(matched, None) is None


def evo_pair(estimate: Trajectory, reference: ReferenceSeries) -> tuple[PoseTrajectory3D, ...]:
    """Reference and estimate for evo, flattened to (n, e, yaw)."""
    assert reference.rpy is not None
    flat = []
    for p_n, yaw in ((reference.p_n, reference.rpy[:, 2]), (estimate.p_n, estimate.rpy[:, 2])):
        rpy = np.column_stack([0 * yaw, 0 * yaw, yaw])
        flat.append(
            PoseTrajectory3D(
                positions_xyz=p_n * [1.0, 1.0, 0.0],
                orientations_quat_wxyz=quaternion_from_rpy(rpy),
                timestamps=reference.t,
            )
        )
    return tuple(flat)


def against_evo(metric: evo_metrics.PE, pair: tuple[PoseTrajectory3D, ...]) -> dict[str, float]:
    metric.process_data(pair)
    statistics: dict[str, float] = metric.get_all_statistics()
    return statistics


def walked() -> tuple[Trajectory, ReferenceSeries]:
    t = np.arange(0.0, solutions.DURATION_S, 0.4)
    p_n, rpy = solutions.true_pose(t)
    return solutions.wandering(t, 0.1, seed=60), ReferenceSeries(t=t, p_n=p_n, rpy=rpy)


def test_absolute_errors_agree_with_evo() -> None:
    estimate, reference = walked()
    scores = evaluate_trajectory(estimate, reference)
    evo_reference, evo_estimate = evo_pair(estimate, reference)
    translation = evo_metrics.PoseRelation.translation_part

    def agree(ours: ErrorStatistics | None, theirs: dict[str, float]) -> None:
        assert ours is not None
        for name in ("mean", "rmse", "median", "std", "min", "max"):
            assert getattr(ours, name) == pytest.approx(theirs[name], rel=1e-6)

    agree(scores.ate.none, against_evo(evo_metrics.APE(translation), (evo_reference, evo_estimate)))
    evo_estimate.align(evo_reference)
    agree(scores.ate.se2, against_evo(evo_metrics.APE(translation), (evo_reference, evo_estimate)))


@pytest.mark.parametrize("length", [10.0, 50.0])
def test_relative_errors_agree_with_evo(length: float) -> None:
    estimate, reference = walked()
    matched = match(estimate, reference)
    assert matched is not None
    ours = relative_error(matched, length)
    assert ours is not None
    pair = evo_pair(estimate, reference)

    def mean(relation: evo_metrics.PoseRelation) -> float:
        metric = evo_metrics.RPE(
            relation, length, Unit.meters, 0.05, all_pairs=True, pairs_from_reference=True
        )
        return against_evo(metric, pair)["mean"]

    translation = mean(evo_metrics.PoseRelation.translation_part)
    angle_deg = mean(evo_metrics.PoseRelation.rotation_angle_deg)
    assert ours.percent == pytest.approx(100.0 * translation / length, rel=0.02)
    assert ours.deg_per_m == pytest.approx(angle_deg / length, rel=0.02)
