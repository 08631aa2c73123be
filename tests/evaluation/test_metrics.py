"""Absolute errors, alignments, coverage and the metrics.json document."""

from __future__ import annotations

import json
import logging
from dataclasses import replace

import numpy as np
import pytest
import solutions
from hypothesis import given, settings
from hypothesis import strategies as st

from gtsam_nav.evaluation.alignment import align, fit_rigid
from gtsam_nav.evaluation.matching import distance_m, match
from gtsam_nav.evaluation.metrics import (
    LEAST_COVERAGE,
    Metrics,
    TrajectoryMetrics,
    evaluate,
    evaluate_trajectory,
)
from gtsam_nav.frames import Array, quaternion_from_rpy, rotation_from_rpy
from gtsam_nav.mission import Mission
from gtsam_nav.series import ReferenceSeries
from gtsam_nav.trajectory import Trajectory

STATISTICS = {"mean", "rmse", "median", "std", "min", "max", "p95"}


def level(t: Array, p_n: Array, yaw: Array | float = 0.0) -> Trajectory:
    rpy = np.zeros((len(t), 3))
    rpy[:, 2] = yaw
    return Trajectory(t=t, p_n=p_n, q_nb_wxyz=quaternion_from_rpy(rpy))


def straight(n: int = 101, speed: float = 1.0) -> tuple[Array, Array]:
    t = np.arange(float(n))
    return t, np.column_stack([speed * t, np.zeros(n), np.zeros(n)])


def figure_eight(n: int = 400) -> tuple[Array, Array]:
    t = np.linspace(0.0, 400.0, n)
    return t, solutions.true_pose(t)[0]


def moved(p_n: Array, yaw: float, shift_n: Array) -> Array:
    return p_n @ rotation_from_rpy([0.0, 0.0, yaw]).T + shift_n


def test_constant_offset_is_the_error_without_alignment() -> None:
    t, p_n = straight()
    scores = evaluate_trajectory(
        level(t, p_n + np.array([3.0, 4.0, 12.0])), ReferenceSeries(t=t, p_n=p_n)
    )
    assert scores.ate.none is not None
    assert scores.ate_3d is not None
    assert scores.ate_3d.none is not None
    assert scores.ate.none.mean == pytest.approx(5.0)
    assert scores.ate.none.std == pytest.approx(0.0, abs=1e-12)
    assert scores.ate_3d.none.max == pytest.approx(13.0)
    assert scores.ate.se2 is not None
    assert scores.ate.se2.max == pytest.approx(0.0, abs=1e-9)


def test_statistics_of_known_errors() -> None:
    t, p_n = straight(5)
    off = p_n.copy()
    off[:, 1] = [1.0, 2.0, 3.0, 4.0, 10.0]
    none = evaluate_trajectory(level(t, off), ReferenceSeries(t=t, p_n=p_n)).ate.none
    assert none is not None
    assert none.mean == pytest.approx(4.0)
    assert none.median == pytest.approx(3.0)
    assert none.rmse == pytest.approx(np.sqrt(26.0))
    assert none.std == pytest.approx(np.sqrt(10.0))
    assert (none.min, none.max) == (1.0, 10.0)
    assert none.p95 == pytest.approx(8.8)


@settings(deadline=None, max_examples=30)
@given(
    yaw=st.floats(-np.pi, np.pi),
    shift=st.tuples(st.floats(-500, 500), st.floats(-500, 500)),
    seed=st.integers(0, 10),
)
def test_se2_error_does_not_depend_on_where_the_estimate_lies(
    yaw: float, shift: tuple[float, float], seed: int
) -> None:
    t, p_n = figure_eight()
    estimate = p_n + np.random.default_rng(seed).normal(size=p_n.shape)
    reference = ReferenceSeries(t=t, p_n=p_n)
    here = evaluate_trajectory(level(t, estimate), reference).ate
    there = evaluate_trajectory(
        level(t, moved(estimate, yaw, np.array([*shift, 0.0]))), reference
    ).ate
    assert here.se2 is not None
    assert here.start is not None
    assert there.se2 is not None
    assert there.start is not None
    assert there.se2.mean == pytest.approx(here.se2.mean, abs=1e-8)
    assert there.start.mean == pytest.approx(here.start.mean, abs=1e-8)
    assert there.se2.determinant == pytest.approx(1.0)


