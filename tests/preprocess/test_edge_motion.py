"""The motion of a pose graph in space, by its edges."""

from __future__ import annotations

import numpy as np
import pytest

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array, rotation_from_rpy
from gtsam_nav.mission import Mission
from gtsam_nav.pose_edges import PoseEdges
from gtsam_nav.preprocess.alignment import align
from gtsam_nav.preprocess.edge_motion import edge_motion, moves_by_edges

RPY = np.array([[0, 0, 0], [0.1, 1.5, 0.2], [3.0, -1.4, 2.0], [-2.0, 0.3, -3.0], [0, 0.1, 0.2]])
P_N = np.array([[0.0, 0, 0], [1, 2, 3], [4, 1, 0], [0, 0, 5], [1, 1, 1]])


def mission(pairs: list[tuple[int, int]]) -> Mission:
    """Exact edges between poses of any attitude, a second apart."""
    R_nb = rotation_from_rpy(RPY)
    a, b = np.array(pairs).T
    R_ab = np.swapaxes(R_nb[a], 1, 2) @ R_nb[b]
    p_a: Array = np.einsum("nji,nj->ni", R_nb[a], P_N[b] - P_N[a])
    information = np.tile(100.0 * np.eye(6), (len(pairs), 1, 1))
    return Mission(
        "some", {}, edges=PoseEdges(np.column_stack([a, b]) * 1.0, R_ab, p_a, information)
    )


@pytest.mark.parametrize(
    "pairs",
    [
        pytest.param([(0, 1), (1, 2), (2, 3), (3, 4), (0, 4), (0, 1)], id="chain_and_a_loop"),
        pytest.param([(1, 0), (2, 1), (2, 3), (4, 3)], id="backward"),
        pytest.param([(0, 4), (4, 2), (2, 1), (3, 0)], id="tree"),
    ],
)
def test_all_poses_follow_from_the_first(pairs: list[tuple[int, int]]) -> None:
    some = mission(pairs)
    assert moves_by_edges(some)
    motion = edge_motion(some, align(some))
    p_n, rpy = motion.at(np.arange(5.0))
    np.testing.assert_allclose(p_n, P_N, atol=1e-9)
    np.testing.assert_allclose(rotation_from_rpy(rpy), rotation_from_rpy(RPY), atol=1e-9)
    carried = np.einsum("nij,nj->ni", rotation_from_rpy(RPY), motion.v_b)
    np.testing.assert_allclose(carried[:-1], np.diff(P_N, axis=0), atol=1e-9)


def test_a_part_that_hangs_on_nothing_is_named() -> None:
    some = mission([(0, 1), (2, 3), (3, 4)])
    with pytest.raises(DataError, match=r"to 3 of 5 others, the first at 2\.0 s"):
        edge_motion(some, align(some))


def test_edges_in_the_plane_move_nothing() -> None:
    some = mission([(0, 1)])
    planar = PoseEdges.in_plane(np.array([[0.0, 1.0]]), np.ones((1, 3)), np.eye(3)[None])
    assert not moves_by_edges(Mission("flat", {}, edges=planar))
    assert not moves_by_edges(Mission("none", {}))
    assert some.edges is not None
