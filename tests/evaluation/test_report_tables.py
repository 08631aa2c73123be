"""The report's tables: which figure stands in which cell, and a dash where there is none."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import solutions

from gtsam_nav.evaluation import report_tables as tables
from gtsam_nav.evaluation.html import Html
from gtsam_nav.evaluation.metrics import Metrics, evaluate
from gtsam_nav.evaluation.relations import RelationErrors, RelationScores
from gtsam_nav.solution import ClockOffset, RobustWeights
from gtsam_nav.writers.run_record import RunRecord


@pytest.fixture(scope="module")
def graph() -> Metrics:
    return evaluate(solutions.graph_solution())


@pytest.fixture(scope="module")
def unscored() -> Metrics:
    return evaluate(replace(solutions.graph_solution(), reference=None, innovations={}))


def rows(table: Html) -> list[list[str]]:
    """Texts of the cells of each row of a table's body."""
    (body,) = re.findall(r"<tbody>(.*)</tbody>", table)
    return [
        [re.sub("<[^>]*>", "", cell) for cell in re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row)]
        for row in re.findall(r"<tr[^>]*>(.*?)</tr>", body)
    ]


@pytest.mark.parametrize(
    "make",
    [
        lambda m: tables.summary_table({"graph": m}, {}),
        lambda m: tables.drift_table({"graph": m}),
        lambda _: tables.timing_table({"graph": RECORD}),
    ],
    ids=["summary", "drift", "timing"],
)
def test_groups_span_all_the_columns(graph: Metrics, make: Callable[[Metrics], Html]) -> None:
    table = make(graph)
    groups, header = re.findall(r"<tr>(.*?)</tr>", table)[:2]
    spans = [int(span) for span in re.findall(r'colspan="(\d+)"', groups)]
    assert min(spans) >= 1
    assert sum(spans) == header.count("<th") == len(rows(table)[0])


RECORD = RunRecord(
    method="graph",
    mission="m",
    origin=None,
    start_utc=None,
    sonar=None,
    georeferenced=True,
    seed=0,
    command=None,
    versions={},
    sources={"b": "2", "a": "1"},
    wall_s=20.0,
    mission_s=600.0,
    realtime_factor=30.0,
    stage_s={"graph": 6.5, "scans": 1.25},
    warnings=(),
    skipped={},
)


def test_the_summary_has_the_headline_of_estimate_and_causal_one(graph: Metrics) -> None:
    own, causal = rows(tables.summary_table({"graph": graph}, {"graph": RECORD}))
    none, start, se2 = graph.ate.none, graph.ate.start, graph.ate.se2
    assert none
    assert start
    assert se2
    assert graph.rpe.per_10_m
    assert graph.nees
    figures = (none.mean, none.rmse, none.max, start.mean, se2.mean)
    assert own[:6] == ["graph", *(f"{figure:.2f}" for figure in figures)]
    assert own[6:] == [
        f"{graph.rpe.per_10_m.percent:.1f}",
        f"{graph.nees.mean:.2f}",
        f"{graph.coverage:.3f}",
        "35 of 60",
        "20.0",
    ]
    assert graph.ate_online
    assert graph.ate_online.none
    assert causal[:2] == ["graph, causal", f"{graph.ate_online.none.mean:.2f}"]
    assert causal[6:] == [tables.DASH] * 5


def test_what_is_not_scored_is_a_dash(unscored: Metrics) -> None:
    (row,) = rows(tables.summary_table({"dr": unscored}, {}))
    assert row == ["dr", *[tables.DASH] * 8, "35 of 60", tables.DASH]
    (row,) = rows(tables.drift_table({"dr": unscored}))
    assert row == ["dr", *[tables.DASH] * 10]
    assert rows(tables.consistency_table({"dr": unscored})) == []


def test_errors_are_told_by_alignment_for_plane_space_and_causal(graph: Metrics) -> None:
    found = rows(tables.error_table({"graph": graph}))
    assert [row[0] for row in found[::4]] == ["graph", "graph, 3-D", "graph, causal"]
    assert [row[1] for row in found[:4]] == ["no alignment", "start", "SE(2)", "SE(3)"]
    assert graph.ate.none
    assert found[0][2:] == [f"{getattr(graph.ate.none, key):.2f}" for key in tables.STATISTICS]
    plane = replace(graph, ate_3d=None, ate_online=None)
    assert len(rows(tables.error_table({"graph": plane}))) == 4