@settings(deadline=None, max_examples=30)
@given(
    rpy=st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-np.pi, np.pi)),
    dimension=st.sampled_from([2, 3]),
)
def test_fit_finds_the_motion_that_was_applied(
    rpy: tuple[float, float, float], dimension: int
) -> None:
    points = np.random.default_rng(0).normal(size=(30, dimension)) * [9, 5, 2][:dimension]
    R = rotation_from_rpy([0.0, 0.0, rpy[2]])[:2, :2] if dimension == 2 else rotation_from_rpy(rpy)
    p = np.arange(1.0, dimension + 1.0)
    R_fit, p_fit = fit_rigid(points, points @ R.T + p)
    np.testing.assert_allclose(R_fit, R, atol=1e-9)
    np.testing.assert_allclose(p_fit, p, atol=1e-8)


def test_a_mirrored_estimate_is_not_mirrored_back() -> None:
    t, p_n = figure_eight()
    mirrored = p_n * [1.0, -1.0, 1.0] + [0.0, 0.3, 0.0]
    se2 = evaluate_trajectory(level(t, mirrored), ReferenceSeries(t=t, p_n=p_n)).ate.se2
    assert se2 is not None
    assert se2.determinant == pytest.approx(1.0)
    assert se2.mean > 1.0


def test_scale_is_never_fitted() -> None:
    t, p_n = straight()
    se3 = evaluate_trajectory(level(t, 1.02 * p_n), ReferenceSeries(t=t, p_n=p_n)).ate.se3
    assert se3 is not None
    assert se3.max == pytest.approx(0.02 * 50.0)


def test_start_alignment_scores_only_what_follows_its_stretch() -> None:
    t, p_n = straight()
    bent = p_n.copy()
    bent[31:, 1] = 0.1 * (p_n[31:, 0] - 30.0)
    matched = match(
        level(t, moved(bent, 0.4, np.array([5.0, 5.0, 0.0]))), ReferenceSeries(t=t, p_n=p_n)
    )
    assert matched is not None
    aligned = align(matched, "start")
    assert aligned is not None
    assert aligned.stretch_s == 30.0
    assert aligned.first == 31
    np.testing.assert_allclose(aligned.horizontal_m, 0.1 * (p_n[31:, 0] - 30.0), atol=1e-9)


def test_start_alignment_is_null_where_30_m_are_never_reached() -> None:
    t, p_n = straight(30)
    scores = evaluate_trajectory(level(t, p_n), ReferenceSeries(t=t, p_n=p_n))
    assert scores.ate.start is None
    assert scores.ate.se2 is not None
    assert scores.rpe.per_50_m is None


def test_lever_arm_is_applied_to_the_estimate() -> None:
    t, p_n = straight()
    lever_b = np.array([2.0, 0.5, -1.0])
    yaw = 0.02 * t
    antenna = p_n + rotation_from_rpy(np.column_stack([0 * t, 0 * t, yaw])) @ lever_b
    reference = ReferenceSeries(t=t, p_n=antenna)
    with_lever = evaluate_trajectory(level(t, p_n, yaw), reference, lever_b)
    without = evaluate_trajectory(level(t, p_n, yaw), reference)
    assert with_lever.ate_3d is not None
    assert with_lever.ate_3d.none is not None
    assert without.ate.none is not None
    assert with_lever.ate_3d.none.max < 1e-9
    assert without.ate.none.mean == pytest.approx(np.hypot(2.0, 0.5))


def test_the_estimate_is_interpolated_at_the_reference_and_never_over_a_gap() -> None:
    t, p_n = straight(101)
    sparse = np.flatnonzero((t % 2 == 0) & ~((t > 40) & (t < 60)))
    reference = ReferenceSeries(t=t[:-1] + 0.5, p_n=p_n[:-1] + np.array([0.5, 0.0, 0.0]))
    matched = match(level(t[sparse], p_n[sparse]), reference)
    assert matched is not None
    assert not np.any((matched.t > 40) & (matched.t < 60))
    assert matched.coverage == pytest.approx((39 + 39) / 99)
    np.testing.assert_allclose(matched.estimate.p_n[:, 0], matched.t)


