"""From poses of scans to a trajectory: the dead-reckoned track, corrected at the scans."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gtsam_nav.ekf.considered import ConsideredErrors, with_considered
from gtsam_nav.ekf.constant_velocity import YAW
from gtsam_nav.ekf.dead_reckoning import filtered_trajectory, fixes_used
from gtsam_nav.ekf.scan_registration import ScanMatch
from gtsam_nav.ekf.scan_track import ScanTrack
from gtsam_nav.frames import (
    Array,
    quaternion_from_rpy,
    rotation_from_rpy,
    wrap_angle,
)
from gtsam_nav.series import IntArray
from gtsam_nav.solution import Innovations, PoseGraph, PoseGraphEdge, Solution, StageClock
from gtsam_nav.sonar.preparation import registered_scans, sonar_map
from gtsam_nav.sonar.scans import planar_rotations
from gtsam_nav.trajectory import Trajectory


@dataclass(frozen=True)
class PoseHistory:
    """Poses (n, 3) of the scans, x, y and yaw, and their covariances (n, 3, 3)."""

    poses: Array
    covs: Array


def scan_solution(
    method: str,
    track: ScanTrack,
    final: PoseHistory,
    online: PoseHistory,
    matches: Sequence[ScanMatch],
    loops: Sequence[ScanMatch],
    clock: StageClock,
    knows_misalignment: bool = False,
) -> Solution:
    """The result of a method that estimates the poses of scans.

    Parameters
    ----------
    final, online : PoseHistory
        Of each scan in the end, and when it entered.
    matches, loops : sequence of ScanMatch
        All that were tried, and those of them that are loops.
    clock : StageClock
    knows_misalignment : bool
        Whether the poses count the constant error of the velocity's direction, which turns the
        track from them on then, else from the start.
    """
    # a compass that is off throughout turns everything about the start; where scans do not tell
    # the way along their walls, it is as long as the velocity says
    left, misalignment = ConsideredErrors.of(track.mission).constant, 0.0
    if knows_misalignment:
        misalignment, left = left.misalignment, replace(left, misalignment=0.0)
    with clock.stage("trajectory"):
        found = between_scans(track, _at_times(track, final), misalignment)
        trajectory = with_considered(found, left)
        causal = with_considered(after_scans(track, _at_times(track, online), misalignment), left)
    used = [m for m in matches if m.accepted]
    innovations = dict(track.reckoned.innovations)
    if used:
        t, nis = np.array([track.t[m.b] for m in used]), np.array([m.nis for m in used])
        whitened = np.array([m.whitened for m in used])
        innovations[track.instrument.name] = Innovations(t, nis, 3, whitened)
    unmatched = [m for m in matches if m.a == m.b - 1 and not m.accepted]
    warnings = track.warnings
    if not used:
        warnings = (*warnings, "no scan could be matched: the trajectory is dead-reckoned")
    return Solution(
        method=method,
        trajectory=trajectory,
        mission=track.mission,
        georeferenced=track.start.georeferenced and track.start.heading_known,
        online=causal,
        loops=tuple(m.as_loop(track) for m in loops),
        rejections=(*track.rejections, *(m.as_rejection(track) for m in unmatched)),
        warnings=warnings,
        innovations=innovations,
        pose_graph=pose_graph(track, trajectory, used),
        sonar_map=sonar_map(track.sonar.echoes, trajectory),
        scans=registered_scans(track.mission, track.sonar),
        gnss_used=fixes_used(track.mission, track.start),
        n_keyframes=len(track),
        stage_s=clock.seconds,
    )


def _at_times(track: ScanTrack, history: PoseHistory) -> PoseHistory:
    """Poses of the scans as those of the vehicle at their times, which their beams may be off."""
    covs = history.covs.copy()
    covs[:, :2, :2] += track.frame_cov
    return PoseHistory(history.poses, covs)


def between_scans(track: ScanTrack, history: PoseHistory, misalignment: float) -> Trajectory:
    """The track with its correction interpolated between the scans.

    Each of the two scans around a time carries the track along, turned by its own correction of
    the yaw; the result lies between the two by the time's fraction of the interval. Before the
    first and after the last scan there is one to carry it. The poses count a misalignment of that
    spread, rad, which turns the track from them on.
    """
    t, n = track.filtered.t, len(track)
    before = np.clip(np.searchsorted(track.t, t, side="right") - 1, 0, n - 1)
    after = np.minimum(before + 1, n - 1)
    span = np.where(after > before, track.t[after] - track.t[before], 1.0)
    f = np.clip((t - track.t[before]) / span, 0.0, 1.0)
    ne_0, turn_0, cov_0 = _carried(track, history, before)
    ne_1, turn_1, cov_1 = _carried(track, history, after)
    ne = ne_0 + f[:, None] * (ne_1 - ne_0)
    turn = turn_0 + f * wrap_angle(turn_1 - turn_0)
    w = f[:, None, None]
    cov = (1 - w) * cov_0 + w * cov_1
    cov += _bridge(track, after, f) + _turned(track, before, after, f, misalignment)
    walked, beyond = walked_cov(track), t > track.t[-1]
    cov[beyond] += walked[beyond] - walked[track.record[-1]]
    return _corrected(track, ne, turn, cov)


def _bridge(track: ScanTrack, after: IntArray, f: Array) -> Array:
    """What the track may be off at fractions (r,) of the way to a scan, tied to it and the last.

    A random walk is a Brownian bridge then, less where it is tied not at two times but to its means
    over the beams of both scans: in the middle a quarter of an interval T less two thirds of their
    span.
    """
    interval_s = track.t[after] - track.t[np.maximum(after - 1, 0)]
    span_s = np.median(np.diff(track.beams_s))
    covered = np.minimum(span_s / np.where(after > 0, interval_s, np.inf), 1.0)
    tied = f * (1 - f) * (1 - 2 / 3 * covered)
    return np.asarray(tied[:, None, None] * track.walked[track.record[after]])


def _turned(
    track: ScanTrack, before: IntArray, after: IntArray, f: Array, misalignment: float
) -> Array:
    """What wrong directions add at fractions f (r,) of the way between two scans, (r, 3, 3).

    The two know the means of a compass's drift over their beams. The heading is off by how it
    differs from those, and so is, all along, the way from either scan; both carry the track here.
    A misalignment turns either way as a whole.
    """
    t, ne = track.filtered.t, track.filtered.x[:, :2]
    ways = [
        share[:, None] * (ne - ne[track.record[scan]])
        for share, scan in ((1.0 - f, before), (f, after))
    ]
    aside = misalignment * (ways[0] + ways[1])[:, ::-1] * [-1.0, 1.0]
    # the way to the first scan is in that one's covariance already
    aside[t < track.t[0]] = 0.0
    cov = np.zeros((len(f), 3, 3))
    cov[:, :2, :2] = aside[:, :, None] * aside[:, None]
    if track.drift is None:
        return cov
    ways_s = [np.sort(np.stack([track.t[scan], t], axis=1)) for scan in (before, after)]
    now_s = np.stack([t, t], axis=1)
    spans_s = np.stack(
        [track.beams_s[before], ways_s[0], track.beams_s[after], ways_s[1], now_s], axis=1
    )
    J = np.zeros((len(f), 3, 5))
    J[:, 2, 4] = 1.0
    for column, share, way in ((0, 1.0 - f, ways[0]), (2, f, ways[1])):
        J[:, 2, column] = -share
        J[:, 0, column], J[:, 0, column + 1] = way[:, 1], -way[:, 1]
        J[:, 1, column], J[:, 1, column + 1] = -way[:, 0], way[:, 0]
    return np.asarray(cov + J @ track.drift.covariance(spans_s) @ np.swapaxes(J, 1, 2))


def after_scans(track: ScanTrack, history: PoseHistory, misalignment: float) -> Trajectory:
    """The causal estimate: the track, carried on from the newest scan that is complete.

    Parameters
    ----------
    history : PoseHistory
        Of each scan when it entered; the first was dead-reckoned.
    misalignment : float
        As in `between_scans`.
    """
    newest = np.searchsorted(track.beams_s[:, 1], track.filtered.t, side="right") - 1
    newest = np.maximum(newest, 0)
    ne, turn, cov = _carried(track, history, newest)
    # the walk that leads to the first scan is in its pose
    after_it, walked = track.filtered.t > track.t[newest], walked_cov(track)
    cov[after_it] += (walked - walked[track.record[newest]])[after_it]
    cov += _turned(track, newest, newest, np.zeros(len(newest)), misalignment)
    return _corrected(track, ne, turn, cov)


def walked_cov(track: ScanTrack) -> Array:
    """Covariance of what adds up in the dead reckoning from the start to each record, (r, 3, 3)."""
    walked = track.walked
    done = np.searchsorted(track.record, np.arange(len(walked)))
    intervals = np.cumsum(walked[track.record], axis=0)
    total = np.concatenate([np.zeros((1, 3, 3)), intervals])[done]
    return np.asarray(total + walked)


def _carried(track: ScanTrack, history: PoseHistory, scan: IntArray) -> tuple[Array, Array, Array]:
    """Position (r, 2) at each record, carried by the track from a scan, the turn (r,) of the track,
    and what the scan's covariance says of both, (r, 3, 3): a wrong turn turns the way."""
    x, here = track.filtered.x, track.record[scan]
    turn = wrap_angle(history.poses[scan, 2] - x[here, YAW])
    moved = np.einsum("rij,rj->ri", planar_rotations(turn), x[:, :2] - x[here, :2])
    J = np.tile(np.eye(3), (len(scan), 1, 1))
    J[:, 0, 2], J[:, 1, 2] = -moved[:, 1], moved[:, 0]
    cov = J @ history.covs[scan] @ np.swapaxes(J, 1, 2)
    return history.poses[scan, :2] + moved, turn, cov


