"""Tables of the command line: from typed results to something Rich can render."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from rich.table import Table
from rich.text import Text

from gtsam_nav.audit import Audit
from gtsam_nav.audit.findings import Finding
from gtsam_nav.batch.ranking import SCORES, Ranking
from gtsam_nav.doctor import PackageState
from gtsam_nav.evaluation.comparison import ComparisonRow
from gtsam_nav.readers.contents import Contents
from gtsam_nav.writers.run_comparison import SAME, Repetition


def _table(title: str, columns: Sequence[str], rows: Iterable[Sequence[str | Text]]) -> Table:
    """A plain table; a column whose name starts with '>' is right-aligned.

    Names come from files: brackets in them are no markup.
    """
    table = Table(
        title=Text(title), title_justify="left", title_style="bold", box=None, pad_edge=False
    )
    for name in columns:
        right = name.startswith(">")
        table.add_column(name.lstrip(">"), justify="right" if right else "left", overflow="fold")
    for row in rows:
        table.add_row(*(Text(cell) if isinstance(cell, str) else cell for cell in row))
    return table


def figure(value: float | None, digits: int = 2) -> str:
    """A number for a cell; a dash for what cannot be told."""
    return "-" if value is None else f"{value:.{digits}f}"


def sensor_table(found: Audit) -> Table:
    """Samples, rate, span and gaps of each sensor."""
    columns = (
        "sensor", "type", ">samples", ">rate Hz", ">from s", ">to s", ">gaps", ">longest s",
        ">dropped",
    )  # fmt: skip
    rows = [
        (
            s.name,
            f"{s.type} (simulated)" if s.simulated else s.type,
            str(s.n_samples),
            figure(s.rate_hz),
            figure(s.start_s, 1),
            figure(s.stop_s, 1),
            str(len(s.gaps)),
            figure(max((gap.length_s for gap in s.gaps), default=None), 1),
            str(sum(d.n_samples for d in s.dropped)),
        )
        for s in found.sensors
    ]
    return _table(f"Sensors of '{found.mission}'", columns, rows)


def stream_table(contents: Contents) -> Table:
    """The streams of a file, and what each could be."""
    columns = ("stream", "holds", ">messages", ">rate Hz", "could be", "clock")
    rows = [
        (
            s.name,
            s.type,
            "-" if s.n_messages is None else str(s.n_messages),
            figure(s.rate_hz, 1),
            ", ".join(s.could_be) or "-",
            s.clock,
        )
        for s in contents.streams
    ]
    return _table("Streams", columns, rows)


def finding_table(findings: Iterable[Finding]) -> Table:
    """What the checks found."""
    style = {"ok": "green", "warning": "bold yellow"}
    rows = [
        (Text(f.severity, style[f.severity]), f.check, f.sensor or "-", f.text) for f in findings
    ]
    return _table("Findings", ("", "check", "sensor", "what"), rows)


def comparison_tables(rows: Sequence[ComparisonRow]) -> list[Table | str]:
    """Runs side by side, and on surveyed relations where any has them."""
    tables: list[Table | str] = [comparison_table(rows)]
    return [*tables, "", relation_table(rows)] if any(row.relations for row in rows) else tables


def comparison_table(rows: Sequence[ComparisonRow]) -> Table:
    """Runs side by side; errors in metres, by alignment."""
    columns = (
        "run", ">none mean", ">rmse", ">max", ">start mean", ">SE2 mean", ">NEES", ">coverage",
        ">loops acc/prop", ">wall s",
    )  # fmt: skip
    cells = [
        (
            row.name,
            figure(row.ate_none_mean_m),
            figure(row.ate_none_rmse_m),
            figure(row.ate_none_max_m),
            figure(row.ate_start_mean_m),
            figure(row.ate_se2_mean_m),
            figure(row.nees_mean),
            figure(row.coverage, 3),
            f"{row.loops_accepted}/{row.loops_proposed}",
            figure(row.wall_s, 1),
        )
        for row in rows
    ]
    note = ", simulated sonar" if any(row.sonar == "simulated" for row in rows) else ""
    return _table(f"Horizontal error, m{note}", columns, cells)


def relation_table(rows: Sequence[ComparisonRow]) -> Table:
    """Errors of the runs on surveyed relations, those between far apart times being loops."""
    columns = ("run", "relations", ">number", ">median m", ">95 % m", ">median deg", ">95 % deg")
    cells = [
        (
            row.name,
            kind,
            str(errors.n),
            figure(errors.median_m, 3),
            figure(errors.p95_m, 3),
            figure(errors.median_deg),
            figure(errors.p95_deg),
        )
        for row in rows
        if row.relations is not None
        for kind, errors in (("near", row.relations.near), ("loops", row.relations.loops))
        if errors is not None
    ]
    return _table("Error of relative poses", columns, cells)


def ranking_table(ranking: Ranking) -> Table:
    """Methods and settings of a batch, best first."""
    columns = (
        "variant", ">runs", ">failed", ">median", ">mean", ">p95", ">worst", ">best on", ">NEES",
        ">s per mission hour",
    )  # fmt: skip
    rows = [
        (
            v.name,
            str(v.runs),
            str(v.failed),
            *map(figure, (v.median, v.mean, v.p95, v.worst)),
            str(v.wins),
            figure(v.nees_median),
            figure(v.s_per_mission_h, 1),
        )
        for v in ranking.variants
    ]
    score = "nothing to rank by" if ranking.score is None else SCORES[ranking.score]
    return _table(f"{score}, on {ranking.missions} missions", columns, rows)


def repetition_table(name: str, repetition: Repetition) -> Table:
    """The results of a run and how they differ in its repetition."""
    rows = [
        (file, Text(difference, "green" if difference == SAME else "bold yellow"))
        for file, difference in repetition.files.items()
    ]
    return _table(f"Repetition of {name}", ("result", "again"), rows)


def package_table(packages: Iterable[PackageState]) -> Table:
    """Dependencies and their state."""
    rows = []
    for package in packages:
        style = "green" if package.trouble is None else "yellow" if package.optional else "red"
        state = Text(package.trouble or "ok", style)
        rows.append((package.name, package.version or "-", state, package.purpose))
    return _table("Packages", ("package", "version", "state", "needed for"), rows)
