"""Text graphs: an invented one with round numbers and every fault, and GTSAM's Victoria Park."""

from __future__ import annotations

import warnings
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gtsam_nav.cards import load_card
from gtsam_nav.errors import DataError, GtsamNavError
from gtsam_nav.mission import Mission
from gtsam_nav.readers import open_mission
from gtsam_nav.series import LandmarkSeries, OdometrySeries

COV = "0.04 0 0 0.01 0 0.09"
GRAPH = f"""# a quarter turn to the left on a circle of 2 m, then straight on
VERTEX2 0 9 9 9
ODOMETRY 0 1 2 2 {np.pi / 2} {COV}
LANDMARK 1 2 3 4 1 0 1
ODOMETRY 1 3 1 0 0 {COV}
BR 3 2 -0.5 6 0.02 0.3
EDGE2 4 3 -2 0 0 {COV}
EDGE2 0 4 1 1 1 {COV}
EQUIV 0 4
LANDMARK 7 2 1 1 1 0 1
LANDMARK 4 9 0 0 1 0 1
"""


def graph(folder: Path, text: str = GRAPH, name: str = "park.txt") -> Mission:
    (folder / name).write_text(text)
    return open_mission(folder / name)


def series_of(mission: Mission) -> tuple[OdometrySeries, LandmarkSeries]:
    odometry, landmarks = (mission.sensors[name].series for name in ("odometry", "landmarks"))
    assert isinstance(odometry, OdometrySeries)
    assert isinstance(landmarks, LandmarkSeries)
    return odometry, landmarks


def test_edges_between_neighbours_are_odometry(tmp_path: Path) -> None:
    """Poses 0, 1, 3, 4 are a second apart; a left quarter turn on 2 m radius is pi metres long."""
    odometry, _ = series_of(graph(tmp_path))
    np.testing.assert_allclose(odometry.t, [0.5, 1.5, 2.5])
    np.testing.assert_allclose(odometry.v_b, [[np.pi, 0], [1, 0], [2, 0]], atol=1e-12)
    np.testing.assert_allclose(odometry.yaw_rate, [-np.pi / 2, 0, 0], atol=1e-12)
    np.testing.assert_allclose(odometry.sigma_v, 0.2)
    np.testing.assert_allclose(odometry.sigma_yaw_rate, 0.3)


def test_sightings_are_polar_and_clockwise(tmp_path: Path) -> None:
    _, seen = series_of(graph(tmp_path))
    # pose 0 of the edges is the mission's zero
    np.testing.assert_allclose(seen.t, [1.0, 2.0])
    np.testing.assert_array_equal(seen.id, [2, 2])
    np.testing.assert_allclose(seen.range_m, [5, 6])
    np.testing.assert_allclose(seen.bearing, [-np.arctan2(4, 3), 0.5])
    np.testing.assert_allclose(seen.sigma_range, [1, 0.3])
    np.testing.assert_allclose(seen.sigma_bearing, [0.2, 0.02])


def test_what_no_sensor_measures_is_rejected_and_said(tmp_path: Path) -> None:
    mission = graph(tmp_path)
    assert [(r.sensor, r.index, r.reason) for r in mission.rejections] == [
        ("landmarks", 2, "no such pose"),
        ("landmarks", 3, "non-finite bearing"),
    ]
    assert any("no clock" in w for w in mission.warnings)
    assert any("EQUIV (1)" in w for w in mission.warnings)
    assert mission.start_utc is None


def test_edges_that_close_loops_are_edges_of_the_mission(tmp_path: Path) -> None:
    edges = graph(tmp_path).edges
    assert edges is not None
    np.testing.assert_allclose(edges.t, [[0, 1], [1, 2], [3, 2], [0, 3]])
    np.testing.assert_allclose(edges.q[3], [1, -1, -1])
    np.testing.assert_allclose(edges.cov[1], np.diag([0.04, 0.01, 0.09]))


def test_a_covariance_in_polar_axes(tmp_path: Path) -> None:
    """A landmark to the left with 0.3 m along the pose's x and 0.1 m along its y."""
    text = f"EDGE2 0 1 1 0 0 {COV}\nLANDMARK 1 2 0 2 0.09 0 0.01\n"
    _, seen = series_of(graph(tmp_path, text))
    np.testing.assert_allclose(seen.sigma_range, [0.1])
    np.testing.assert_allclose(seen.sigma_bearing, [0.15])


def test_the_order_of_toro_is_known_by_its_zeros_and_is_information(tmp_path: Path) -> None:
    text = "EDGE2 0 1 1 0 0 25 0 100 11.1111111111 0 0\nLANDMARK 1 2 0 2 0.09 0 0.01\n"
    odometry, _ = series_of(graph(tmp_path, text))
    np.testing.assert_allclose([odometry.sigma_v[0], odometry.sigma_yaw_rate[0]], [0.2, 0.3])


