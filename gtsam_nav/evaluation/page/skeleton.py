"""The interactive part's elements, which the scripts fill; and how script and data are embedded."""

from __future__ import annotations

import base64
import hashlib
import json

from gtsam_nav.evaluation.html import Html, element
from gtsam_nav.evaluation.page.columns import Document

HINT = (
    "Move over the plan or a chart to move the cursor in all of them. Drag the plan to pan; click "
    "it, then scroll to zoom. Drag over a chart to look closer at that time. Click a loop to see "
    "its scans."
)
OLD_BROWSER = (
    "The interactive plan and charts need scripts, and a browser of 2023 or later. The same "
    "figures stand as pictures in the folder plots, beside this page."
)


def workbench() -> Html:
    """Plan and charts side by side, with the cursor over both."""
    time = element("input", id="time", type="range", step="0.5", **{"aria-label": "time cursor"})
    bar = element(
        "div",
        element("label", "time ", time, for_="time"),
        element("output", id="time-reading"),
        _button("whole-span", "whole mission", disabled=""),
        class_="bar",
    )
    plan = element(
        "div",
        class_="surface",
        id="plan",
        tabindex="0",
        role="application",
        **{"aria-label": "plan view: arrows pan, plus and minus zoom, 0 shows all"},
    )
    zoom = element(
        "div",
        _button("zoom-in", "+", title="closer"),
        _button("zoom-out", "−", title="further away"),
        _button("zoom-all", "all", title="show all"),
        class_="zoom",
    )
    beside = element("div", id="charts", tabindex="0", **{"aria-label": "charts over time"})
    interactive = element(
        "div",
        element("p", HINT, class_="note"),
        element("div", id="layers", role="group", **{"aria-label": "layers of the plan"}),
        bar,
        element("div", element("div", plan, zoom, class_="plan"), beside, class_="bench"),
        id="interactive",
        hidden="",
    )
    return Html(element("p", OLD_BROWSER, class_="note", id="starting") + interactive)


def sonar_viewer(sonar: Document | None) -> Html:
    """Raw beams, deskewed points and the pair of a loop; nothing without scans."""
    if sonar is None:
        return Html("")
    label = element("span", "simulated sonar", class_="label") if sonar["simulated"] else Html("")
    turn = element(
        "div",
        _button("sonar-earlier", "‹", title="scan before"),
        element("output", id="sonar-which"),
        _button("sonar-later", "›", title="next scan"),
        class_="bar turn",
    )
    pair = element(
        "div",
        element("label", "loop ", element("select", id="sonar-loop")),
        element("label", "placed by ", element("select", id="sonar-placement")),
        class_="bar pair",
    )
    verdict = element("div", id="sonar-verdict", class_="note", **{"aria-live": "polite"})
    boxes = element(
        "div",
        turn,
        pair,
        _box("sonar-raw", "Raw: beams as the head turned, each at its bearing from the bow."),
        _box("sonar-scan", "Deskewed: echoes in the level vehicle frame at the scan's time."),
        _box("sonar-pair", "Pair of a loop: the old scan dark, the new one in colour.", verdict),
        class_="scans",
    )
    of = "" if sonar["sensor"] == "scans" else f" of {sonar['sensor']}"
    title = element("h2", f"Scans{of} ({sonar['method']})", label)
    return element("section", title, boxes, id="sonar", hidden="")


def embedded(document: Document, script: str) -> Html:
    """Data and script; no text of a mission can end either."""
    text = json.dumps(document, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
    data = element("script", Html(text), type="application/json", id="report-data")
    return Html(data + element("script", Html(script), type="module"))


def policy(script: str) -> str:
    """What the page may do: run this very script, show what it holds, and load nothing."""
    digest = base64.b64encode(hashlib.sha256(script.encode("utf-8")).digest()).decode("ascii")
    return (
        "default-src 'none'; img-src data:; style-src 'unsafe-inline'; "
        f"script-src 'sha256-{digest}'"
    )


def _button(name: str, text: str, **attributes: str) -> Html:
    return element("button", text, type="button", id=name, **attributes)


def _box(name: str, caption: str, *more: Html) -> Html:
    surface = element("div", class_="surface", id=name)
    return element("figure", surface, element("figcaption", caption), *more)
