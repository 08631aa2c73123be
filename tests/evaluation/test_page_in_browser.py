"""The report as a reader meets it: opened in Chromium, pointed at, clicked, typed at."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
import solutions
from browser import Browser, find_chromium

import gtsam_nav as gn
from gtsam_nav.config import Config
from gtsam_nav.evaluation.report import write_report
from gtsam_nav.evaluation.settings import EvaluationSettings
from gtsam_nav.mission import Rejection
from gtsam_nav.solution import Solution

pytestmark = pytest.mark.slow

EVIL = '</script><script>document.title = "owned"</script><img src=x onerror="document.title=1">'
STARTED = "document.getElementById('starting') === null"


@pytest.fixture(scope="module")
def chromium() -> str:
    program = find_chromium()
    if program is None:
        pytest.skip("no chromium in PATH")
    return program


def hostile_solutions() -> list[Solution]:
    """Two methods of a mission whose every text is an attack."""
    graph = solutions.graph_solution()
    loops = tuple(replace(x, reason=EVIL if x.reason else "") for x in graph.loops)
    fix = Rejection(3.0, "gnss", 3, EVIL, 20.0)
    mission = replace(graph.mission, name=EVIL)
    graph = replace(
        graph, mission=mission, loops=loops, warnings=(EVIL,), rejections=(*graph.rejections, fix)
    )
    return [replace(solutions.dr_solution(), mission=mission), graph]


@pytest.fixture(scope="module")
def browser(chromium: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    folder = tmp_path_factory.mktemp("page")
    config = Config(evaluation=EvaluationSettings(window_s=(0.0, 500.0)))
    page = write_report(hostile_solutions(), folder, config)
    with Browser(chromium, folder / "profile") as browser:
        browser.open(page)
        browser.wait_for(STARTED)
        browser.settle()
        yield browser


def pixels(browser: Browser, box: str, layer: int) -> str:
    """A canvas as a PNG, in base64; layer 0 is the base, 1 the overlay."""
    canvas = f"document.querySelectorAll('{box} canvas')[{layer}]"
    found: str = browser.evaluate(f"{canvas}.toDataURL()")
    return found


def cursor_s(browser: Browser) -> float:
    reading: str = browser.evaluate("document.getElementById('time-reading').value")
    return float(reading.removesuffix(" s"))


def test_it_loads_without_complaint_and_asks_for_nothing(browser: Browser) -> None:
    assert browser.complaints == []
    assert [url[:5] for url in browser.requests if not url.startswith("data:")] == ["file:"]


def test_texts_of_the_mission_stay_texts(browser: Browser) -> None:
    assert browser.evaluate("document.title").startswith("</script><script>")
    assert browser.evaluate("document.querySelector('h1').textContent") == EVIL
    assert browser.evaluate("document.querySelectorAll('script').length") == 2
    assert browser.evaluate("document.querySelectorAll('img[src=x]').length") == 0


LABEL = "<img src=x onerror='document.title=1'>"
"""What can be a name of a folder too."""


def test_names_of_sensors_and_labels_of_methods_stay_texts(chromium: str, tmp_path: Path) -> None:
    graph = solutions.graph_solution()
    gnss = replace(graph.mission.sensors["gnss"], name=LABEL)
    mission = graph.mission.with_sensor(gnss)
    fix = Rejection(3.0, LABEL, 3, "bad", 20.0)
    graph = replace(graph, mission=mission, rejections=(*graph.rejections, fix))
    dr = replace(solutions.dr_solution(), mission=mission, method=LABEL)
    page = write_report([dr, graph], tmp_path)
    with Browser(chromium, tmp_path / "profile") as browser:
        browser.open(page)
        browser.wait_for(STARTED)
        browser.settle()
        assert browser.complaints == []
        assert browser.evaluate("document.title").endswith("navigation report")
        assert browser.evaluate("document.querySelectorAll('img[src=x]').length") == 0
        assert LABEL in browser.evaluate("document.body.innerText")


def test_layers_are_those_of_the_solutions(browser: Browser) -> None:
    keys = "[...document.querySelectorAll('[data-layer]')].map((box) => box.dataset.layer)"
    assert browser.evaluate(keys) == [
        "map", "graph-loops-rejected", "graph-loops-accepted", "gnss-used", "gnss-rejected",
        "reference", "dr", "graph-causal", "graph", "graph-landmarks",
    ]  # fmt: skip


def test_every_layer_toggles_by_keyboard(browser: Browser) -> None:
    count = browser.evaluate("document.querySelectorAll('[data-layer]').length")
    for k in range(count):
        before = pixels(browser, "#plan", 0)
        browser.evaluate(f"document.querySelectorAll('[data-layer]')[{k}].focus()")
        browser.press(" ")
        assert pixels(browser, "#plan", 0) != before, k
        browser.press(" ")
        assert pixels(browser, "#plan", 0) == before, k


def test_a_chart_moves_the_cursor_on_the_plan(browser: Browser) -> None:
    x, y = browser.centre_of(".chart .surface")
    browser.mouse("mouseMoved", x - 100, y)
    before, t_before = pixels(browser, "#plan", 1), cursor_s(browser)
    browser.mouse("mouseMoved", x + 100, y)
    assert cursor_s(browser) > t_before + 100
    assert pixels(browser, "#plan", 1) != before


def test_the_plan_moves_the_cursor_in_the_charts(browser: Browser) -> None:
    x, y = browser.centre_of("#plan")
    before = pixels(browser, ".chart .surface", 1)
    seen = set()
    for step in range(-30, 31):
        browser.mouse("mouseMoved", x + 8 * step, y - 4 * step)
        seen.add(cursor_s(browser))
    assert len(seen) > 5
    assert pixels(browser, ".chart .surface", 1) != before


def test_the_slider_moves_the_cursor_by_keyboard(browser: Browser) -> None:
    browser.evaluate("document.getElementById('time').focus()")
    before = cursor_s(browser)
    browser.press("ArrowRight")
    assert cursor_s(browser) > before


def test_the_plan_zooms_by_wheel_once_clicked_and_by_key(browser: Browser) -> None:
    x, y = browser.centre_of("#plan")
    browser.evaluate("document.activeElement.blur()")
    before = pixels(browser, "#plan", 0)
    browser.evaluate("document.getElementById('plan').focus({preventScroll: true})")
    browser.mouse("mouseWheel", x, y, deltaX=0, deltaY=-300)
    closer = pixels(browser, "#plan", 0)
    assert closer != before
    browser.press("+")
    assert pixels(browser, "#plan", 0) != closer
    browser.press("0")
    assert pixels(browser, "#plan", 0) == before


def test_a_dragged_chart_shows_that_time_in_all_charts(browser: Browser) -> None:
    x, y = browser.centre_of(".chart .surface")
    second = ".chart:nth-child(2) .surface"
    before = pixels(browser, second, 0)
    browser.mouse("mousePressed", x - 60, y, button="left", clickCount=1)
    browser.mouse("mouseMoved", x + 60, y, button="left", buttons=1)
    browser.mouse("mouseReleased", x + 60, y, button="left", clickCount=1)
    assert pixels(browser, second, 0) != before
    browser.click(*browser.centre_of("#whole-span"))
    assert pixels(browser, second, 0) == before


def loop_on_screen(browser: Browser) -> tuple[float, float]:
    """Somewhere on the plan where a loop is under the pointer."""
    x, y = browser.centre_of("#plan")
    for down in range(-200, 200, 9):
        for right in range(-300, 300, 40):
            browser.call("Input.dispatchMouseEvent", type="mouseMoved", x=x + right, y=y + down)
            if browser.evaluate("document.getElementById('plan').style.cursor") == "pointer":
                return x + right, y + down
    raise AssertionError("no loop on the plan")


def test_a_loop_tells_of_itself_and_shows_its_scans(browser: Browser) -> None:
    place = loop_on_screen(browser)
    tip = browser.evaluate("document.querySelector('.tip').innerText")
    assert "graph: loop" in tip
    assert "score 0." in tip
    chosen = browser.evaluate("document.getElementById('sonar-loop').value")
    before = pixels(browser, "#sonar-pair", 0)
    browser.click(*place)
    assert browser.evaluate("document.getElementById('sonar-loop').value") != chosen
    assert pixels(browser, "#sonar-pair", 0) != before
    assert "score" in browser.evaluate("document.getElementById('sonar-verdict').innerText")


def test_the_pair_can_stand_as_a_trajectory_has_it(browser: Browser) -> None:
    accepted = (
        "(() => { const s = document.getElementById('sonar-loop');"
        "s.value = [...s.options].find((o) => o.text.startsWith('accepted')).value;"
        "s.dispatchEvent(new Event('change')); })()"
    )
    browser.evaluate(accepted)
    browser.settle()
    pictures = []
    for name in ("", "graph", "dr"):
        browser.evaluate(
            f"(() => {{ const s = document.getElementById('sonar-placement'); s.value = '{name}';"
            "s.dispatchEvent(new Event('change')); })()"
        )
        browser.settle()
        pictures.append(pixels(browser, "#sonar-pair", 0))
    assert len(set(pictures)) == 3


def test_scans_are_stepped_through_with_their_raw_beams(browser: Browser) -> None:
    which = "document.getElementById('sonar-which').value"
    before, raw = browser.evaluate(which), pixels(browser, "#sonar-raw", 0)
    browser.click(*browser.centre_of("#sonar-later"))
    assert browser.evaluate(which) != before
    assert "40 points" in browser.evaluate(which)
    assert pixels(browser, "#sonar-raw", 0) != raw


def test_it_stands_on_dark_ground_too(browser: Browser) -> None:
    ground = "getComputedStyle(document.body).backgroundColor"
    light, plan = browser.evaluate(ground), pixels(browser, "#plan", 0)
    dark = [{"name": "prefers-color-scheme", "value": "dark"}]
    browser.call("Emulation.setEmulatedMedia", features=dark)
    browser.settle()
    assert browser.evaluate(ground) != light
    assert pixels(browser, "#plan", 0) != plan
    browser.call("Emulation.setEmulatedMedia", features=[])
    browser.settle()
    assert pixels(browser, "#plan", 0) == plan
    assert browser.complaints == []


def test_a_mission_without_sonar_and_reference_needs_neither(chromium: str, tmp_path: Path) -> None:
    bare = replace(solutions.dr_solution(), reference=None)
    page = write_report([bare], tmp_path)
    with Browser(chromium, tmp_path / "profile") as browser:
        browser.open(page)
        browser.wait_for(STARTED)
        browser.settle()
        assert browser.complaints == []
        assert browser.evaluate("document.getElementById('sonar')") is None


@pytest.fixture(scope="module")
def stpere_page(stpere_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """56 minutes with 219 scans: dead reckoning, and the quickest method that keeps the scans."""
    mission = gn.open_mission(stpere_folder)
    found = [gn.estimate(mission, method) for method in ("dr", "scan-match")]
    return write_report(found, tmp_path_factory.mktemp("stpere"))


@pytest.mark.realdata
def test_an_hour_of_sonar_stays_small(stpere_page: Path) -> None:
    assert stpere_page.stat().st_size < 6e6


@pytest.mark.realdata
def test_an_hour_of_sonar_opens(chromium: str, stpere_page: Path, tmp_path: Path) -> None:
    with Browser(chromium, tmp_path / "profile") as browser:
        browser.open(stpere_page)
        browser.wait_for(STARTED)
        browser.settle()
        assert browser.complaints == []
        assert browser.evaluate("document.getElementById('sonar-which').value").endswith(" points")
        browser.picture(tmp_path / "page.png")
        assert (tmp_path / "page.png").stat().st_size > 50_000
