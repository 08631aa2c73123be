"""Methods and settings of a batch against each other, on the missions that all of them finished."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd

SCORES = {
    "ate_none_mean_m": "mean horizontal error, m",
    "ate_start_mean_m": "mean horizontal error aligned on the first 30 m, m",
    "ate_se2_mean_m": "mean horizontal error after SE(2) alignment, m",
}
"""What can be ranked by, best first: a column of the table, and its name for people."""


@dataclass(frozen=True, kw_only=True)
class Variant:
    """One method under one combination of swept settings; None where it cannot be told.

    Attributes
    ----------
    method, sweep : str
    runs, failed : int
        Of all its missions.
    median, mean, p95, worst : float or None
        Of the score over the compared missions, m.
    wins : int
        Compared missions on which it was the best.
    nees_median : float or None
        Over the compared missions.
    s_per_mission_h : float or None
        Wall time over the span of the missions, all that finished.
    """

    method: str
    sweep: str
    runs: int
    failed: int
    median: float | None = None
    mean: float | None = None
    p95: float | None = None
    worst: float | None = None
    wins: int = 0
    nees_median: float | None = None
    s_per_mission_h: float | None = None

    @property
    def name(self) -> str:
        """Method and settings, for people."""
        return f"{self.method} {self.sweep}".strip()


@dataclass(frozen=True)
class Ranking:
    """Variants, best median first.

    Attributes
    ----------
    score : str or None
        Column of the table; None where no mission has one for every variant.
    missions : int
        How many are compared: those with a score, and a good run, for every variant.
    variants : tuple of Variant
    """

    score: str | None
    missions: int
    variants: tuple[Variant, ...]


def rank(results: pd.DataFrame) -> Ranking:
    """Rank the variants of a batch.

    Only missions that every variant finished are compared, so that none gains by failing on the
    hard ones. Of `SCORES` that one is taken which most missions have; the first among equals.
    """
    good = results[results["cause"].isna()]
    variants = results[["method", "sweep"]].drop_duplicates()
    tables = {score: _complete(good, score, len(variants)) for score in SCORES}
    score, scores = max(tables.items(), key=lambda item: len(item[1]))
    best = scores.min(axis="columns")
    ranked = [
        _variant(results, good, scores, best, str(method), str(sweep))
        for method, sweep in variants.itertuples(index=False)
    ]
    ranked.sort(key=lambda v: (v.median is None, v.median or 0.0, v.name))
    return Ranking(score if len(scores) else None, len(scores), tuple(ranked))


def _complete(good: pd.DataFrame, score: str, n_variants: int) -> pd.DataFrame:
    """Scores of the missions that every variant has: a mission a row, a variant a column."""
    scores = good.pivot_table(score, "path", ["method", "sweep"], dropna=False).dropna()
    return scores if scores.shape[1] == n_variants else scores.iloc[:0]


def _variant(
    results: pd.DataFrame,
    good: pd.DataFrame,
    scores: pd.DataFrame,
    best: pd.Series,
    method: str,
    sweep: str,
) -> Variant:
    def own(rows: pd.DataFrame) -> pd.DataFrame:
        return rows[(rows["method"] == method) & (rows["sweep"] == sweep)]

    mine, finished = own(results), own(good)
    counts = {"runs": len(mine), "failed": len(mine) - len(finished)}
    hours = finished["mission_s"].sum() / 3600.0
    cost = float(finished["wall_s"].sum() / hours) if hours > 0.0 else None
    if scores.empty:
        return Variant(method=method, sweep=sweep, s_per_mission_h=cost, **counts)
    score = scores[(method, sweep)]
    nees = finished[finished["path"].isin(scores.index)]["nees_mean"].dropna()
    return Variant(
        method=method,
        sweep=sweep,
        **counts,
        median=float(score.median()),
        mean=float(score.mean()),
        p95=float(score.quantile(0.95)),
        worst=float(score.max()),
        wins=int((score == best).sum()),
        nees_median=float(nees.median()) if len(nees) else None,
        s_per_mission_h=cost,
    )
