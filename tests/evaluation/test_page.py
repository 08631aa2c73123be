"""What the page is given to draw, apart from how a browser draws it."""

from __future__ import annotations

import base64
import json
import zlib
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import solutions

from gtsam_nav.evaluation.histories import error_history
from gtsam_nav.evaluation.html import Html, element
from gtsam_nav.evaluation.page import page_document, script
from gtsam_nav.evaluation.page import sonar as sonar_page
from gtsam_nav.evaluation.page.charts import _line
from gtsam_nav.evaluation.page.columns import every_nth, packed, packed_bytes
from gtsam_nav.evaluation.page.plan import MOST_POSES
from gtsam_nav.evaluation.page.skeleton import embedded, policy
from gtsam_nav.frames import Array, quaternion_from_rotation, rotation_from_rpy
from gtsam_nav.mission import LandmarkMap, Rejection
from gtsam_nav.series import ScanSeries
from gtsam_nav.solution import Solution


def unpacked(column: dict[str, Any]) -> Array:
    """What the page's script makes of a packed column."""
    differences = np.frombuffer(zlib.decompress(base64.b64decode(column["deflated"])), "<i4")
    return np.cumsum(differences, dtype=np.int64) * float(column["step"])


@pytest.fixture(scope="module")
def both() -> list[Solution]:
    return [solutions.dr_solution(), solutions.graph_solution()]


@pytest.fixture(scope="module")
def document(both: list[Solution]) -> dict[str, Any]:
    return page_document(both, (0.0, 500.0))


def test_columns_come_back_to_half_a_step() -> None:
    values = np.random.default_rng(0).normal(size=500) * 1e4
    np.testing.assert_allclose(unpacked(packed(values, 0.01)), values, rtol=0, atol=0.005 + 1e-9)
    assert len(unpacked(packed([]))) == 0


def test_columns_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ValueError, match="steps"):
        packed([0.0, 1.0], 1e-12)


@pytest.mark.parametrize(
    ("value", "sigma"), [(0.0123, 0.005), (0.0, 0.01), (1.5 + 1e-7 * np.sin(np.arange(9.0)), 0.2)]
)
def test_a_constant_is_drawn_where_it_is_with_its_band(value: Any, sigma: float) -> None:
    values, sigmas = np.full(9, value), np.full(9, sigma)
    line = _line("estimate", np.arange(9.0), values, sigmas, "graph")
    np.testing.assert_allclose(unpacked(line["values"]), values, atol=1e-4 * sigma)
    np.testing.assert_allclose(unpacked(line["three_sigma"]), 3 * sigmas, rtol=1e-4)


def test_bytes_come_back() -> None:
    values = np.random.default_rng(0).integers(0, 256, (7, 5), dtype=np.uint8)
    content = zlib.decompress(base64.b64decode(packed_bytes(values)["bytes"]))
    np.testing.assert_array_equal(np.frombuffer(content, np.uint8).reshape(7, 5), values)


@pytest.mark.parametrize(
    ("n", "most", "left"), [(10, 20, 10), (10, 10, 10), (11, 10, 6), (0, 5, 0)]
)
def test_thinning_keeps_to_its_limit(n: int, most: int, left: int) -> None:
    assert len(np.arange(n)[every_nth(n, most)]) == left


def test_the_document_is_json_without_nan(document: dict[str, Any]) -> None:
    assert json.loads(json.dumps(document, allow_nan=False)) == json.loads(json.dumps(document))


def test_equal_solutions_give_equal_documents(
    both: list[Solution], document: dict[str, Any]
) -> None:
    assert json.dumps(page_document(both, (0.0, 500.0))) == json.dumps(document)


def test_tracks_lie_at_the_antenna_with_the_foremost_first(
    both: list[Solution], document: dict[str, Any]
) -> None:
    tracks = document["plan"]["tracks"]
    assert [track["method"] for track in tracks] == ["graph", "dr"]
    antenna = both[1].trajectory.at_lever_arm(solutions.ANTENNA_B)
    assert len(antenna) < MOST_POSES
    for axis, name in enumerate("ne"):
        np.testing.assert_allclose(unpacked(tracks[0][name]), antenna.p_n[:, axis], atol=0.003)
    assert antenna.sigma_p_n is not None
    for axis, name in enumerate(("sigma_n", "sigma_e")):
        np.testing.assert_allclose(
            unpacked(tracks[0][name]), antenna.sigma_p_n[:, axis], atol=0.003
        )


