"""Edges of a pose graph: what is planar of them."""

from __future__ import annotations

import numpy as np

from gtsam_nav.frames import rotation_from_rpy
from gtsam_nav.pose_edges import PoseEdges

T = np.array([[0.0, 1.0], [0.0, 9.0]])
Q = np.array([[1.0, 2.0, 0.5], [-3.0, 1.0, -2.0]])
ROOT = np.array([[0.3, 0.1, 0.0], [0.0, 0.2, 0.05], [0.0, 0.0, 0.1]])
COV = np.stack([ROOT @ ROOT.T, np.diag([0.01, 0.04, 0.09])])


def in_space() -> PoseEdges:
    """One edge that turns to starboard and bears a bow turned upward."""
    R_ab = rotation_from_rpy([[0.0, 0.4, np.pi / 2]])
    information = np.diag([1.0, 1.0, 4.0, 16.0, 100.0, 100.0])[None]
    return PoseEdges(T[:1], R_ab, np.array([[1.0, 2.0, 3.0]]), information)


def test_edges_in_the_plane_have_the_figures_they_were_made_of() -> None:
    edges = PoseEdges.in_plane(T, Q, COV)
    assert not edges.in_space
    np.testing.assert_allclose(edges.q, Q, atol=1e-12)
    np.testing.assert_allclose(edges.cov, COV, atol=1e-12)
    assert not np.any(edges.information[:, [0, 1, 5]])


def test_information_stands_along_the_axes_at_the_pose() -> None:
    """A turn of a quarter swaps forward and starboard."""
    quarter = PoseEdges.in_plane(T[:1], np.array([[0.0, 0.0, np.pi / 2]]), COV[1:])
    np.testing.assert_allclose(
        np.diagonal(quarter.information[0]), [0, 0, 1 / 0.09, 25, 100, 0], atol=1e-9
    )


def test_what_is_planar_of_an_edge_in_space() -> None:
    edges = in_space()
    assert edges.in_space
    np.testing.assert_allclose(edges.q, [[1, 2, np.pi / 2]])
    # its y axis, 0.1 m, lies along the frame's backward; the others' share is mixed by the pitch
    c2, s2 = np.cos(0.4) ** 2, np.sin(0.4) ** 2
    np.testing.assert_allclose(edges.cov[0, 0, 0], 0.01)
    np.testing.assert_allclose(edges.cov[0, 1, 1], c2 / 16 + s2 / 100)
    np.testing.assert_allclose(edges.cov[0, 2, 2], s2 + c2 / 4)


def test_selection_and_shift() -> None:
    edges = PoseEdges.in_plane(T, Q, COV)
    first = edges.select(np.array([True, False]))
    assert first is not None
    assert len(first) == 1
    assert edges.select(np.zeros(2, dtype=bool)) is None
    assert edges.shift(2.0).span_s == (2.0, 11.0)
