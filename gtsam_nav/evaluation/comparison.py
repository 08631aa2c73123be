"""Runs side by side: one typed row each, for the command line and the report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gtsam_nav.evaluation.metrics import Metrics, evaluate
from gtsam_nav.evaluation.relations import RelationScores
from gtsam_nav.evaluation.statistics import AbsoluteErrors
from gtsam_nav.mission import SonarKind
from gtsam_nav.solution import Solution, listed


@dataclass(frozen=True, kw_only=True)
class ComparisonRow:
    """The figures by which runs are compared; None where one cannot be told.

    ``ate_*_m`` is the horizontal error by alignment and statistic, m; ``online_*`` that of the
    causal estimate; ``failed`` says that the coverage is below `metrics.LEAST_COVERAGE`;
    ``relations`` are the errors of surveyed ones.
    """

    name: str
    ate_none_mean_m: float | None
    ate_none_rmse_m: float | None
    ate_none_max_m: float | None
    ate_start_mean_m: float | None
    ate_se2_mean_m: float | None
    online_none_mean_m: float | None
    online_se2_mean_m: float | None
    rpe_10_m_percent: float | None
    nees_mean: float | None
    relations: RelationScores | None
    coverage: float | None
    failed: bool
    loops_accepted: int
    loops_proposed: int
    n_rejected: int
    sonar: SonarKind | None
    wall_s: float | None


def comparison_row(name: str, metrics: Metrics, wall_s: float | None = None) -> ComparisonRow:
    """The row of one run."""
    ate = metrics.ate
    online = metrics.ate_online or AbsoluteErrors()
    return ComparisonRow(
        name=name,
        ate_none_mean_m=ate.none.mean if ate.none else None,
        ate_none_rmse_m=ate.none.rmse if ate.none else None,
        ate_none_max_m=ate.none.max if ate.none else None,
        ate_start_mean_m=ate.start.mean if ate.start else None,
        ate_se2_mean_m=ate.se2.mean if ate.se2 else None,
        online_none_mean_m=online.none.mean if online.none else None,
        online_se2_mean_m=online.se2.mean if online.se2 else None,
        rpe_10_m_percent=metrics.rpe.per_10_m.percent if metrics.rpe.per_10_m else None,
        nees_mean=metrics.nees.mean if metrics.nees else None,
        relations=metrics.relations,
        coverage=metrics.coverage,
        failed=metrics.failed,
        loops_accepted=metrics.loops.accepted,
        loops_proposed=metrics.loops.proposed,
        n_rejected=sum(metrics.rejected.values()),
        sonar=metrics.sonar,
        wall_s=wall_s,
    )


def compare(solutions: Solution | Sequence[Solution]) -> list[ComparisonRow]:
    """Solutions side by side, in their order, each scored on what it may be scored on."""
    return [comparison_row(solution.method, evaluate(solution)) for solution in listed(solutions)]
