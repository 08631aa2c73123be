"""The interactive part of the report: its data as a document, its scripts as plain files.

The document is JSON; what is long in it is packed (`columns`). The scripts are read in the order
of `SCRIPTS` and make one module, which draws on canvases and needs no library and no network.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib.resources import files
from typing import Any

from gtsam_nav.evaluation.page.charts import charts_document
from gtsam_nav.evaluation.page.plan import plan_document
from gtsam_nav.evaluation.page.sonar import sonar_document
from gtsam_nav.evaluation.plots.style import method_colour
from gtsam_nav.solution import Solution

SCRIPTS = (
    "columns.js",
    "canvas.js",
    "strokes.js",
    "layers.js",
    "plan.js",
    "chart.js",
    "sonar.js",
    "report.js",
)


def page_document(
    solutions: Sequence[Solution], window_s: tuple[float, float] | None
) -> dict[str, Any]:
    """All that the page draws, as JSON holds it."""
    begin = min(float(s.trajectory.t[0]) for s in solutions)
    end = max(float(s.trajectory.t[-1]) for s in solutions)
    return {
        "span_s": [begin, end],
        "window_s": window_s,
        "colours": {s.method: method_colour(s.method) for s in solutions},
        "plan": plan_document(solutions),
        "charts": charts_document(solutions),
        "sonar": sonar_document(solutions),
    }


def asset(name: str) -> str:
    """The text of a file beside this one."""
    return files(__name__).joinpath(name).read_text(encoding="utf-8")


def script() -> str:
    """All scripts as one module."""
    return "\n".join(asset(name) for name in SCRIPTS)
