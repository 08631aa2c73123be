"""From poses of scans to a trajectory: the dead-reckoned track, corrected at the scans."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gtsam_nav.ekf.considered import ConsideredErrors, with_considered
from gtsam_nav.ekf.constant_velocity import YAW
from gtsam_nav.ekf.dead_reckoning import filtered_trajectory, fixes_used
from gtsam_nav.ekf.scan_registration import ScanMatch
from gtsam_nav.ekf.scan_track import PLANAR, ScanTrack
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
) -> Solution:
    """The result of a method that estimates the poses of scans.

    Parameters
    ----------
    final, online : PoseHistory
        Of each scan in the end, and when it entered.
    matches, loops : sequence of ScanMatch
        All that were tried, and those of them that are loops.
    """
    with clock.stage("trajectory"):
        trajectory = between_scans(track, _at_times(track, final))
        causal = after_scans(track, _at_times(track, online))
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


def between_scans(track: ScanTrack, history: PoseHistory) -> Trajectory:
    """The track with its correction interpolated between the scans.

    Each of the two scans around a time carries the track along, turned by its own correction of
    the yaw; the result lies between the two by the time's fraction of the interval. Before the
    first and after the last scan there is one to carry it.
    """
    t, n = track.filtered.t, len(track)
    before = np.clip(np.searchsorted(track.t, t, side="right") - 1, 0, n - 1)
    after = np.minimum(before + 1, n - 1)
    span = np.where(after > before, track.t[after] - track.t[before], 1.0)
    f = np.clip((t - track.t[before]) / span, 0.0, 1.0)
    ne_0, turn_0 = _carried(track, history, before)
    ne_1, turn_1 = _carried(track, history, after)
    ne = ne_0 + f[:, None] * (ne_1 - ne_0)
    turn = turn_0 + f * wrap_angle(turn_1 - turn_0)
    w = f[:, None, None]
    cov = (1 - w) * history.covs[before] + w * history.covs[after] + _bridge(track, after, f)
    drift, beyond = drift_cov(track), t > track.t[-1]
    cov[beyond] += drift[beyond] - drift[track.record[-1]]
    return _corrected(track, ne, turn, cov)


def _bridge(track: ScanTrack, after: IntArray, f: Array) -> Array:
    """What the track may be off at fractions (r,) of the way to a scan, tied to it and the last.

    A random walk is a Brownian bridge then, less where it is tied not at two times but to its means
    over the beams of both scans: in the middle a quarter of an interval T less two thirds of their
    span. A compass's drift is one of the heading; the way that it turns aside is its integral, and
    tied at both ends in its direction too.
    """
    here = track.record[after]
    interval_s = track.t[after] - track.t[np.maximum(after - 1, 0)]
    covered = np.minimum(track.span_s / np.where(after > 0, interval_s, np.inf), 1.0)
    bridge = f * (1 - f)
    tied = bridge * (1 - 2 / 3 * covered)
    total = track.displacement_cov[here]
    white = track.filtered.P[here][:, PLANAR[:, None], PLANAR]
    if track.drift is None:
        return np.asarray(tied[:, None, None] * white)
    by_drift = np.column_stack([bridge, bridge, np.sqrt(tied)])
    cov = by_drift[:, :, None] * (total - white) * by_drift[:, None]
    cov[:, :2, :2] += tied[:, None, None] * white[:, :2, :2]
    return np.asarray(cov)


def after_scans(track: ScanTrack, history: PoseHistory) -> Trajectory:
    """The causal estimate: the track, carried on from the newest scan that is complete.

    Parameters
    ----------
    history : PoseHistory
        Of each scan when it entered; the first was dead-reckoned.
    """
    newest = np.searchsorted(track.complete_s, track.filtered.t, side="right") - 1
    newest = np.maximum(newest, 0)
    drift = drift_cov(track)
    cov = history.covs[newest] + drift - drift[track.record[newest]]
    return _corrected(track, *_carried(track, history, newest), cov)


def drift_cov(track: ScanTrack) -> Array:
    """Covariance of the dead-reckoned displacement since the start at each record, (r, 3, 3)."""
    done = np.searchsorted(track.record, np.arange(len(track.filtered.t)))
    intervals = np.cumsum(track.displacement_cov[track.record], axis=0)
    total = np.concatenate([np.zeros((1, 3, 3)), intervals])[done]
    return np.asarray(total + track.displacement_cov)


def _carried(track: ScanTrack, history: PoseHistory, scan: IntArray) -> tuple[Array, Array]:
    """Position at each record, carried by the track from a scan, and the turn of the track."""
    x, here = track.filtered.x, track.record[scan]
    turn = wrap_angle(history.poses[scan, 2] - x[here, YAW])
    moved = np.einsum("rij,rj->ri", planar_rotations(turn), x[:, :2] - x[here, :2])
    return history.poses[scan, :2] + moved, turn


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
    cov[:, 5, 5] += track.frame_yaw_variance
    yaw = np.column_stack([np.zeros((len(turn), 2)), turn])
    v_n = np.einsum("nij,nj->ni", rotation_from_rpy(yaw), own.v_n)
    # a yaw that is wrong turns the velocity
    variance_v = own.sigma_v_n**2
    variance_v[:, :2] += cov_planar[:, 2, 2, None] * v_n[:, [1, 0]] ** 2
    found = replace(
        own,
        p_n=np.column_stack([ne, own.p_n[:, 2]]),
        q_nb_wxyz=quaternion_from_rpy(own.rpy + yaw),
        v_n=v_n,
        sigma_v_n=np.sqrt(variance_v),
        cov_pose_n=cov,
        keyframe=np.isin(own.t, track.t),
    )
    # a compass that is off throughout turns everything about the start; where scans do not tell
    # the way along their walls, it is as long as the velocity says
    return with_considered(found, ConsideredErrors.of(track.mission).constant)


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
