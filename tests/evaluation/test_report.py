"""The page: what it says, what it must not say, and that it stands alone."""

from __future__ import annotations

import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
import solutions

from gtsam_nav.config import Config
from gtsam_nav.errors import OutputError
from gtsam_nav.evaluation import plots
from gtsam_nav.evaluation.html import Html, element, table
from gtsam_nav.evaluation.report import write_report
from gtsam_nav.evaluation.settings import EvaluationSettings
from gtsam_nav.mission import Rejection, Sensor
from gtsam_nav.series import Cloud, CloudSeries
from gtsam_nav.solution import RobustWeights
from gtsam_nav.writers.run_folder import write_run

WINDOWED = Config(evaluation=EvaluationSettings(window_s=(0.0, 500.0)))


class Page(HTMLParser):
    """Collects a page's text and checks that its elements nest."""

    VOID = ("meta", "img", "input")

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.pieces: list[str] = []
        self.links: list[str] = []
        self.feed(text)
        assert not self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.links += [v or "" for name, v in attrs if name in ("src", "href")]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if not {"style", "script"} & set(self.open):
            self.pieces.append(data)

    @property
    def text(self) -> str:
        return " ".join(self.pieces)


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("out")
    graph = solutions.graph_solution((Path(__file__),))
    both = [replace(solutions.dr_solution(), mission=graph.mission), graph]
    for solution in both:
        write_run(solution, WINDOWED, out, wall_s=20.0, command="gtsam-nav run a 'b' --out c")
    write_report(both, out, WINDOWED)
    return out


@pytest.fixture(scope="module")
def page(written: Path) -> Page:
    return Page((written / "report.html").read_text(encoding="utf-8"))


def test_the_page_needs_nothing_else(page: Page) -> None:
    assert page.links
    assert all(link.startswith("data:image/png;base64,") for link in page.links)


def test_the_figures_stand_beside_the_page(written: Path) -> None:
    assert {path.name for path in (written / "plots").iterdir()} == {
        "plan_view.png", "horizontal_errors.png", "position_errors_dr.png",
        "position_errors_graph.png", "position_sigma.png", "heading.png", "compass_bias_graph.png",
        "slow_states_graph.png", "loops_graph.png", "sensor_timeline.png",
        "nees.png", "nis_graph.png",
    }  # fmt: skip


def test_names_are_escaped(page: Page, written: Path) -> None:
    assert "basin <laps>" in page.text
    assert "<laps>" not in (written / "report.html").read_text(encoding="utf-8")


def test_simulated_sonar_is_labelled_over_every_score(written: Path) -> None:
    text = (written / "report.html").read_text(encoding="utf-8")
    headings = re.findall(r"<h2>(Scores|Plan and time|Errors|Scans)(.*?)</h2>", text)
    assert len(headings) == 4
    assert all("simulated sonar" in label for _, label in headings)


@pytest.mark.slow
def test_a_simulated_lidar_is_labelled_and_its_map_named(tmp_path: Path) -> None:
    series = CloudSeries(t=np.array([0.0]), clouds=(Cloud(np.zeros((1, 3))),))
    solution = solutions.graph_solution()
    lidar = Sensor("lidar", "clouds", series, simulated=True)
    sonars = (sensor.name for sensor in solution.mission.of_type("beams"))
    mission = solution.mission.without(*sonars).with_sensor(lidar)
    write_report(replace(solution, mission=mission, scans=None), tmp_path)
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "simulated lidar" in text
    assert "map of the clouds" in text
    assert "sonar map" not in re.sub(r"<script.*?</script>", "", text, flags=re.DOTALL)