def test_coverage_is_of_the_reference_inside_the_window() -> None:
    t, p_n = straight(101)
    reference = ReferenceSeries(t=t[20:], p_n=p_n[20:])
    half = level(t[:61], p_n[:61])
    assert evaluate_trajectory(half, reference).coverage == pytest.approx(0.5)
    windowed = evaluate_trajectory(half, reference, window_s=(0.0, 61.0))
    assert windowed.coverage == 1.0
    assert not windowed.failed
    assert evaluate_trajectory(half, reference).failed
    assert LEAST_COVERAGE == 0.99


def test_windows_are_half_open() -> None:
    t, p_n = straight(11)
    matched = match(level(t, p_n), ReferenceSeries(t=t, p_n=p_n), window_s=(2.0, 5.0))
    assert matched is not None
    assert matched.t.tolist() == [2.0, 3.0, 4.0]


def test_nothing_to_score_is_null_and_not_an_error() -> None:
    t, p_n = straight(11)
    reference = ReferenceSeries(t=t, p_n=p_n)
    assert evaluate_trajectory(level(t, p_n), reference, window_s=(90.0, 99.0)).coverage is None
    apart = evaluate_trajectory(level(t + 100.0, p_n), reference)
    assert apart.coverage == 0.0
    assert apart.ate == TrajectoryMetrics().ate
    assert apart.failed


def test_an_unusable_vertical_is_not_scored() -> None:
    t, p_n = figure_eight()
    wild = p_n.copy()
    wild[:, 2] = np.random.default_rng(1).normal(size=len(t)) * 100.0
    scores = evaluate_trajectory(
        level(t, p_n), ReferenceSeries(t=t, p_n=wild, vertical_usable=False)
    )
    assert scores.ate_3d is None
    assert scores.ate.se3 is not None
    assert scores.ate.se3.max < 1e-9


def test_local_frames_have_no_errors_without_alignment() -> None:
    local = replace(solutions.graph_solution(), georeferenced=False)
    metrics = evaluate(local)
    assert metrics.ate_online is not None
    assert metrics.ate_3d is not None
    for errors in (metrics.ate, metrics.ate_online, metrics.ate_3d):
        assert errors.none is None
        assert errors.se2 is not None
    assert metrics.drift_percent is None
    assert metrics.nees is None
    assert metrics.heading_error_deg is None
    assert metrics.nis


def test_a_causal_estimate_with_sparse_keyframes_is_not_scored(
    caplog: pytest.LogCaptureFixture,
) -> None:
    solution = solutions.graph_solution()
    assert solution.online is not None
    sparse = replace(solution, online=solution.online.select(slice(None, None, 3)))
    with caplog.at_level(logging.WARNING, logger="gtsam_nav"):
        metrics = evaluate(sparse)
    assert metrics.ate_online is None
    assert metrics.ate == evaluate(solution).ate
    assert "keyframes that are at most 5 s apart" in caplog.text


def test_drift_is_the_last_error_over_the_distance() -> None:
    t, p_n = straight(101)
    drifting = p_n + np.column_stack([0 * t, 0.03 * t, 0 * t])
    drift = evaluate_trajectory(level(t, drifting), ReferenceSeries(t=t, p_n=p_n)).drift_percent
    assert drift == pytest.approx(3.0)


def test_noise_of_the_reference_does_not_add_up_to_distance() -> None:
    t = np.arange(0.0, 3000.0)
    p_n = np.column_stack([0.2 * t, 0 * t, 0 * t])
    noisy = p_n + np.random.default_rng(2).normal(size=p_n.shape)
    stated = ReferenceSeries(t=t, p_n=noisy, sigma=np.ones(len(t)))
    assert distance_m(stated)[-1] == pytest.approx(600.0, rel=0.2)
    assert distance_m(ReferenceSeries(t=t, p_n=noisy))[-1] > 3000.0


def test_distance_is_walked_in_steps_of_five_sigma_or_along_every_sample() -> None:
    p_n = np.array([[0.0, 0.0], [0.3, 0.4], [3.0, 0.4], [3.0, 4.0], [3.0, 4.1]])
    series = ReferenceSeries(t=np.arange(5.0), p_n=np.column_stack([p_n, np.zeros(5)]))
    np.testing.assert_allclose(distance_m(series), [0.0, 0.5, 3.2, 6.8, 6.9])
    # 5 m lie between the first sample and the fourth alone; time divides them
    stated = replace(series, sigma=np.ones(5))
    np.testing.assert_allclose(distance_m(stated), [0.0, 5 / 3, 10 / 3, 5.0, 5.0])