def test_neighbours_without_an_edge_are_counted(tmp_path: Path) -> None:
    text = f"EDGE2 0 1 1 0 0 {COV}\nEDGE2 2 3 1 0 0 {COV}\n"
    mission = graph(tmp_path, text)
    assert any("no edge joins 1 of 3 neighbouring poses" in w for w in mission.warnings)
    assert not any("sighting" in w for w in mission.warnings)
    useless = graph(tmp_path, f"{text}LANDMARK 0 9 0 0 1 0 1\n")
    assert any("no usable sighting" in w for w in useless.warnings)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("ODOMETRY 4 5 1 0 0", "park.txt:3: 5 numbers behind ODOMETRY, where 11 are needed"),
        (f"ODOMETRY 4 5 x 0 0 {COV}", "park.txt:3: ODOMETRY: 'x' is not a number"),
        (f"ODOMETRY 4.5 5 1 0 0 {COV}", "park.txt:3: ODOMETRY needs whole numbers"),
        ("BR nan 5 1 1 1 1", "park.txt:3: BR needs whole numbers"),
        ("EDGE2 4 5 1 0 0 1 1 1 1 1 1", "park.txt:3: its noise, [1.0, 1.0, 1.0, 1.0, 1.0, 1.0]"),
        ("EDGE2 4 5 1 0 0 1 1 1 1 0 0", "park.txt:3: its noise is not positive definite"),
        ("EDGE2 1 2 1 0 0 1 5 0 1 0 1", "park.txt:3: its noise is not positive definite"),
        ("EDGE2 1 2 1 0 0 1e30 0 1 1 0 0", "park.txt:3: its noise is not positive definite"),
    ],
)
def test_a_malformed_line_is_named(tmp_path: Path, line: str, message: str) -> None:
    lines = f"# graph\nODOMETRY 0 1 1 0 0 {COV}\n{line}\nODOMETRY 1 3 1 0 0 {COV}\n"
    with pytest.raises(DataError) as caught:
        graph(tmp_path, lines)
    assert message in str(caught.value)


def test_an_edge_is_in_the_graph_and_the_odometry_or_in_neither(tmp_path: Path) -> None:
    """What is infinite is rejected, without a word of numpy's, also of an edge said backward."""
    infinite = f"EDGE2 3 1 inf 0 inf {COV}\nEDGE2 0 3 0 -inf 0 {COV}\n"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        mission = graph(tmp_path, GRAPH + infinite)
    assert len(series_of(mission)[0]) == 3
    assert mission.edges is not None
    assert len(mission.edges) == 4
    assert [(r.index, r.reason) for r in mission.rejections if r.sensor == "odometry"] == [
        (4, "says nothing finite"),
        (5, "says nothing finite"),
    ]


@pytest.mark.parametrize("last", ["LANDMARK 3 2 1", "LANDMARK 3 2 1 1 1 0 1e-"])
def test_a_last_line_that_was_cut_off_is_rejected(tmp_path: Path, last: str) -> None:
    mission = graph(tmp_path, GRAPH + last)
    cut = [(r.sensor, r.index) for r in mission.rejections if r.reason == "truncated line"]
    assert cut == [("landmarks", 4)]


def test_a_file_of_vertices_is_no_mission(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no edge joins two poses"):
        graph(tmp_path, "VERTEX2 0 0 0 0\n")


def test_other_text_is_not_taken_for_a_graph(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="not a mission that any reader knows"):
        graph(tmp_path, "1 2 3\n4 5 6\n")


@settings(max_examples=60)
@given(data=st.data())
def test_damaged_graphs_never_crash_the_reader(tmp_path: Path, data: st.DataObject) -> None:
    text = bytearray(GRAPH.encode())
    start = data.draw(st.integers(0, len(text) - 1))
    stop = data.draw(st.integers(start, min(start + 20, len(text))))
    text[start:stop] = data.draw(st.binary(max_size=8))
    (tmp_path / "park.graph").write_bytes(bytes(text))
    with suppress(GtsamNavError):
        assert open_mission(tmp_path / "park.graph").sensors


def test_victoria_park_opens_with_the_noise_of_its_card() -> None:
    import gtsam

    mission = open_mission(gtsam.findExampleDataFile("victoria_park.txt"))
    odometry, seen = series_of(mission)
    assert (len(odometry), len(seen), len(np.unique(seen.id))) == (6968, 3640, 151)
    assert mission.rejections == ()
    assert np.sum(odometry.v_b[:, 0]) == pytest.approx(4030, abs=5)
    card = load_card("victoria_park").sensors
    assert set(odometry.sigma_v) == {card["odometry"].noise["sigma_v_m_s"]}
    assert set(odometry.sigma_yaw_rate) == {card["odometry"].noise["sigma_yaw_rate_rad_s"]}
    assert seen.sigma_range is not None
    assert set(seen.sigma_range) == {card["landmarks"].noise["sigma_range_m"]}
