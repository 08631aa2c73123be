"""The sections of the report, each of what several solutions of a mission say."""

from __future__ import annotations

import base64
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gtsam_nav.config import Config
from gtsam_nav.evaluation import plots
from gtsam_nav.evaluation import report_tables as tables
from gtsam_nav.evaluation.histories import foremost
from gtsam_nav.evaluation.html import Html, element, join
from gtsam_nav.evaluation.metrics import LEAST_COVERAGE, Metrics
from gtsam_nav.evaluation.page.columns import Document
from gtsam_nav.evaluation.page.skeleton import sonar_viewer, workbench
from gtsam_nav.evaluation.weakness import LEAST_WEAK_M, WEAK
from gtsam_nav.solution import Solution
from gtsam_nav.writers.run_record import RunRecord

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Report:
    """What the sections draw on."""

    solutions: Sequence[Solution]
    config: Config
    metrics: dict[str, Metrics]
    whole: dict[str, Metrics]
    records: dict[str, RunRecord]
    document: Document
    plots_folder: Path

    @property
    def simulated(self) -> str:
        """What of the data is simulated; empty of recorded ones."""
        if any(m.sonar == "simulated" for m in self.metrics.values()):
            return "simulated sonar"
        clouds = self.solutions[0].mission.of_type("clouds")
        return "simulated lidar" if any(sensor.simulated for sensor in clouds) else ""

    def beside(self, name: str, made: Figure | None) -> Path | None:
        """Write a figure beside the page; None where there is none."""
        if made is None:
            return None
        return plots.save_png(made, self.plots_folder / f"{name}.png")

    def figure(self, name: str, made: Figure | None, caption: str) -> Html:
        """A figure, written beside the page and embedded in it; nothing where there is none."""
        path = self.beside(name, made)
        if path is None:
            return Html("")
        source = f"data:image/png;base64,{base64.b64encode(path.read_bytes()).decode('ascii')}"
        image = element("img", src=source, alt=caption)
        return element("figure", image, element("figcaption", caption))


def _section(title: str | Html, *content: str | Html) -> Html:
    kept = [piece for piece in content if piece]
    return element("section", element("h2", title), *kept) if kept else Html("")


def _scored_title(report: Report, title: str) -> Html:
    """A heading over figures; those of a simulated sonar or lidar say so."""
    label = element("span", report.simulated, class_="label") if report.simulated else Html("")
    return join([title, label])


def _header(report: Report) -> Html:
    mission, config = report.solutions[0].mission, report.config
    begin, end = mission.span_s
    facts = [f"{end - begin:.0f} s of data"]
    if mission.start_utc is not None:
        start = datetime.fromtimestamp(mission.start_utc, UTC)
        facts.append(f"starts {start:%Y-%m-%d %H:%M:%S} UTC")
    if mission.origin is not None:
        facts.append(
            f"origin {mission.origin.latitude_deg:.6f}°, {mission.origin.longitude_deg:.6f}°"
        )
    reference = report.solutions[0].reference
    facts.append(f"scored on {reference.name}" if reference else "nothing to score on")
    if config.evaluation.window_s is not None:
        first, last = config.evaluation.window_s
        facts.append(f"scored window {first:g} to {last:g} s")
    chips = [element("li", fact) for fact in facts]
    if report.simulated:
        chips.append(element("li", report.simulated, class_="simulated"))
    return join(
        [
            element("h1", mission.name),
            element("p", f"Methods: {', '.join(report.metrics)}", class_="muted"),
            element("ul", *chips, class_="chips"),
        ]
    )


def _banners(report: Report) -> Html:
    pieces = [
        element(
            "div",
            f"The run of {name} failed: it covers {100 * m.coverage:.1f} % of what is scored "
            f"({100 * LEAST_COVERAGE:.0f} % is the least).",
            class_="banner failed",
        )
        for name, m in report.metrics.items()
        if m.failed and m.coverage is not None
    ]
    warnings = {
        warning: None
        for solution in report.solutions
        for warning in (*solution.mission.warnings, *solution.warnings)
    }
    faults = dict.fromkeys(fault for s in report.solutions for fault in s.mission.faults)
    if faults:
        items = element("ul", *(element("li", fault) for fault in faults))
        text = "Faults were injected into what the methods saw, not into what they are scored on:"
        pieces.append(element("div", text, items, class_="banner warnings"))
    doubts = [
        f"{name}: NEES {m.nees.mean:.2g} where {m.nees.dof} is calibrated: {m.nees.doubt}"
        for name, m in report.metrics.items()
        if m.nees is not None and m.nees.doubt
    ]
    if warnings or doubts:
        items = element("ul", *(element("li", text) for text in (*doubts, *warnings)))
        pieces.append(element("div", "Take note:", items, class_="banner warnings"))
    return join(pieces)


def _summary(report: Report) -> Html:
    relations = _relations(report)
    if all(s.reference is None for s in report.solutions):
        if relations:
            return _section("Scores", *relations)
        why = "Every score is empty: the mission has no reference, and no GNSS fix was withheld."
        return _section("Scores", element("p", why))
    note = (
        "Horizontal error of the estimate at the reference's times and antenna. "
        "Start: aligned on the first 30 m, which are not scored. Never scaled. "
        "rpe 10 m: error over each 10 m of path, in percent of it. NEES: 2 is calibrated."
    )
    if not all(s.georeferenced for s in report.solutions):
        note += " Without an absolute start, errors without alignment are left empty."
    for s in report.solutions:
        if s.online is not None and s.reference and report.metrics[s.method].ate_online is None:
            note += f" The causal estimate of {s.method} is not scored: keyframes too far apart."
    pieces = [
        tables.summary_table(report.metrics, report.records),
        element("p", note, class_="note"),
    ]
    if report.whole:
        pieces += [
            element("h3", "The same over the whole reference, inside and outside the window"),
            tables.summary_table(report.whole, report.records),
        ]
    return _section(_scored_title(report, "Scores"), *pieces, *relations)