def test_all_that_a_reader_asks_for_is_said(page: Page) -> None:
    for wanted in (
        "scored window 0 to 500 s", "graph, causal", "SE(3)", "The same over the whole reference",
        "no bottom lock", "fixes withheld", "position (NEES)", "dvl (NIS)", "overlap",
        "the sonar's echoes are simulated", "SHA-256", "seed 0", "window_s:",
        "gtsam-nav run a 'b' --out c", "refinement",
    ):  # fmt: skip
        assert wanted in page.text


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Spares the drawing where only the text matters."""

    def save_nothing(_: object, path: Path) -> Path:
        path.write_bytes(b"")
        return path

    monkeypatch.setattr(plots, "save_png", save_nothing)


@pytest.mark.usefixtures("undrawn")
def test_a_failed_run_is_announced(tmp_path: Path) -> None:
    whole = solutions.dr_solution()
    short = replace(whole, trajectory=whole.trajectory.select(slice(0, 4000)))
    page = Page(write_report([short], tmp_path).read_text(encoding="utf-8"))
    assert "The run of dr failed: it covers 66" in page.text
    complete = Page(write_report([whole], tmp_path).read_text(encoding="utf-8"))
    assert "failed" not in complete.text


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    ("factor", "said"),
    [
        (1e-4, "times what the covariance states"),
        (1.0, None),
        (1e4, "the covariance states errors"),
    ],
)
def test_a_covariance_that_is_far_off_is_to_be_noted(
    tmp_path: Path, factor: float, said: str | None
) -> None:
    honest = solutions.dr_solution()
    cov = honest.trajectory.cov_pose_n
    assert cov is not None
    told = replace(honest.trajectory, cov_pose_n=factor * cov)
    text = write_report([replace(honest, trajectory=told)], tmp_path).read_text(encoding="utf-8")
    notes = text.partition("Take note:")[2].partition("</ul>")[0]
    assert ("dr: NEES" in notes) == (said is not None)
    assert said is None or said in notes


@pytest.mark.usefixtures("undrawn")
def test_a_mission_without_reference_says_that_nothing_is_scored(tmp_path: Path) -> None:
    bare = replace(
        solutions.without_origin(solutions.graph_solution()), reference=None, slow_states=None
    )
    page = Page(write_report([bare], tmp_path).read_text(encoding="utf-8"))
    assert "Every score is empty" in page.text
    assert "Absolute error" not in page.text


@pytest.mark.usefixtures("undrawn")
def test_an_unscored_causal_estimate_is_explained(tmp_path: Path, page: Page) -> None:
    assert "causal estimate of graph is not scored" not in page.text
    graph = solutions.graph_solution()
    assert graph.online is not None
    sparse = replace(graph, online=graph.online.select(slice(None, None, 4)))
    explained = Page(write_report([sparse], tmp_path).read_text(encoding="utf-8"))
    assert "The causal estimate of graph is not scored" in explained.text


@pytest.mark.usefixtures("undrawn")
def test_a_recorded_sonar_is_not_called_simulated(tmp_path: Path) -> None:
    graph = solutions.graph_solution()
    beams = replace(graph.mission.sensors["beams"], simulated=False)
    recorded = replace(graph, mission=graph.mission.with_sensor(beams), warnings=())
    page = Page(write_report([recorded], tmp_path).read_text(encoding="utf-8"))
    assert "simulated" not in page.text


@pytest.mark.usefixtures("undrawn")
def test_equal_solutions_give_equal_pages(tmp_path: Path) -> None:
    pages = [write_report([solutions.dr_solution()], tmp_path / name).read_bytes() for name in "ab"]
    assert pages[0] == pages[1]


@pytest.mark.usefixtures("undrawn")
def test_hostile_reasons_do_no_harm(tmp_path: Path) -> None:
    evil = '<script>alert("x")</script>'
    solution = replace(
        solutions.dr_solution(), rejections=(Rejection(1.0, evil, 0, evil),), warnings=(evil,)
    )
    text = write_report([solution], tmp_path).read_text(encoding="utf-8")
    assert "<script>" not in text
    assert text.count("<script") == text.count("</script>") == 2
    assert evil in Page(text).text


def test_an_unwritable_folder_is_an_output_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(OutputError, match="cannot write the report"):
        write_report([solutions.dr_solution()], tmp_path / "file")


def test_a_report_of_nothing_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="at least one"):
        write_report([], tmp_path)


def test_elements_escape_text_and_attributes() -> None:
    assert element("p", "a < b", Html("<br>"), class_='"x"') == (
        '<p class="&quot;x&quot;">a &lt; b<br></p>'
    )
    assert '<td class="figure">1 &amp; 2</td>' in table(("a", "b"), [("x", "1 & 2")])


@pytest.mark.slow
def test_landmarks_are_told_beside_the_plan(tmp_path: Path) -> None:
    mapped = replace(solutions.dr_solution(), landmarks=solutions.landmark_estimates())
    text = Page(write_report([mapped], tmp_path).read_text()).text
    assert (
        "dr: 3 landmarks; horizontal sigma along the longest axis 0.67 m (median), 1.00 m" in text
    )


@pytest.mark.usefixtures("undrawn")
def test_robust_weights_are_told_by_sensor(tmp_path: Path) -> None:
    residual, weight = np.array([0.5, 1.0, 4.0, 30.0]), np.array([1.0, 0.9, 0.3, 0.0])
    own = RobustWeights("cauchy", np.arange(4.0), residual, weight)
    weighed = replace(solutions.dr_solution(), robust_weights={"sounder": own})
    text = Page(write_report([weighed], tmp_path).read_text()).text
    assert "Robust weights at the solution" in text
    # measurements, left out, below one half, mean weight, median residual
    assert "dr sounder cauchy 4 25.0 50.0 0.55 2.50" in text
    without = Page(write_report([solutions.dr_solution()], tmp_path).read_text()).text
    assert "Robust weights" not in without
