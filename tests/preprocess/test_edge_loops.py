"""Which edges of a mission close loops."""

from __future__ import annotations

import numpy as np
import pytest

from gtsam_nav.mission import Mission
from gtsam_nav.pose_edges import PoseEdges
from gtsam_nav.preprocess.edge_loops import n_loops

PAIRS = np.array([[0, 1], [2, 1], [2, 3], [0, 2], [3, 0]])


def mission(t: list[list[float]], in_space: bool) -> Mission:
    n = len(t)
    edges = PoseEdges.in_plane(np.array(t), np.zeros((n, 3)), np.tile(np.eye(3), (n, 1, 1)))
    if in_space:
        edges = PoseEdges(edges.t, edges.R_ab, edges.p_a, np.tile(np.eye(6), (n, 1, 1)))
    return Mission("some", {}, edges=edges)


@pytest.mark.parametrize("in_space", [True, False])
@pytest.mark.parametrize("spacing_s", [0.2, 1.0, 2.0])
def test_edges_over_another_pose_close_loops_however_near(spacing_s: float, in_space: bool) -> None:
    assert n_loops(mission((spacing_s * PAIRS).tolist(), in_space)) == 2


def test_poses_that_edges_alone_tell_of_follow_each_other_however_far_apart() -> None:
    assert n_loops(mission((60.0 * PAIRS).tolist(), in_space=True)) == 2


def test_an_edge_among_sensors_closes_a_loop_where_keyframes_lie_between() -> None:
    assert n_loops(mission([[0.0, 4.0], [20.0, 90.0]], in_space=False)) == 1


def test_without_edges_there_are_no_loops() -> None:
    assert n_loops(Mission("some", {})) == 0