def test_heading_error_is_wrapped() -> None:
    t, p_n = straight(20)
    rpy = np.column_stack([0 * t, 0 * t, 0 * t + np.radians(179.0)])
    estimate = level(t, p_n, np.radians(-179.0))
    heading = evaluate_trajectory(
        estimate, ReferenceSeries(t=t, p_n=p_n, rpy=rpy)
    ).heading_error_deg
    assert heading is not None
    assert heading.max == pytest.approx(2.0)


def test_evaluate_takes_the_solutions_reference_or_another_or_none() -> None:
    solution = solutions.graph_solution()
    assert evaluate(solution) == evaluate(solution, solution.reference)
    other = solutions.reference(rate_hz=1.0, sigma_m=0.5)
    assert evaluate(solution, other) != evaluate(solution)
    unscored = evaluate(replace(solution, reference=None), None)
    assert unscored.ate.none is None
    assert unscored.coverage is None
    assert unscored.loops.proposed == len(solution.loops)
    with pytest.raises(ValueError, match="not a reference"):
        evaluate(solution, solution.mission.first("dvl"))


def test_the_document_has_the_keys_of_the_design_clock_offsets_and_relations() -> None:
    document = evaluate(solutions.graph_solution()).to_json()
    assert set(document) == {
        "ate", "ate_3d", "ate_online", "rpe", "drift_percent", "heading_error_deg", "nees", "nis",
        "coverage", "loops", "rejected", "n_keyframes", "sonar", "gnss_used", "gnss_withheld",
        "clock_offsets", "relations",
    }  # fmt: skip
    for key in ("ate", "ate_3d", "ate_online"):
        assert set(document[key]) == {"none", "start", "se2", "se3"}
        assert set(document[key]["none"]) == STATISTICS
        assert set(document[key]["start"]) == STATISTICS | {"stretch_s"}
        assert set(document[key]["se2"]) == STATISTICS | {"determinant"}
        assert set(document[key]["se3"]) == STATISTICS
    assert set(document["rpe"]) == {"10_m", "50_m", "10_percent"}
    assert set(document["rpe"]["10_m"]) == {"percent", "deg_per_m"}
    assert set(document["heading_error_deg"]) == STATISTICS
    consistency = {"mean", "dof", "lower95", "upper95", "fraction_inside"}
    assert set(document["nees"]) == consistency
    assert set(document["nis"]) == {"dvl", "depth"}
    assert set(document["nis"]["dvl"]) == consistency
    assert document["loops"] == {"proposed": 60, "accepted": 35, "rejected": 25}
    assert document["rejected"] == {"dvl": 9, "gnss": 2, "imu": 1}
    assert document["sonar"] == "simulated"


def test_the_document_reads_back_and_never_holds_nan() -> None:
    for solution in (
        solutions.graph_solution(),
        solutions.dr_solution(),
        replace(solutions.dr_solution(), reference=None),
    ):
        metrics = evaluate(solution)
        text = json.dumps(metrics.to_json(), allow_nan=False)
        assert Metrics.from_json(json.loads(text)) == metrics


def test_metrics_print_their_headline() -> None:
    text = str(evaluate(solutions.graph_solution()))
    assert "ate none" in text
    assert "coverage   1.000" in text
    unsure = evaluate(solutions.graph_solution())
    assert unsure.nees is not None
    assert f"nees       {unsure.nees.mean:.2f} (2 degrees of freedom)" in text
    assert "nees" not in str(replace(unsure, nees=None))


def test_evaluate_takes_a_mission_for_its_reference() -> None:
    solution = solutions.dr_solution()
    assert solution.reference is not None
    mission = Mission("truth", {"reference": solution.reference})
    assert evaluate(replace(solution, reference=None), mission) == evaluate(solution)


def test_without_a_score_the_reason_is_printed() -> None:
    assert "nothing to score on" in str(evaluate(replace(solutions.dr_solution(), reference=None)))
