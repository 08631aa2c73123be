"""What errors of the dead reckoning within a scan do to it, and to its matches.

A scan is not taken at once: its echoes are put together by the motion, whose error since the scan's
reference time grows to both ends. Unlike the echoes' noise it does not average out. Most of it
moves a scan as a whole, so that all matches of the scan share it: it belongs to the scan's own
pose. What is left bends the scan, and each match answers to it in its own way.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gtsam_nav.ekf.compounding import tail_to_tail
from gtsam_nav.frames import Array
from gtsam_nav.registration.response import response
from gtsam_nav.registration.result import PlanarMatch
from gtsam_nav.registration.settings import PicSettings
from gtsam_nav.sonar.motion import PlanarMotion
from gtsam_nav.sonar.preparation import SonarData
from gtsam_nav.sonar.scans import Scan, planar_rotations

PIECES = 4
"""Of each half of a scan, over which the error grows evenly."""

YawChanges = Callable[[Array, Array], Array]
"""Covariance (m, m), rad^2, of how the heading's error changes over m spans of time, of which the
begins and the ends are given, s."""


def walking(variance_rad2_s: float) -> YawChanges:
    """Of an error that grows as a random walk, so fast, away from the scan's reference time."""
    return lambda begin_s, end_s: variance_rad2_s * np.diag(np.abs(end_s - begin_s))


@dataclass(frozen=True)
class Distortion:
    """Displacements of a scan's echoes by independent errors of unit variance.

    Attributes
    ----------
    moved : ndarray, shape (k, 2, m)
        Of each echo in the scan's axes, m; m = 0 where all scans are taken at once.
    whole : ndarray, shape (3, m)
        Of the scan as a whole, as a match with itself would find it: x, y, yaw.
    ends : ndarray, shape (2, 2, m)
        Of the vehicle itself, at the first and at the last echo.
    """

    moved: Array
    whole: Array
    ends: Array

    @classmethod
    def none(cls, scan: Scan) -> Distortion:
        """Of a scan that is taken at once."""
        return cls(np.zeros((len(scan), 2, 0)), np.zeros((3, 0)), np.zeros((2, 2, 0)))

    @property
    def strayed(self) -> Array:
        """Of the vehicle at the last echo from the scan as a whole, and of this from the vehicle at
        the first, (2, 2, m); but for what a wrong heading does to the way."""
        whole, (first, last) = self.whole[:2], self.ends
        return np.stack([last - whole, whole - first])


def distortions(
    data: SonarData,
    motion: PlanarMotion,
    way_variance_m2: Array,
    yaw_changes: YawChanges,
    settings: PicSettings,
) -> list[Distortion]:
    """Of all scans.

    Parameters
    ----------
    data : SonarData
    motion : PlanarMotion
        That deskewed them.
    way_variance_m2 : ndarray, shape (n,)
        Of the way up to each time of the motion, along each axis, but for the heading's error.
    yaw_changes : callable
        How the heading's error changes within a scan.
    settings : PicSettings
    """
    echoes, turns = data.echoes, data.turns
    bounds = np.searchsorted(echoes.beam, np.stack([turns.first, turns.last]))
    times = [echoes.t[begin:end] for begin, end in bounds.T]
    if all(np.all(t == scan.t_ref) for t, scan in zip(times, data.scans, strict=True)):
        return [Distortion.none(scan) for scan in data.scans]
    found = []
    for scan, t in zip(data.scans, times, strict=True):
        moved, ends = _displacements(scan, t, motion, way_variance_m2, yaw_changes)
        whole, _ = response(scan, scan, np.zeros(3), moved, moved, settings)
        found.append(Distortion(moved, whole, ends))
    return found


def bending(
    a: Scan, b: Scan, match: PlanarMatch, of_a: Distortion, of_b: Distortion, settings: PicSettings
) -> tuple[Array, Array]:
    """How a match of scan b to scan a moves by the bending of either, (3, m) both.

    Poses of scans are those of their echoes: what moves a scan as a whole is none of it.
    """
    by_a, by_b = response(a, b, match.q, of_a.moved, of_b.moved, settings)
    _, J_a, _ = tail_to_tail(np.zeros(3), match.q)
    J_b = np.eye(3)
    J_b[:2, :2] = planar_rotations(match.q[2])
    return by_a + J_a @ of_a.whole, by_b + J_b @ of_b.whole


def _displacements(
    scan: Scan,
    t: Array,
    motion: PlanarMotion,
    way_variance_m2: Array,
    yaw_changes: YawChanges,
) -> tuple[Array, Array]:
    """Displacements (k, 2, m) of echoes at times (k,) by the error that each piece of time adds,
    and, by that of the way, of the vehicle at the first and the last of them (2, 2, m).

    It moves what lies beyond it, and turns it about where the vehicle then was.
    """
    since = t - scan.t_ref
    reach = np.min(since, initial=0.0), np.max(since, initial=0.0)
    edges = [np.linspace(0.0, end, PIECES + 1) for end in reach]
    begin = np.concatenate([e[:-1] for e in edges])
    length = np.concatenate([np.diff(e) for e in edges])
    passed = np.clip((since[:, None] - begin) / np.where(length == 0.0, np.inf, length), 0.0, 1.0)
    ne, yaw = motion.at(scan.t_ref + np.append(begin + 0.5 * length, 0.0))
    about = (ne[:-1] - ne[-1]) @ planar_rotations(yaw[-1])
    lever = scan.xy[:, None] - about
    variance, ways = np.linalg.eigh(yaw_changes(begin, begin + length))
    sigma_yaw = ways * np.sqrt(np.maximum(variance, 0.0))
    variance_m2 = np.diff([np.interp(scan.t_ref + e, motion.t, way_variance_m2) for e in edges])
    sigma_m = np.sqrt(np.abs(variance_m2.ravel()))
    aside = np.stack([-lever[..., 1], lever[..., 0]], axis=1)
    turned = (passed[:, None] * aside) @ sigma_yaw
    shifted = _along_both_axes(passed * sigma_m)
    not_by_turning = np.zeros((2, 2, turned.shape[2]))
    strayed = shifted[[0, -1]] if len(t) else np.zeros((2, *shifted.shape[1:]))
    ends = np.concatenate([not_by_turning, strayed], axis=2)
    return np.concatenate([turned, shifted], axis=2), ends


def _along_both_axes(moved: Array) -> Array:
    """Displacements (k, 2, 2 m) along one axis or the other of so much (k, m)."""
    still = np.zeros_like(moved)
    return np.concatenate(
        [np.stack([moved, still], axis=1), np.stack([still, moved], axis=1)], axis=2
    )
