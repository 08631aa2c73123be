"""The report: one self-contained page for people, its figures beside it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from gtsam_nav.config import Config
from gtsam_nav.errors import OutputError
from gtsam_nav.evaluation import plots
from gtsam_nav.evaluation.html import Html, element
from gtsam_nav.evaluation.metrics import evaluate
from gtsam_nav.evaluation.page import asset, page_document, script
from gtsam_nav.evaluation.page.skeleton import embedded, policy
from gtsam_nav.evaluation.report_sections import SECTIONS, Report
from gtsam_nav.solution import Solution, listed
from gtsam_nav.writers.atomic import draft_folder
from gtsam_nav.writers.run_record import RECORD, RunRecord, read_record


def write_report(
    solutions: Solution | Sequence[Solution], out: Path | str, config: Config | None = None
) -> Path:
    """Write ``out/report.html`` and ``out/plots/*.png``: all solutions of a mission side by side.

    Times are those of the run folders in ``out``, where `write_run` put them.

    Parameters
    ----------
    solutions : Solution or sequence of Solution
        Of one mission.
    out : Path or str
        Made where it is missing.
    config : Config, optional
        As it was resolved for the runs; its window is scored.

    Returns
    -------
    Path
        The page.

    Raises
    ------
    OutputError
        Where the folder cannot be written.
    ValueError
        Without a solution.
    """
    solutions = listed(solutions)
    if not solutions:
        raise ValueError("a report needs at least one solution")
    folder = Path(out)
    config = config or Config()
    window_s = config.evaluation.window_s
    page, plots_folder = folder / "report.html", folder / "plots"
    try:
        with draft_folder(page) as draft:
            report = Report(
                solutions=solutions,
                config=config,
                metrics={s.method: evaluate(s, window_s=window_s) for s in solutions},
                whole={s.method: evaluate(s) for s in solutions} if window_s else {},
                records=_records(solutions, folder),
                document=page_document(solutions, window_s),
                plots_folder=draft,
            )
            _figures_beside(report)
            written = draft / page.name
            written.write_text(_page(report), encoding="utf-8", newline="\n")
            plots_folder.mkdir(exist_ok=True)
            for plot in draft.glob("*.png"):
                plot.replace(plots_folder / plot.name)
            written.replace(page)
    except OSError as error:
        raise OutputError(f"{folder}: cannot write the report: {error}") from error
    return page


def _records(solutions: Sequence[Solution], folder: Path) -> dict[str, RunRecord]:
    paths = {s.method: folder / s.method / RECORD for s in solutions}
    return {name: read_record(path) for name, path in paths.items() if path.is_file()}


def _page(report: Report) -> str:
    title = f"{report.solutions[0].mission.name}: navigation report"
    head = element(
        "head",
        element("meta", charset="utf-8"),
        element("meta", name="viewport", content="width=device-width, initial-scale=1"),
        element("meta", **{"http-equiv": "Content-Security-Policy"}, content=policy(script())),
        element("title", title),
        element("style", Html(asset("report.css"))),
    )
    main = element("main", *(section(report) for section in SECTIONS))
    body = element("body", main, embedded(report.document, script()))
    return "<!doctype html>\n" + element("html", head, body, lang="en") + "\n"


def _figures_beside(report: Report) -> None:
    """The figures that the page draws itself, as pictures for other documents."""
    window_s = report.config.evaluation.window_s
    report.beside("plan_view", plots.plan_view(report.solutions))
    report.beside("horizontal_errors", plots.horizontal_errors(report.solutions, window_s))
    report.beside("heading", plots.heading_errors(report.solutions))
    for s in report.solutions:
        report.beside(f"position_errors_{s.method}", plots.position_errors(s, window_s))
        report.beside(f"compass_bias_{s.method}", plots.compass_bias(s))
        report.beside(f"slow_states_{s.method}", plots.slow_states(s))