def test_drift_by_length_and_heading(graph: Metrics) -> None:
    (row,) = rows(tables.drift_table({"graph": graph}))
    segments = graph.rpe.per_10_m, graph.rpe.per_50_m, graph.rpe.per_10_percent
    for k, segment in enumerate(segments):
        assert segment
        assert row[1 + 2 * k : 3 + 2 * k] == [f"{segment.percent:.2f}", f"{segment.deg_per_m:.3f}"]
    heading = graph.heading_error_deg
    assert heading
    figures = (graph.drift_percent, heading.mean, heading.rmse, heading.max)
    assert row[7:] == [f"{figure:.2f}" for figure in figures]


def test_consistency_of_the_position_comes_first(graph: Metrics) -> None:
    found = rows(tables.consistency_table({"graph": graph}))
    assert [row[:2] for row in found] == [
        ["graph", "position (NEES)"],
        ["", "depth (NIS)"],
        ["", "dvl (NIS)"],
    ]
    c = graph.nis["dvl"]
    inside = f"{100 * c.fraction_inside:.0f} %"
    bounds = f"{c.lower95:.2f} to {c.upper95:.2f}"
    assert found[2][2:] == [f"{c.mean:.2f}", "3", bounds, inside]


def test_reasons_count_together_whatever_their_figures() -> None:
    found = rows(tables.rejection_table([solutions.graph_solution(), solutions.dr_solution()]))
    assert ["dvl", "no bottom lock", "9", "4"] in found
    assert ["gnss", "gate, nis &gt; …", "2", "0"] in found
    loops = rows(tables.loop_table(solutions.graph_solution()))
    assert loops[0] == ["accepted", tables.DASH, "35"]
    assert sum(int(row[2]) for row in loops) == 60


def test_relations_near_and_far() -> None:
    near = RelationErrors(n=9, median_m=0.1, median_deg=0.2, p95_m=0.3, p95_deg=0.4)
    plain = evaluate(replace(solutions.dr_solution(), reference=None))
    metrics = {
        "graph": replace(plain, relations=RelationScores(near=near, loops=None)),
        "dr": replace(plain, relations=None),
    }
    assert rows(tables.relation_table(metrics)) == [
        ["graph", "near", "9", "0.100", "0.300", "0.200", "0.400"]
    ]


def test_files_and_stages() -> None:
    (row,) = rows(tables.timing_table({"graph": RECORD}))
    assert row == ["graph", "600.0", "20.0", "30", "6.50", "1.25"]
    bare = tables.timing_table({"graph": replace(RECORD, stage_s={})})
    assert "colspan" not in bare
    assert rows(tables.source_table(RECORD)) == [["a", "1"], ["b", "2"]]


def test_clock_offsets_to_a_tenth_of_a_millisecond(unscored: Metrics) -> None:
    offsets = (
        ClockOffset("gnss", "velocity_lag", -0.12345, 0.00123, 0.5),
        ClockOffset("imu", "time_offset", 0.0, 0.5, 0.5),
    )
    assert rows(tables.clock_table({"graph": replace(unscored, clock_offsets=offsets)})) == [
        ["graph", "gnss", "velocity lag", "-0.1235", "0.0012", "yes"],
        ["graph", "imu", "time offset", "0.0000", "0.5000", "no"],
    ]


def test_weights_by_sensor() -> None:
    weight, residual = np.array([0.0, 0.25, 0.5, 1.0, 1.0, 1.0]), np.array([9, 4, 2, 1, 0.5, 0.1])
    weights = {"dvl": RobustWeights("huber", np.arange(6.0), residual, weight)}
    weights["gnss"] = RobustWeights("none", np.arange(2.0), np.ones(2), np.ones(2))
    weighed = replace(solutions.graph_solution(), robust_weights=weights)
    assert rows(tables.weight_table([weighed])) == [
        ["graph", "dvl", "huber", "6", "16.7", "33.3", "0.62", "1.50"],
        ["", "gnss", "none", "2", "0.0", "0.0", "1.00", "1.00"],
    ]


def test_fixes_used_and_withheld(graph: Metrics) -> None:
    assert rows(tables.gnss_table({"graph": graph})) == [["graph", "60", "540"]]
