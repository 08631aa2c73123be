"""Graphs in space: an invented one with round numbers and faults, in g2o's words and TORO's."""

from __future__ import annotations

import warnings
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gtsam_nav.audit import audit
from gtsam_nav.errors import DataError, GtsamNavError
from gtsam_nav.mission import Mission
from gtsam_nav.pose_edges import PoseEdges
from gtsam_nav.readers import open_mission
from gtsam_nav.writers.mission_folder import write_mission

H = np.sqrt(0.5)
UPPER = "4 0 0 0 0 0 16 0 0 0 0 64 0 0 0 100 0 0 400 0 2500"
"""Shift along x, y and z, then turn about these; TORO's file means turn, then shift."""
GRAPH = f"""VERTEX_SE3:QUAT 7 9 9 9 0 0 0 1
EDGE_SE3:QUAT 7 8 1 2 3 {H} 0 0 {H} {UPPER}
EDGE_SE3:QUAT 9 8 0 0 -5 0 0 {H} {H} {UPPER}
EDGE_SE3:QUAT 7 20 4 4 4 0 {H} 0 {H} {UPPER}
EDGE_SE3:QUAT 7 7 4 4 4 0 0 0 1 {UPPER}
EDGE_SE3:QUAT 7 9 4 4 4 0 0 0 0 {UPPER}
"""
TORO_GRAPH = f"""VERTEX3 7 9 9 9 0 0 0
EDGE3 7 8 1 2 3 {np.pi / 2} 0 0 {UPPER}
EDGE3 9 8 0 0 -5 0 0 {np.pi / 2} {UPPER}
EDGE3 7 20 4 4 4 0 {np.pi / 2} 0 {UPPER}
EDGE3 7 7 4 4 4 0 0 0 {UPPER}
EDGE3 7 9 4 nan 4 0 0 0 {UPPER}
"""


def graph(folder: Path, text: str = GRAPH, name: str = "sphere.g2o") -> Mission:
    (folder / name).write_text(text)
    return open_mission(folder / name)


def edges_of(mission: Mission) -> PoseEdges:
    assert mission.edges is not None
    return mission.edges


def same(one: PoseEdges, two: PoseEdges) -> None:
    for column in ("t", "R_ab", "p_a", "information"):
        a, b = getattr(one, column), getattr(two, column)
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9, err_msg=column)


def test_edges_are_turned_upside_down_and_nothing_else_is_a_sensor(tmp_path: Path) -> None:
    """Poses 7, 8, 9, 20 are a second apart; a quarter turn to port is one about down backward."""
    read = graph(tmp_path)
    edges = edges_of(read)
    assert not read.sensors
    assert edges.in_space
    np.testing.assert_allclose(edges.t, [[0, 1], [2, 1], [0, 3]])
    np.testing.assert_allclose(edges.p_a, [[1, -2, -3], [0, 0, 5], [4, -4, -4]])
    roll, yaw, pitch = edges.R_ab
    np.testing.assert_allclose(roll, [[1, 0, 0], [0, 0, -1], [0, 1, 0]], atol=1e-12)
    np.testing.assert_allclose(yaw, [[0, 1, 0], [-1, 0, 0], [0, 0, 1]], atol=1e-12)
    np.testing.assert_allclose(pitch, [[0, 0, -1], [0, 1, 0], [1, 0, 0]], atol=1e-12)
    np.testing.assert_allclose(edges.information[0], np.diag([100, 400, 2500, 4, 16, 64]))
    told = audit(read)
    assert (told.edges, told.edges_left_out, told.loops, told.methods) == (3, 2, 1, ("graph",))


def test_information_between_axes_keeps_its_sign(tmp_path: Path) -> None:
    """x and z are flipped once between them, y and z twice; x of the turn with y of the shift."""
    flat = "9 1 2 3 4 5 9 1 2 3 4 9 1 2 3 9 1 2 9 1 9"
    information = edges_of(graph(tmp_path, f"EDGE_SE3:QUAT 0 1 1 0 1 0 0 0 1 {flat}\n")).information
    given = np.zeros((6, 6))
    given[np.triu_indices(6)] = np.array(flat.split(" "), dtype=float)
    assert information[0, 3, 4] == -given[0, 1]
    assert information[0, 4, 5] == given[1, 2]
    assert information[0, 0, 4] == -given[1, 3]
    assert information[0, 1, 5] == given[2, 4]
    np.testing.assert_array_equal(information[0], information[0].T)


def test_what_says_nothing_is_rejected_by_its_number(tmp_path: Path) -> None:
    for text, name in ((GRAPH, "sphere.g2o"), (TORO_GRAPH, "sphere.txt")):
        assert [(r.sensor, r.index, r.reason) for r in graph(tmp_path, text, name).rejections] == [
            ("edges", 3, "joins a pose to itself"),
            ("edges", 4, "says nothing finite"),
        ]