def _corrected(track: ScanTrack, ne: Array, turn: Array, cov_planar: Array) -> Trajectory:
    """The dead-reckoned trajectory with other planar poses; the vertical stays."""
    own = filtered_trajectory(track.filtered, track.mission)
    assert own.v_n is not None
    assert own.cov_pose_n is not None
    assert own.sigma_v_n is not None
    cov = own.cov_pose_n.copy()
    planar = np.array([0, 1, 5])
    cov[:, planar] = 0.0
    cov[:, :, planar] = 0.0
    cov[:, planar[:, None], planar] = cov_planar
    if track.drift is not None:
        # the noise of a single reading, which cancels out over a scan
        cov[:, 5, 5] += track.filtered.P[:, YAW, YAW]
    yaw = np.column_stack([np.zeros((len(turn), 2)), turn])
    v_n = np.einsum("nij,nj->ni", rotation_from_rpy(yaw), own.v_n)
    # a yaw that is wrong turns the velocity
    variance_v = own.sigma_v_n**2
    variance_v[:, :2] += cov_planar[:, 2, 2, None] * v_n[:, [1, 0]] ** 2
    return replace(
        own,
        p_n=np.column_stack([ne, own.p_n[:, 2]]),
        q_nb_wxyz=quaternion_from_rpy(own.rpy + yaw),
        v_n=v_n,
        sigma_v_n=np.sqrt(variance_v),
        cov_pose_n=cov,
        keyframe=np.isin(own.t, track.t),
    )


def pose_graph(track: ScanTrack, trajectory: Trajectory, used: Sequence[ScanMatch]) -> PoseGraph:
    """Scans, the dead-reckoned displacements between them and the matches used, for export."""
    scans = trajectory.select(track.record)
    edges = [_edge(k - 1, k, *track.displacement(k)) for k in range(1, len(track))]
    edges += [_edge(m.a, m.b, m.match.q, m.match.cov) for m in used]
    return PoseGraph(scans.t, scans.p_n, scans.q_nb_wxyz, tuple(edges))


def _edge(a: int, b: int, q: Array, cov: Array) -> PoseGraphEdge:
    """A planar displacement as a spatial one that knows next to nothing of the vertical."""
    information = 1e-6 * np.eye(6)
    planar = [3, 4, 2]
    information[np.ix_(planar, planar)] = np.linalg.inv(cov)
    return PoseGraphEdge(
        a, b, rotation_from_rpy([0.0, 0.0, q[2]]), np.array([q[0], q[1], 0.0]), information
    )