def test_the_page_spans_all_solutions(both: list[Solution]) -> None:
    early, late = both
    early = replace(early, trajectory=early.trajectory.select(slice(0, -50)))
    late = replace(late, trajectory=late.trajectory.select(slice(70, None)))
    document = page_document([early, late], None)
    assert document["span_s"] == [early.trajectory.t[0], late.trajectory.t[-1]]
    assert document["window_s"] is None
    assert set(document["colours"]) == {"dr", "graph"}


def test_a_track_says_how_the_vehicle_lay_and_how_sure_that_is(
    both: list[Solution], document: dict[str, Any]
) -> None:
    antenna = both[1].trajectory.at_lever_arm(solutions.ANTENNA_B)
    track = document["plan"]["tracks"][0]
    assert track["lever_b_m"] == solutions.ANTENNA_B[:2].tolist()
    heading_deg = np.degrees(np.unwrap(antenna.rpy[:, 2]))
    np.testing.assert_allclose(unpacked(track["heading_deg"]), heading_deg, atol=0.011)
    np.testing.assert_allclose(unpacked(track["t"]), antenna.t, atol=6e-4)
    assert antenna.cov_pose_n is not None
    cov = antenna.cov_pose_n[:, :2, :2]
    np.testing.assert_allclose(unpacked(track["sigma_e"]), np.sqrt(cov[:, 1, 1]), atol=0.003)
    correlation = cov[:, 0, 1] / np.sqrt(cov[:, 0, 0] * cov[:, 1, 1])
    np.testing.assert_allclose(unpacked(track["correlation"]), correlation, atol=6e-4)
    online, causal = both[1].online, track["online"]
    assert online is not None
    online_n = online.at_lever_arm(solutions.ANTENNA_B).p_n
    for axis, name in enumerate("ne"):
        np.testing.assert_allclose(unpacked(causal[name]), online_n[:, axis], atol=0.003)


def test_the_map_and_the_reference_lie_where_they_are(
    both: list[Solution], document: dict[str, Any]
) -> None:
    points, reference = both[1].sonar_map, both[1].reference
    assert points is not None
    assert reference is not None
    plan = document["plan"]
    assert (plan["map"]["method"], plan["map"]["name"]) == ("graph", "sonar map")
    for axis, name in enumerate("ne"):
        np.testing.assert_allclose(
            unpacked(plan["map"][name]), points.points_n[:, axis], atol=0.003
        )
        np.testing.assert_allclose(
            unpacked(plan["reference"][name]), reference.series.p_n[:, axis], atol=0.003
        )


def test_what_has_no_absolute_place_is_turned_with_all_that_hangs_on_it(
    both: list[Solution],
) -> None:
    graph, turn = both[1], rotation_from_rpy([0.0, 0.0, 1.2])
    moved = replace(
        graph.trajectory,
        p_n=graph.trajectory.p_n @ turn.T + [70.0, -9.0, 0.0],
        q_nb_wxyz=quaternion_from_rotation(turn @ graph.trajectory.R_nb),
    )
    landmarks = solutions.landmark_estimates()
    landmarks = replace(
        landmarks,
        p_n=landmarks.p_n @ turn.T + [70.0, -9.0, 0.0],
        cov_n=turn @ landmarks.cov_n @ turn.T,
    )
    lost = replace(graph, trajectory=moved, landmarks=landmarks, georeferenced=False)
    (track,) = page_document([lost], None)["plan"]["tracks"]
    (placed,) = page_document([graph], None)["plan"]["tracks"]
    assert track["note"] == " (SE(2)-aligned)"
    turned = unpacked(track["heading_deg"]) - unpacked(placed["heading_deg"])
    assert np.max(np.abs((turned + 180.0) % 360.0 - 180.0)) < 1.5
    for found, expected in zip(track["landmarks"], placed["landmarks"], strict=True):
        np.testing.assert_allclose(found["ne"], expected["ne"], atol=1.5)
        np.testing.assert_allclose(found["cov"], expected["cov"], atol=0.03)