def test_toro_s_words_say_the_same(tmp_path: Path) -> None:
    toro, g2o = edges_of(graph(tmp_path, TORO_GRAPH, "sphere.graph")), edges_of(graph(tmp_path))
    np.testing.assert_allclose(toro.R_ab, g2o.R_ab, atol=1e-12)
    np.testing.assert_allclose(toro.p_a, g2o.p_a)
    np.testing.assert_allclose(toro.information[0], np.diag([4, 16, 64, 100, 400, 2500]))


def test_a_mission_folder_holds_the_same_edges(tmp_path: Path) -> None:
    read = graph(tmp_path)
    write_mission(read, tmp_path / "folder")
    same(edges_of(open_mission(tmp_path / "folder")), edges_of(read))


def test_a_table_of_edges_in_space_needs_all_of_its_columns(tmp_path: Path) -> None:
    write_mission(graph(tmp_path), tmp_path / "folder")
    table = tmp_path / "folder" / "edges.csv"
    table.write_text(table.read_text().replace("pitch_deg", "pitch", 1))
    with pytest.raises(DataError, match=r"edges\.csv.*need the columns pitch_deg too"):
        open_mission(tmp_path / "folder")


def test_edges_in_the_plane_in_these_words_are_planar(tmp_path: Path) -> None:
    """They tell odometry, and the figures of the plane."""
    line = f"EDGE_SE3:QUAT 0 1 2 2 0 0 0 {H} {H} {UPPER}\n"
    planar = "EDGE_SE2 1 2 1 0 0 4 0 0 16 0 2500\n"
    odometry = graph(tmp_path, line + planar).sensors["odometry"].series
    np.testing.assert_allclose(odometry.v_b, [[np.pi, 0], [1, 0]], atol=1e-12)  # type: ignore[attr-defined]
    np.testing.assert_allclose(odometry.sigma_yaw_rate, 0.02)  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1", "g2o:7: lines of EDGE_SE2, which lie in the plane"),
        ("EDGE_SE3:QUAT 0 1 1 0 0", "g2o:7: 5 numbers behind EDGE_SE3:QUAT, where 30"),
        (f"EDGE_SE3:QUAT 0 1 1 0 0 0 0 0 one {UPPER}", "g2o:7: EDGE_SE3:QUAT: 'one' is not a"),
        (f"EDGE_SE3:QUAT 0 0.5 1 0 0 0 0 0 1 {UPPER}", "g2o:7: EDGE_SE3:QUAT needs whole numbers"),
        (f"EDGE_SE3:QUAT 0 1 1 0 0 0 0 0 1 -{UPPER}", "g2o:7: its information is not positive"),
    ],
)
def test_a_malformed_line_is_named(tmp_path: Path, line: str, message: str) -> None:
    with pytest.raises(DataError) as caught:
        graph(tmp_path, f"{GRAPH}{line}\n{GRAPH}")
    assert message in str(caught.value)


@pytest.mark.parametrize(
    "last", ["EDGE_SE3:QUAT 8 9 1 1", f"EDGE_SE3:QUAT 8 9 1 1 1 0 0 0 1 {UPPER}e-"]
)
def test_a_last_line_that_was_cut_off_is_rejected(tmp_path: Path, last: str) -> None:
    rejections = graph(tmp_path, GRAPH + last).rejections
    assert (rejections[-1].index, rejections[-1].reason) == (5, "truncated line")


def test_what_is_infinite_is_rejected_without_a_word_of_numpy_s(tmp_path: Path) -> None:
    infinite = f"EDGE_SE3:QUAT 8 9 inf inf -inf 0 {H} 0 {H} {UPPER}\n"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert graph(tmp_path, GRAPH + infinite).rejections[-1].index == 5
        with pytest.raises(DataError, match="no edge joins two poses: says nothing finite"):
            graph(tmp_path, infinite)


@pytest.mark.parametrize("bad", ["7 7 1 1 1 0 0 0 1", "7 8 nan 1 1 0 1 0 1"])
def test_a_graph_without_a_usable_edge(tmp_path: Path, bad: str) -> None:
    with pytest.raises(DataError, match="no edge joins two poses"):
        graph(tmp_path, f"EDGE_SE3:QUAT {bad} {UPPER}\n")


@settings(max_examples=60)
@given(data=st.data())
@pytest.mark.parametrize(("text", "name"), [(GRAPH, "s.g2o"), (TORO_GRAPH, "s.txt")])
def test_damaged_graphs_never_crash_the_reader(
    tmp_path: Path, text: str, name: str, data: st.DataObject
) -> None:
    damaged = bytearray(text.encode())
    start = data.draw(st.integers(0, len(damaged) - 1))
    stop = data.draw(st.integers(start, min(start + 20, len(damaged))))
    damaged[start:stop] = data.draw(st.binary(max_size=8))
    (tmp_path / name).write_bytes(bytes(damaged))
    with suppress(GtsamNavError):
        assert len(edges_of(open_mission(tmp_path / name)))
