"""The summary of a batch: one self-contained page on ranking, distributions, failures and cost."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree.ElementTree import Element

from gtsam_nav.batch.markup import element, page, table
from gtsam_nav.batch.ranking import SCORES, Ranking, Variant, rank
from gtsam_nav.batch.strips import strip_chart
from gtsam_nav.errors import OutputError
from gtsam_nav.writers.atomic import replacing_file

if TYPE_CHECKING:
    import pandas as pd

MOST_WORST = 30
"""Runs that the page lists, worst first, and of those without a score; the table has all."""

LONGEST_MESSAGE = 300
"""Characters of an error that the page shows; the table has all."""

NUMBER = re.compile(r"(?<![\w.])(?<![A-Za-z]-)(?!0\d)\d+(\.\d+)?(e[-+]?\d+)?(?!\w)")
"""One that stands alone: not the digits of utf-8, x1 or NMEA 0183."""


@dataclass(frozen=True)
class FailureGroup:
    """Failures of one cause whose messages differ by no more than names and numbers."""

    cause: str
    message: str
    methods: tuple[str, ...]
    missions: tuple[str, ...]


def write_summary(results: pd.DataFrame, path: Path) -> None:
    """Write the page of a batch's table.

    Raises
    ------
    OutputError
        Where it cannot be written.
    """
    css = files("gtsam_nav.batch").joinpath("summary.css").read_text(encoding="utf-8")
    ranking = rank(results)
    sections = (
        *_header(results),
        _ranking(ranking, results),
        _distributions(ranking, results),
        _failures(results),
        _cost(results),
        _worst(ranking, results, path.parent),
        _provenance(results),
    )
    try:
        with replacing_file(path) as draft:
            draft.write_text(page("Batch summary", css, *sections), encoding="utf-8", newline="\n")
    except OSError as error:
        raise OutputError(f"{path}: cannot write the summary: {error}") from error


def failure_groups(results: pd.DataFrame) -> list[FailureGroup]:
    """Failures by cause and message, the most frequent first."""
    groups: dict[tuple[str, str], list[tuple[str, str]]] = {}
    for row in results[results["cause"].notna()].itertuples():
        message = _generic(str(row.error or ""), str(row.path), str(row.mission))
        groups.setdefault((str(row.cause), message), []).append((str(row.method), str(row.mission)))
    return sorted(
        (
            FailureGroup(
                cause,
                message,
                tuple(dict.fromkeys(method for method, _ in runs)),
                tuple(dict.fromkeys(mission for _, mission in runs)),
            )
            for (cause, message), runs in groups.items()
        ),
        key=lambda group: -len(group.missions),
    )


def _generic(message: str, path: str, mission: str) -> str:
    """A message without what differs between missions that fail alike."""
    for name in (path, mission):
        message = message.replace(name, "MISSION")
    return NUMBER.sub("#", message)


def _section(title: str, *content: Element | str | None) -> Element:
    return element("section", element("h2", title), *content)


def _figure(value: float | None, digits: int = 2) -> str:
    return "–" if value is None or value != value else f"{value:.{digits}f}"


def _header(results: pd.DataFrame) -> Iterator[Element]:
    failed = int(results["cause"].notna().sum())
    hours = results["mission_s"].sum() / 3600.0
    facts = [
        f"{results['path'].nunique()} missions",
        f"{len(results)} runs",
        f"{failed} failed",
        f"{hours:.1f} h of data estimated",
    ]
    yield element("h1", "Batch summary")
    yield element("ul", *(element("li", fact) for fact in facts), class_="chips")
    if (results["sonar"] == "simulated").any():
        text = "Simulated sonar: figures of these missions do not compare with published ones."
        yield element("p", text, class_="banner")


def _ranking(ranking: Ranking, results: pd.DataFrame) -> Element:
    if ranking.score is None:
        note = "No mission has a score under every variant: nothing to rank by."
    else:
        left_out = results["path"].nunique() - ranking.missions
        note = (
            f"By the median over missions of the {SCORES[ranking.score]}. Compared on the "
            f"{ranking.missions} missions that every variant finished and that have a reference"
            f"{f', {left_out} left out' if left_out else ''}."
        )
    header = (
        "variant", "runs", "failed", "median", "mean", "p95", "worst", "best on", "NEES",
        "s per mission hour",
    )  # fmt: skip

    def cells(v: Variant) -> list[str]:
        errors = [_figure(x) for x in (v.median, v.mean, v.p95, v.worst)]
        wins = str(v.wins) if ranking.missions else "–"
        ending = [wins, _figure(v.nees_median), _figure(v.s_per_mission_h, 1)]
        return [v.name, str(v.runs), str(v.failed), *errors, *ending]

    shown = table(header, map(cells, ranking.variants), names=1)
    return _section("Ranking", element("p", note, class_="note"), shown)


def _distributions(ranking: Ranking, results: pd.DataFrame) -> Element | None:
    good = results[results["cause"].isna()]
    charts: list[Element] = []
    for column, title in {**SCORES, "nees_mean": "mean NEES (2 is calibrated)"}.items():
        values = {
            v.name: list(_values(good, v, column))
            for v in ranking.variants  # in the order of the ranking
        }
        chart = strip_chart(values)
        if chart is not None:
            charts += [element("h3", title[0].upper() + title[1:]), chart]
    if not charts:
        return None
    note = "A dot a mission (its name on hovering), a box over the quartiles, a line at the median."
    return _section("Distributions", element("p", note, class_="note"), *charts)


def _values(good: pd.DataFrame, variant: Variant, column: str) -> Iterator[tuple[str, float]]:
    mine = good[(good["method"] == variant.method) & (good["sweep"] == variant.sweep)]
    known = mine[mine[column].notna()]
    yield from zip(known["mission"], map(float, known[column]), strict=True)


def _failures(results: pd.DataFrame) -> Element:
    groups = failure_groups(results)
    if not groups:
        return _section("Failures by cause", element("p", "None."))
    rows = [
        (g.cause, _short(g.message), ", ".join(g.methods), _few(g.missions), str(len(g.missions)))
        for g in groups
    ]
    header = ("cause", "message", "methods", "which", "missions")
    return _section("Failures by cause", table(header, rows, names=4))


def _short(text: str) -> str:
    return text if len(text) <= LONGEST_MESSAGE else f"{text[: LONGEST_MESSAGE - 1]}…"


def _few(names: tuple[str, ...], most: int = 5) -> str:
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


def _cost(results: pd.DataFrame) -> Element:
    rows = []
    for method, runs in results[results["exit_code"] == 0].groupby("method"):
        hours = runs["mission_s"].sum() / 3600.0
        wall, cpu = (runs[name].sum() / hours if hours else None for name in ("wall_s", "cpu_s"))
        slowest, memory = runs["wall_s"].max(), runs["worker_peak_mb"].max()
        rows.append(
            (str(method), _figure(wall, 1), _figure(cpu, 1), _figure(slowest, 1), f"{memory:.0f}")
        )
    header = (
        "method", "wall s per mission hour", "CPU s per mission hour", "slowest run s",
        "largest worker MB",
    )  # fmt: skip
    note = "Of runs that finished. A worker's memory is the most it held in all its runs so far."
    return _section("Cost", table(header, rows, names=1), element("p", note, class_="note"))


def _worst(ranking: Ranking, results: pd.DataFrame, folder: Path) -> Element | None:
    """The runs that finished: those with a score, worst first, then those without one."""
    good = results[results["cause"].isna()]
    if good.empty:
        return None

    def cells(run: dict[str, Any], error: str) -> list[Element | str]:
        link = element("a", str(run["mission"]), href=_link(str(run["folder"]), folder))
        variant = f"{run['method']} {run['sweep']}".strip()
        rest = (_figure(run["nees_mean"]), _figure(run["coverage"], 3), _figure(run["wall_s"], 1))
        return [link, variant, error, *rest]

    score, rows, unscored = ranking.score, list[list[Element | str]](), good
    if score is not None:
        worst = good[good[score].notna()].sort_values(score, ascending=False)
        rows += [cells(run, _figure(run[score])) for run in _first(worst)]
        unscored = good[good[score].isna()]
    rows += [cells(run, "no score") for run in _first(unscored)]
    error = "score" if score is None else SCORES[score]
    header = ("mission", "variant", error, "NEES", "coverage", "wall s")
    every = len(rows) == len(good)
    title = "All runs, worst first" if every else f"The {MOST_WORST} worst runs"
    more = len(unscored) - MOST_WORST
    note = element("p", f"{more} more have no score.", class_="note") if more > 0 else None
    return _section(title, table(header, rows, names=2), note)


def _first(runs: pd.DataFrame) -> list[dict[str, Any]]:
    return runs.head(MOST_WORST).to_dict("records")  # type: ignore[return-value]


def _link(run: str, folder: Path) -> str:
    path = Path(run)
    return path.relative_to(folder).as_posix() if path.is_relative_to(folder) else path.as_uri()


def _provenance(results: pd.DataFrame) -> Element:
    """Versions; more than one set of them means that results of different software are mixed."""
    versions = [json.loads(text) for text in results["versions"].dropna().unique()]
    lines = [", ".join(f"{name} {number}" for name, number in v.items()) for v in versions]
    mixed = element("p", "The runs were made with different versions.", class_="banner")
    return _section(
        "Versions",
        mixed if len(lines) > 1 else None,
        element("ul", *(element("li", line) for line in lines)),
    )
