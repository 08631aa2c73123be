"""Variants are compared on the missions that all of them finished."""

from __future__ import annotations

import pytest
from batch_rows import figures, frame, row

from gtsam_nav.batch.ranking import rank


def test_the_best_median_comes_first() -> None:
    errors = {"dr": (2.0, 3.0, 9.0), "graph": (1.0, 4.0, 2.0)}
    ranking = rank(
        frame(*(row(f"m{k}", m, e) for m, all_of in errors.items() for k, e in enumerate(all_of)))
    )
    graph, dr = ranking.variants
    assert (ranking.score, ranking.missions) == ("ate_none_mean_m", 3)
    assert (graph.name, graph.median, graph.worst, graph.wins) == ("graph", 2.0, 4.0, 2)
    assert (dr.name, dr.median, dr.mean, dr.wins) == ("dr", 3.0, pytest.approx(14 / 3), 1)
    assert graph.s_per_mission_h == pytest.approx(12.0)


def test_no_variant_gains_by_failing_on_the_hard_mission() -> None:
    rows = [row("easy", "a", 2.0), row("easy", "b", 1.0), row("hard", "b", 50.0)]
    ranking = rank(frame(*rows, row("hard", "a", cause="EstimationError")))
    assert ranking.missions == 1
    assert [(v.name, v.median, v.runs, v.failed) for v in ranking.variants] == [
        ("b", 1.0, 2, 0),
        ("a", 2.0, 2, 1),
    ]


def test_a_run_of_low_coverage_counts_as_failed() -> None:
    spoilt = row("m1", cause="low coverage", exit_code=0, figures=figures(ate_none_mean_m=0.1))
    (variant,) = rank(frame(row("m0", error_m=1.0), spoilt)).variants
    assert (variant.failed, variant.median) == (1, 1.0)


def test_settings_are_variants_too() -> None:
    rows = [row("m", sweep=f"seed={k}", error_m=1.0 + k) for k in (1, 0)]
    assert [v.name for v in rank(frame(*rows)).variants] == ["dr seed=0", "dr seed=1"]


def test_aligned_errors_rank_where_nothing_is_georeferenced() -> None:
    rows = [
        row("m", name, figures=figures(ate_se2_mean_m=e)) for name, e in (("a", 2.0), ("b", 1.0))
    ]
    ranking = rank(frame(*rows))
    assert (ranking.score, ranking.variants[0].name) == ("ate_se2_mean_m", "b")


def test_without_scores_there_is_no_ranking() -> None:
    ranking = rank(frame(row("m", error_m=None), row("n", cause="DataError")))
    assert (ranking.score, ranking.missions) == (None, 0)
    assert ranking.variants[0].median is None
