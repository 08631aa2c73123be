"""Scan forming: which beams make a turn, and where their echoes lie once the motion is taken out.

The scan's frame is the level vehicle frame (forward, starboard) at its middle beam, which spreads
the motion's uncertainty best: Mallios et al. 2014, section 4.2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.mission import Sensor
from gtsam_nav.series import BeamSeries, BoolArray, IntArray, ScanSeries
from gtsam_nav.sonar.echoes import Echoes
from gtsam_nav.sonar.motion import PlanarMotion


@dataclass(frozen=True)
class Turns:
    """The beams of each scan: ``first[k] <= beam < last[k]``, reference at ``t_ref[k]``."""

    first: IntArray
    last: IntArray
    t_ref: Array

    def __len__(self) -> int:
        return len(self.t_ref)

    def select(self, which: BoolArray | IntArray) -> Turns:
        """The scans that a mask or an index array picks."""
        return Turns(self.first[which], self.last[which], self.t_ref[which])

    def hold(self, beam: IntArray) -> BoolArray:
        """Which beams belong to one of the scans."""
        scan = np.searchsorted(self.first, beam, side="right") - 1
        return np.asarray((scan >= 0) & (beam < self.last[np.maximum(scan, 0)]))


@dataclass(frozen=True)
class Scan:
    """One scan without its motion.

    Attributes
    ----------
    t_ref : float
        Time of the middle beam, s.
    xy : ndarray, shape (k, 2)
        Echoes in the level vehicle frame at ``t_ref``, m.
    cov : ndarray, shape (k, 2, 2)
        Their covariances: sonar noise and the motion's uncertainty since ``t_ref``, m^2.
    """

    t_ref: float
    xy: Array
    cov: Array

    def __len__(self) -> int:
        return len(self.xy)


def find_turns(sonar: Sensor, max_gap_s: float) -> Turns:
    """Cut the beams into scans.

    A scan ends after a full turn, at a gap, and where the head reverses or flies back (sector
    scans); a scan of fewer than three beams is none. Scans that were extracted elsewhere stay what
    they are.
    """
    series = sonar.series
    if isinstance(series, ScanSeries):
        index = np.arange(len(series))
        return Turns(index, index + 1, series.t)
    assert isinstance(series, BeamSeries)
    step = wrap_angle(np.diff(series.angle))
    gap = np.diff(series.t) > max_gap_s
    starts = [0]
    turned, direction = 0.0, 0.0
    full_turn = 2 * np.pi - 0.5 * float(np.median(np.abs(step))) if len(step) else 2 * np.pi
    for k in range(len(step)):
        reversed_ = step[k] * direction < 0
        turned += abs(step[k])
        if gap[k] or reversed_ or turned >= full_turn:
            starts.append(k + 1)
            # the step that parts two scans may be a fly-back: the next one tells how the head turns
            turned, direction = 0.0, 0.0
        elif step[k] != 0:
            direction = float(np.sign(step[k]))
    first = np.array(starts)
    last = np.append(first[1:], len(series))
    keep = last - first >= 3
    first, last = first[keep], last[keep]
    return Turns(first, last, series.t[(first + last) // 2])


def thin_scans(scan_times: Array, min_spacing_s: float) -> IntArray:
    """Indices of scans at least a spacing apart, greedily from the first."""
    kept: list[int] = []
    for k, t in enumerate(scan_times):
        if not kept or t - scan_times[kept[-1]] >= min_spacing_s:
            kept.append(k)
    return np.array(kept, dtype=np.int64)


def thin_by_motion(
    scan_times: Array, motion: PlanarMotion, min_move_m: float, min_turn_rad: float
) -> IntArray:
    """Indices of scans before which the vehicle moved or turned enough, greedily from the first."""
    ne, yaw = motion.at(scan_times)
    kept = [0] if len(scan_times) else []
    for k in range(1, len(scan_times)):
        last = kept[-1]
        moved = np.linalg.norm(ne[k] - ne[last]) >= min_move_m
        if moved or abs(yaw[k] - yaw[last]) >= min_turn_rad:
            kept.append(k)
    return np.array(kept, dtype=np.int64)


def form_scans(echoes: Echoes, turns: Turns, motion: PlanarMotion) -> list[Scan]:
    """Deskew the echoes of each turn with the vehicle's motion.

    Parameters
    ----------
    echoes : Echoes
    turns : Turns
    motion : PlanarMotion
        Must cover the beams' times.
    """
    xy_n, cov_n = echoes_in_level_frame(echoes, motion)
    bounds = np.searchsorted(echoes.beam, np.stack([turns.first, turns.last]))
    scans = []
    for t_ref, begin, end in zip(turns.t_ref, *bounds, strict=True):
        scans.append(
            _scan(float(t_ref), echoes.t[begin:end], xy_n[begin:end], cov_n[begin:end], motion)
        )
    return scans


def echoes_in_level_frame(echoes: Echoes, motion: PlanarMotion) -> tuple[Array, Array]:
    """Echoes and their covariances along north and east, placed by the motion."""
    position_n, yaw = motion.at(echoes.t)
    B = planar_rotations(yaw)
    xy_n = position_n + np.einsum("kij,kj->ki", B, echoes.xy_b)
    return xy_n, B @ echoes.cov_b @ np.swapaxes(B, 1, 2)


def _scan(t_ref: float, t: Array, xy_n: Array, cov_n: Array, motion: PlanarMotion) -> Scan:
    position_n, yaw = motion.at(np.array([t_ref]))
    B = planar_rotations(yaw)[0]
    xy = (xy_n - position_n[0]) @ B
    elapsed = np.abs(t - t_ref)
    drift = elapsed * motion.position_variance_m2_s
    cov = B.T @ cov_n @ B + drift[:, None, None] * np.eye(2)
    # turning about the reference moves an echo across its ray
    across = np.stack([-xy[:, 1], xy[:, 0]], axis=1)
    yaw_variance = elapsed * motion.yaw_variance_rad2_s
    cov += np.einsum("ki,kj,k->kij", across, across, yaw_variance)
    return Scan(t_ref, xy, cov)


def planar_rotations(yaw: Array) -> Array:
    """Rotations of the plane by given angles, shape (..., 2, 2)."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.stack([np.stack([c, -s], -1), np.stack([s, c], -1)], axis=-2)