def _relations(report: Report) -> list[Html]:
    """Errors on surveyed relations, where the mission has any."""
    if not any(m.relations for m in report.metrics.values()):
        return []
    note = "Errors of relative poses between two times; those far apart are loops."
    return [
        element("h3", "Surveyed relations"),
        tables.relation_table(report.metrics),
        element("p", note, class_="note"),
    ]


def _plan(report: Report) -> Html:
    title = _scored_title(report, "Plan and time")
    return _section(title, workbench(), *(_landmarks(s) for s in report.solutions))


def _scans(report: Report) -> Html:
    return sonar_viewer(report.document["sonar"])


def _landmarks(solution: Solution) -> Html:
    """How many landmarks a solution holds and how sure it is of them; nothing where it has none."""
    found = solution.landmarks
    if found is None or not len(found.id):
        return Html("")
    sigma = np.sqrt(np.linalg.eigvalsh(found.cov_n[:, :2, :2])[:, 1])
    text = (
        f"{solution.method}: {len(found.id)} landmarks; horizontal sigma along the longest axis "
        f"{np.median(sigma):.2f} m (median), {np.max(sigma):.2f} m (largest)."
    )
    return element("p", text, class_="note")


def _errors(report: Report) -> Html:
    if all(s.reference is None for s in report.solutions):
        return Html("")
    return _section(
        _scored_title(report, "Errors"),
        element("h3", "Absolute error (m)"),
        tables.error_table(report.metrics),
        element("h3", "Relative error, drift and heading"),
        tables.drift_table(report.metrics),
    )


def _consistency(report: Report) -> Html:
    if not any(m.nees or m.nis for m in report.metrics.values()):
        return Html("")
    note = (
        "Squared errors over what the method says of itself. A mean above the expected one is "
        "overconfidence, below it caution."
    )
    for name, m in report.metrics.items():
        if m.nees is not None and m.nees.doubt:
            note += f" {name}: {m.nees.doubt}."
    caption = (
        "Squared position error over its covariance; 95 % of honest ones lie between the lines."
    )
    figures = [report.figure("nees", plots.mission_nees(report.solutions), caption)]
    for s in report.solutions:
        caption = f"{s.method}: mean innovation squared by sensor, 1 is honest; 95 % bounds."
        figures.append(report.figure(f"nis_{s.method}", plots.mission_nis(s), caption))
    return _section(
        "Consistency",
        tables.consistency_table(report.metrics),
        element("p", note, class_="note"),
        *figures,
    )


def _weakness(report: Report) -> Html:
    made = plots.position_sigma(report.solutions)
    if made is None:
        return Html("")
    caption = (
        "Sigma of the position along the longest axis of its error ellipse; shaded where it is "
        f"more than {WEAK:g} times the mission's median, and {LEAST_WEAK_M:g} m."
    )
    return _section(
        "Where the mission was weakly constrained",
        report.figure("position_sigma", made, caption),
        tables.weak_table(report.solutions),
    )


def _loops(report: Report) -> Html:
    pieces: list[Html] = []
    for s in report.solutions:
        made = plots.loop_verdicts(s)
        if made is not None:
            caption = f"{s.method}: every candidate loop closure, by time and by match."
            pieces += [report.figure(f"loops_{s.method}", made, caption), tables.loop_table(s)]
    return _section("Loop closures", *pieces)


def _sensors(report: Report) -> Html:
    pieces: list[Html] = []
    made = plots.sensor_timeline(foremost(report.solutions))
    if made is not None:
        caption = "Every sensor's samples; gaps are white, red was not used."
        pieces.append(report.figure("sensor_timeline", made, caption))
    pieces += [element("h3", "GNSS"), tables.gnss_table(report.metrics)]
    if any(s.robust_weights for s in report.solutions):
        note = (
            "A kernel leaves a measurement the share of its information that its weight says; what "
            "failed a gate has none. Many low weights mean that a sensor and the others disagree."
        )
        pieces += [
            element("h3", "Robust weights at the solution"),
            tables.weight_table(report.solutions),
            element("p", note, class_="note"),
        ]
    if any(m.clock_offsets for m in report.metrics.values()):
        pieces += [element("h3", "Clock offsets found"), tables.clock_table(report.metrics)]
    if any(s.rejections for s in report.solutions):
        pieces += [
            element("h3", "Measurements that were not used"),
            tables.rejection_table(report.solutions),
        ]
    return _section("Sensors", *pieces)


def _provenance(report: Report) -> Html:
    pieces: list[Html] = []
    if report.records:
        record = next(iter(report.records.values()))
        versions = ", ".join(f"{name} {version}" for name, version in record.versions.items())
        pieces += [
            element("h3", "Time"),
            tables.timing_table(report.records),
            element("h3", "Provenance"),
            element("p", f"{versions}; seed {record.seed}"),
        ]
        if record.command:
            pieces.append(element("pre", record.command))
        if record.sources:
            pieces.append(tables.source_table(record))
    configuration = element("pre", report.config.to_yaml())
    pieces.append(element("details", element("summary", "Configuration"), configuration))
    return _section("How this was made", *pieces)


SECTIONS: Sequence[Callable[[Report], Html]] = (
    _header, _banners, _summary, _plan, _scans, _errors, _consistency, _weakness, _loops,
    _sensors, _provenance,
)  # fmt: skip
"""In the order of the page; a section with nothing to say is empty."""
