"""Edges in space beside compass, attitude, wheels and depth: each says what it measures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import gtsam_nav as gn
from gtsam_nav.frames import Array, rotation_from_rpy, wrap_angle
from gtsam_nav.graph.keyframes import merged_anchors
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.pose_edges import PoseEdges
from gtsam_nav.series import (
    AttitudeSeries,
    DepthSeries,
    HeadingSeries,
    OdometrySeries,
    Series,
)
from gtsam_nav.solution import Solution

N = 21
T = np.arange(float(N))
RPY = np.column_stack([0.3 * np.sin(T / 6), 0.5 * np.sin(T / 9), 0.05 * T])
R_NB = rotation_from_rpy(RPY)
P_N = np.concatenate([np.zeros((1, 3)), np.cumsum(R_NB[:-1, :, 0], axis=0)])
SIGMA = 0.01


def mission(*series: Series, step_s: float = 1.0) -> Mission:
    """Exact edges along the way and two loops, with what else was measured."""
    ends = np.array([*((k, k + 1) for k in range(N - 1)), (0, 10), (5, 20)])
    a, b = ends.T
    R_an = np.swapaxes(R_NB[a], 1, 2)
    edges = PoseEdges(
        step_s * T[ends],
        R_an @ R_NB[b],
        np.einsum("nij,nj->ni", R_an, P_N[b] - P_N[a]),
        np.tile(np.eye(6) / SIGMA**2, (len(ends), 1, 1)),
    )
    sensors = {own.TYPE: Sensor(own.TYPE, own.TYPE, own) for own in series}
    return Mission("edges", sensors, edges=edges)


def attitude(off_rad: float = 0.0) -> AttitudeSeries:
    sigma = np.full(N, np.radians(0.5))
    return AttitudeSeries(t=T, roll=RPY[:, 0] + off_rad, pitch=RPY[:, 1], sigma=sigma)


HEADING = HeadingSeries(t=T, heading=RPY[:, 2], sigma=np.full(N, np.radians(1.0)))
WHEELS = OdometrySeries(
    t=T,
    v_b=np.tile([1.0, 0.0], (N, 1)),
    yaw_rate=np.full(N, 0.05),
    sigma_v=np.full(N, 0.05),
    sigma_yaw_rate=np.full(N, 0.02),
)


def solved(own: Mission) -> Solution:
    return gn.estimate(own, "graph")


def from_first(solution: Solution) -> Array:
    """Places of the poses in the first one's axes."""
    at = solution.trajectory.interpolate(T)
    return np.asarray((at.p_n - at.p_n[0]) @ at.R_nb[0])


@pytest.mark.parametrize(
    "series",
    [(), (HEADING,), (attitude(),), (HEADING, attitude()), (WHEELS,)],
    ids=["alone", "compass", "attitude", "both", "wheels"],
)
def test_nothing_bends_what_the_edges_tell(series: tuple[Series, ...]) -> None:
    found = solved(mission(*series))
    np.testing.assert_allclose(from_first(found), P_N @ R_NB[0], atol=1e-3)
    assert not found.rejections


def test_an_attitude_is_measured_and_not_the_motion_s_own() -> None:
    edges_alone = solved(mission(HEADING)).trajectory
    rolled = solved(mission(HEADING, attitude(0.2))).trajectory
    assert np.mean(rolled.rpy[:, 0] - RPY[:, 0]) == pytest.approx(0.2, abs=0.02)
    sure, vague = (t.cov_pose_n for t in (rolled, edges_alone))
    assert sure is not None
    assert vague is not None
    assert sure[-1, 3, 3] < 0.2 * vague[-1, 3, 3]


def test_an_attitude_alone_levels_the_start() -> None:
    found = solved(mission(attitude())).trajectory
    assert np.max(np.abs(wrap_angle(found.rpy[:, :2] - RPY[:, :2]))) < np.radians(0.5)
    assert found.cov_pose_n is not None
    assert np.degrees(np.sqrt(found.cov_pose_n[-1, 3, 3])) < 1.0


def test_while_an_attitude_is_silent_the_edges_carry_it() -> None:
    early = attitude().select(T < 8.0)
    (said,) = [w for w in solved(mission(HEADING, early)).warnings if "is silent" in w]
    assert said.endswith("the edges carry roll and pitch")


def test_what_was_measured_past_the_last_pose_is_left_out_and_said() -> None:
    t = np.arange(0.0, 40.0)
    found = solved(mission(DepthSeries(t=t, depth_m=np.zeros(40), sigma=np.full(40, 5.0))))
    assert found.trajectory.t[-1] == T[-1]
    assert any("from 0.0 to 20.0 s: what depth measured" in warning for warning in found.warnings)


def test_poses_at_a_high_rate_are_all_used() -> None:
    found = solved(mission(step_s=0.05))
    assert found.n_keyframes == N
    assert len(found.loops) == 2


def test_an_exact_graph_has_settled() -> None:
    n = 5
    straight = PoseEdges(
        np.column_stack([T[:n], T[1 : n + 1]]),
        np.tile(np.eye(3), (n, 1, 1)),
        np.tile([1.0, 0.0, -0.5], (n, 1)),
        np.tile(np.eye(6), (n, 1, 1)),
    )
    found = solved(replace(mission(), edges=straight))
    assert not any("before it settled" in warning for warning in found.warnings)


def test_one_stated_loop_leaves_the_causal_track_of_other_missions_as_dense() -> None:
    marina = gn.simulate("marina", seed=1, duration_s=60.0).without("sonar", "landmarks")
    edge = PoseEdges.in_plane(np.array([[0.0, 30.0]]), np.zeros((1, 3)), 100 * np.eye(3)[None])
    plain, closed = solved(marina).online, solved(replace(marina, edges=edge)).online
    assert plain is not None
    assert closed is not None
    assert len(closed) >= len(plain)


def test_stated_times_are_kept_however_close() -> None:
    stated = np.array([3.0, 3.02, 3.04])
    found = merged_anchors([np.array([3.05, 5.0])], 0.1, stated)
    np.testing.assert_array_equal(found, [3.0, 3.02, 3.04, 5.0])