def test_loops_say_all_that_is_known_of_them(
    both: list[Solution], document: dict[str, Any]
) -> None:
    loops = document["plan"]["tracks"][0]["loops"]
    assert len(loops) == len(both[1].loops)
    rejected = next(loop for loop in loops if loop["verdict"] == "rejected")
    assert rejected["dx_m"] is None
    assert rejected["weight"] is None
    assert rejected["reason"] in ("overlap", "gate", "diverged")
    first, source = loops[0], both[1].loops[0]
    assert (first["t_a"], first["t_b"]) == (source.t_a, source.t_b)
    assert first["dx_m"] == pytest.approx(source.dx_m, abs=6e-4)
    assert first["dy_m"] == pytest.approx(source.dy_m, abs=6e-4)
    assert first["dyaw_deg"] == pytest.approx(np.degrees(source.dyaw), abs=6e-4)
    assert first["score"] == pytest.approx(source.score, abs=6e-4)
    path = both[1].trajectory.at_lever_arm(solutions.ANTENNA_B)
    there = path.interpolate(np.array([source.t_b])).p_n[0, :2]
    np.testing.assert_allclose(first["ne_b"], there, atol=0.006)


def test_figures_have_the_digits_that_are_worth_reading(both: list[Solution]) -> None:
    closed = next(loop for loop in both[1].loops if loop.verdict == "accepted")
    closed = replace(
        closed, t_a=100.12345, t_b=400.12345, dx_m=1.23456, dy_m=-2.34567, dyaw=0.1,
        score=0.87654, weight=0.12345,
    )  # fmt: skip
    landmarks = replace(
        solutions.landmark_estimates(),
        p_n=np.full((3, 3), 1 / 3),
        cov_n=np.tile(np.eye(3) / 7 + 1 / 900, (3, 1, 1)),
    )
    solution = replace(both[1], loops=(closed,), landmarks=landmarks, reference=None)
    (track,) = page_document([solution], None)["plan"]["tracks"]
    (loop,) = track["loops"]
    figures = [loop[name] for name in ("t_a", "t_b", "dx_m", "dy_m", "dyaw_deg", "score", "weight")]
    assert figures == [100.123, 400.123, 1.235, -2.346, 5.73, 0.877, 0.123]
    path = both[1].trajectory.interpolate(np.array([100.12345, 400.12345])).p_n
    assert loop["ne_a"] == path[0, :2].round(2).tolist()
    assert loop["ne_b"] == path[1, :2].round(2).tolist()
    assert track["landmarks"][0]["ne"] == [0.333, 0.333]
    assert track["landmarks"][0]["cov"] == [0.143968, 0.143968, 0.001111]


def test_a_perfect_start_has_no_correlation(both: list[Solution]) -> None:
    cov = both[1].trajectory.cov_pose_n
    assert cov is not None
    certain = replace(both[1].trajectory, cov_pose_n=cov * (np.arange(len(cov)) > 5)[:, None, None])
    (track,) = page_document([replace(both[1], trajectory=certain)], None)["plan"]["tracks"]
    assert np.all(unpacked(track["correlation"])[:6] == 0.0)
    assert np.all(unpacked(track["sigma_n"])[:6] == 0.0)


def test_fixes_are_told_apart_by_what_became_of_them(both: list[Solution]) -> None:
    refused = (Rejection(7.0, "gnss", 7, "outlier", 30.0), Rejection(9.0, "dvl", 9, "outlier"))
    fixes = page_document([replace(both[0], rejections=refused)], None)["plan"]["fixes"]
    assert len(unpacked(fixes["used"]["t"])) == 59
    assert [(fix["t"], fix["reason"]) for fix in fixes["rejected"]] == [(7.0, "outlier")]


def test_of_fixes_that_told_the_start_alone_one_is_drawn(both: list[Solution]) -> None:
    fixes = page_document([replace(both[0], gnss_used=1)], None)["plan"]["fixes"]
    assert unpacked(fixes["used"]["t"]) == pytest.approx([0.0])


def test_surveyed_landmarks_stand_on_the_plan(both: list[Solution]) -> None:
    survey = LandmarkMap(np.array([7]), np.array([[90.0, 21.0, 0.0]]), np.array([0.1]))
    mission = replace(both[0].mission, landmark_map=survey)
    found = page_document([replace(both[0], mission=mission)], None)["plan"]["survey"]
    assert found == [{"id": 7, "ne": [90.0, 21.0]}]


