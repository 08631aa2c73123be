"""The summary page."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from batch_rows import figures, frame, row

from gtsam_nav.batch.markup import element, page, table
from gtsam_nav.batch.strips import strip_chart
from gtsam_nav.batch.summary import failure_groups, write_summary


def write_page(folder: Path, *rows: object) -> str:
    path = folder / "report.html"
    write_summary(frame(*rows), path)  # type: ignore[arg-type]
    return path.read_text(encoding="utf-8")


def test_the_page_ranks_shows_and_explains(tmp_path: Path) -> None:
    rows = [row(f"m{k}", m, 1.0 + k) for k in range(3) for m in ("dr", "graph")]
    text = write_page(tmp_path, *rows, row("bad", cause="DataError", error="no DVL"))
    assert re.findall("<h2>(.*?)</h2>", text) == [
        "Ranking", "Distributions", "Failures by cause", "Cost", "All runs, worst first",
        "Versions",
    ]  # fmt: skip
    assert text.count("<circle") == 2 * len(rows)  # error and NEES
    assert "no DVL" in text
    assert "12.0" in text  # 2 s for 600 s
    assert list(tmp_path.iterdir()) == [tmp_path / "report.html"]


def test_names_and_messages_are_escaped(tmp_path: Path) -> None:
    name, error = "<script>m</script>", "<b>1 & 2</b>"
    text = write_page(tmp_path, row(name), row("bad", cause="DataError", error=error))
    assert "<script>" not in text
    assert "<b>" not in text
    assert "&lt;script&gt;m&lt;/script&gt;" in text


def test_simulated_sonar_and_mixed_versions_are_said(tmp_path: Path) -> None:
    plain = write_page(tmp_path, row("m"))
    assert "imulated sonar" not in plain
    assert "different versions" not in plain
    simulated = figures(ate_none_mean_m=1.0, sonar="simulated")
    text = write_page(
        tmp_path, row("m", figures=simulated, versions='{"gtsam_nav": "2"}'), row("n")
    )
    assert "Simulated sonar" in text
    assert "different versions" in text


def test_a_batch_that_failed_throughout_has_a_page(tmp_path: Path) -> None:
    text = write_page(tmp_path, row("m", cause="DataError", error="no such file"))
    assert "nothing to rank by" in text
    assert "no such file" in text


def test_failures_that_differ_by_name_and_number_are_one() -> None:
    rows = [
        row(f"m{k}", cause="DataError", error=f"/data/m{k}/dvl.csv:{k + 7}: not a number")
        for k in range(3)
    ]
    died = row("m0", "graph", cause="worker died", error="its worker died 2 times")
    groups = failure_groups(frame(died, *rows, row("good")))
    assert [(g.cause, g.message, len(g.missions)) for g in groups] == [
        ("DataError", "MISSION/dvl.csv:#: not a number", 3),
        ("worker died", "its worker died # times", 1),
    ]


@pytest.mark.parametrize(
    ("error", "message"),
    [
        ("not utf-8 but latin-1", "not utf-8 but latin-1"),
        ("no NMEA 0183 sentence in 12 lines", "no NMEA 0183 sentence in # lines"),
        ("between -3.5 and 1e-06 s; x1", "between -# and # s; x1"),
    ],
)
def test_only_whole_numbers_are_left_out(error: str, message: str) -> None:
    (group,) = failure_groups(frame(row("m0", cause="DataError", error=error)))
    assert group.message == message


def test_a_long_error_is_cut(tmp_path: Path) -> None:
    text = write_page(tmp_path, row("bad", cause="ValueError", error="y" * 5000))
    assert "y" * 299 + "…</td>" in text
    assert "y" * 300 not in text


def test_runs_without_a_score_are_listed_last(tmp_path: Path) -> None:
    text = write_page(tmp_path, row("a", error_m=None), row("b"), row("c", error_m=2.0))
    listed = re.findall(r'href="[^"]*">(\w)</a></td><td[^>]*>dr</td><td[^>]*>(.*?)</td>', text)
    assert listed == [("c", "2.00"), ("b", "1.00"), ("a", "no score")]


def test_a_batch_without_any_score_lists_its_runs(tmp_path: Path) -> None:
    text = write_page(tmp_path, *(row(f"m{k}", error_m=None) for k in range(31)))
    assert text.count(">no score</td>") == 30
    assert "1 more have no score" in text


def test_a_strip_chart_has_a_dot_for_each_positive_value() -> None:
    chart = strip_chart({"dr": [("m0", 1.0), ("m1", 10.0)], "graph": [("m0", 0.0)]})
    assert chart is not None
    x = [float(dot.attrib["cx"]) for dot in chart.iter("circle")]
    assert x[0] < x[1]
    assert strip_chart({"dr": [("m0", 0.0)]}) is None


def test_markup_keeps_text_between_elements() -> None:
    text = page("t", "css > a", element("p", "a", element("b", "c"), " d & e", class_="x"))
    assert '<p class="x">a<b>c</b> d &amp; e</p>' in text
    assert "css > a" in text
    assert table(["n", "v"], [["a", "1"]], names=1).find(".//td[@class='figure']") is not None
