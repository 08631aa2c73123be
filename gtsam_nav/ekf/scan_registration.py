"""Registration of scans from an uncertain displacement, and the record of what became of it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gtsam_nav.ekf.distortion import bending
from gtsam_nav.ekf.scan_track import ScanTrack
from gtsam_nav.frames import Array
from gtsam_nav.mission import Rejection
from gtsam_nav.registration.pic import register
from gtsam_nav.registration.prior import looked_around
from gtsam_nav.registration.result import PlanarMatch
from gtsam_nav.registration.settings import PicSettings
from gtsam_nav.solution import LoopClosure


@dataclass(frozen=True)
class ScanMatch:
    """A registration of scan b to scan a.

    Attributes
    ----------
    reason : str
        Why it was not used, empty if it was.
    whitened : ndarray, shape (3,), or None
        The innovation in uncorrelated standard deviations, where it came to that.
    """

    a: int
    b: int
    match: PlanarMatch
    reason: str
    whitened: Array | None = None

    @property
    def accepted(self) -> bool:
        """Whether the match was used."""
        return not self.reason

    @property
    def nis(self) -> float:
        """Normalised innovation squared; not a number where there is none."""
        return np.nan if self.whitened is None else float(self.whitened @ self.whitened)

    def as_loop(self, track: ScanTrack) -> LoopClosure:
        """For the record of candidates."""
        # a registration that never ran has nothing to report
        tried = 1.0 if self.match.iterations else np.nan
        dx, dy, dyaw = (tried * self.match.q).tolist()
        sigma_x, sigma_y, sigma_yaw = (tried * np.sqrt(np.diag(self.match.cov))).tolist()
        return LoopClosure(
            t_a=float(track.t[self.a]),
            t_b=float(track.t[self.b]),
            dx_m=dx,
            dy_m=dy,
            dyaw=dyaw,
            sigma_x_m=sigma_x,
            sigma_y_m=sigma_y,
            sigma_yaw=sigma_yaw,
            score=self.match.overlap,
            verdict="accepted" if self.accepted else "rejected",
            reason=self.reason,
        )

    def as_rejection(self, track: ScanTrack) -> Rejection:
        """For the record of measurements that were not used: scan b by its middle beam."""
        turns, sonar = track.sonar.turns, track.instrument
        middle = (turns.first[self.b] + turns.last[self.b]) // 2
        residual = float(np.sqrt(self.nis)) if np.isfinite(self.nis) else None
        t, row = float(track.t[self.b]), int(sonar.series.row[middle])
        return Rejection(t, sonar.name, row, f"scan match: {self.reason}", residual)


def register_scans(
    track: ScanTrack, a: int, b: int, prior: Array, cov_prior: Array, settings: PicSettings
) -> tuple[PlanarMatch, tuple[Array, Array]]:
    """Register scan b to scan a; the covariance counts how the motion bends both.

    Parameters
    ----------
    prior : ndarray, shape (3,)
        Expected pose of b in a.
    cov_prior : ndarray, shape (3, 3)
        Its covariance, which says how far to look.

    Returns
    -------
    match : PlanarMatch
    bends : tuple of ndarray, shape (3, m) both
        How it answers to the errors of the motion within a and within b.
    """
    scans, distorted = track.sonar.scans, (track.distortions[a], track.distortions[b])
    unbent = np.zeros_like(distorted[0].whole), np.zeros_like(distorted[1].whole)
    if min(len(scans[a]), len(scans[b])) < track.min_points:
        match = PlanarMatch(prior, cov_prior, 0.0, 0, f"fewer than {track.min_points} points")
        return match, unbent
    match = register(scans[a], scans[b], prior, looked_around(cov_prior), settings)
    if not match.ok:
        return match, unbent
    bends = bending(scans[a], scans[b], match, *distorted, settings)
    return replace(match, cov=match.cov + sum(by @ by.T for by in bends)), bends