def test_charts_show_errors_headings_and_biases(
    both: list[Solution], document: dict[str, Any]
) -> None:
    charts = {chart["title"]: chart for chart in document["charts"]}
    assert list(charts) == [
        "Horizontal error", "Heading less reference's",
        "dr: error north", "dr: error east", "graph: error north", "graph: error east",
        "graph: gyro z", "graph: heading bias",
    ]  # fmt: skip
    history = error_history(both[1])
    assert history is not None
    assert history.sigma_m is not None
    (north,) = charts["graph: error north"]["lines"]
    assert north["band_about_zero"]
    np.testing.assert_allclose(unpacked(north["values"]), history.error_m[:, 0], atol=1e-3)
    np.testing.assert_allclose(unpacked(north["three_sigma"]), 3 * history.sigma_m[:, 0], atol=1e-3)
    compass, estimate = charts["graph: heading bias"]["lines"]
    assert (compass["name"], estimate["name"]) == ("compass", "estimate")
    slow = both[1].slow_states
    assert slow is not None
    values, sigmas = slow.columns["heading_bias_rad"]
    np.testing.assert_allclose(unpacked(estimate["values"]), np.degrees(values), atol=0.01)
    np.testing.assert_allclose(unpacked(estimate["three_sigma"]), np.degrees(3 * sigmas), atol=0.01)


def test_scans_come_with_their_beams(both: list[Solution], document: dict[str, Any]) -> None:
    scans, sonar = both[1].scans, document["sonar"]
    assert scans is not None
    assert (sonar["method"], sonar["sensor"], sonar["simulated"]) == ("graph", "beams", True)
    np.testing.assert_allclose(unpacked(sonar["t"]), scans.t, atol=1e-3)
    np.testing.assert_allclose(unpacked(sonar["x"]), scans.xy[:, 0], atol=0.011)
    raw = sonar["raw"]
    assert raw["scan"] == list(range(len(scans)))
    assert (raw["bins"], raw["bin_m"]) == (4, 5.0)
    beams = unpacked(raw["first"])
    assert beams.tolist() == (14 * np.arange(len(scans) + 1)).tolist()
    intensity = np.frombuffer(zlib.decompress(base64.b64decode(raw["intensity"]["bytes"])), "u1")
    assert intensity.reshape(-1, 4)[0].tolist() == [0, 2, 15, 0]


def test_a_long_sonar_record_keeps_the_scans_of_loops(
    both: list[Solution], monkeypatch: pytest.MonkeyPatch
) -> None:
    scans = both[1].scans
    assert scans is not None
    monkeypatch.setattr(sonar_page, "MOST_RAW_CELLS", 14 * 4 * 2)
    few = replace(both[1], loops=both[1].loops[:1])
    found = page_document([few], None)["sonar"]
    in_loop = [scans.t.tolist().index(t) for t in (few.loops[0].t_a, few.loops[0].t_b)]
    assert found["raw"]["scan"] == sorted(in_loop)
    assert len(unpacked(found["first"])) == len(scans) + 1


def test_scans_that_were_extracted_elsewhere_have_no_raw_beams(both: list[Solution]) -> None:
    points = ScanSeries(t=np.arange(2.0), first=np.array([0, 1, 2]), points_b=np.ones((2, 2)))
    beams = replace(both[1].mission.sensors["beams"], type="scans", series=points)
    mission = both[1].mission.with_sensor(beams)
    assert page_document([replace(both[1], mission=mission)], None)["sonar"]["raw"] is None


def test_without_scans_there_is_no_viewer(both: list[Solution]) -> None:
    assert page_document(both[:1], None)["sonar"] is None


def test_data_cannot_end_their_element() -> None:
    text = embedded({"reason": "</script><!--"}, "1")
    assert text.count("</script>") == 2
    assert "<!--" not in text
    assert "</script" not in script()


def test_the_policy_allows_this_script_and_no_address() -> None:
    allowed = policy(script())
    assert "default-src 'none'" in allowed
    assert "http" not in allowed
    assert policy("1") != allowed


def test_void_elements_are_not_closed() -> None:
    assert element("input", type="range") == Html('<input type="range">')
