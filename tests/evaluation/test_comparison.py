"""Rows of the comparison."""

from __future__ import annotations

from dataclasses import replace

import solutions

from gtsam_nav.evaluation.comparison import compare, comparison_row
from gtsam_nav.evaluation.metrics import evaluate


def test_a_row_repeats_the_metrics() -> None:
    metrics = evaluate(solutions.graph_solution())
    row = comparison_row("graph", metrics, wall_s=12.5)
    assert metrics.ate.none is not None
    assert metrics.ate.se2 is not None
    assert metrics.ate_online is not None
    assert metrics.ate_online.none is not None
    assert row.ate_none_rmse_m == metrics.ate.none.rmse
    assert row.ate_se2_mean_m == metrics.ate.se2.mean
    assert row.online_none_mean_m == metrics.ate_online.none.mean
    assert (row.loops_accepted, row.loops_proposed) == (35, 60)
    assert row.n_rejected == 12
    assert row.wall_s == 12.5
    assert row.sonar == "simulated"
    assert not row.failed


def test_what_cannot_be_told_is_none() -> None:
    unscored = replace(solutions.dr_solution(), reference=None)
    row = comparison_row("dr", evaluate(unscored))
    assert row.ate_none_mean_m is None
    assert row.online_se2_mean_m is None
    assert row.coverage is None
    assert row.wall_s is None
    assert not row.failed


def test_a_run_that_stops_early_has_failed() -> None:
    whole = solutions.dr_solution()
    short = replace(whole, trajectory=whole.trajectory.select(slice(0, 5000)))
    assert comparison_row("dr", evaluate(short)).failed


def test_a_single_solution_is_a_comparison_of_one() -> None:
    solution = solutions.dr_solution()
    assert compare(solution) == compare([solution])
