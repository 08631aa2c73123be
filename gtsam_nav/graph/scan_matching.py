"""Scan matches: which scans to compare, and which of the matches to believe."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.graph.settings import LoopSettings
from gtsam_nav.registration.pic import register
from gtsam_nav.registration.result import PlanarMatch
from gtsam_nav.registration.settings import PicSettings
from gtsam_nav.sensors.prediction import chi2_limit
from gtsam_nav.sonar.scans import Scan

PRIOR_FLOOR = np.array([0.3, 0.3, np.radians(2.0)])
"""A registration always looks at least this far (x, y, yaw) around its prior."""
PRIOR_CAP = np.array([4.0, 4.0, np.radians(20.0)])
"""And never further: from worse starts it would settle on the wrong wall."""


@dataclass(frozen=True)
class PlanarPose:
    """North, east and yaw of a keyframe, with the covariance of these three."""

    ne: Array
    yaw: float
    cov: Array


@dataclass(frozen=True)
class ScanMatch:
    """A registration of scan b to scan a, with its judgement; ``reason`` is empty if accepted."""

    a: int
    b: int
    match: PlanarMatch
    reason: str
    is_loop: bool

    @property
    def accepted(self) -> bool:
        """Whether the match may enter the graph."""
        return not self.reason


def loop_candidates(
    new: int, poses: list[PlanarPose], t_scans: Array, settings: LoopSettings
) -> list[int]:
    """Earlier scans that may show what the new one shows, nearest first.

    Distances are lessened by their uncertainty: a radius too small is the most expensive mistake.
    """
    earlier = np.flatnonzero(t_scans[:new] <= t_scans[new] - settings.min_separation_s)
    if len(earlier) == 0:
        return []
    here = poses[new]
    distance = np.array([np.linalg.norm(poses[k].ne - here.ne) for k in earlier])
    spread = np.sqrt([np.trace(poses[k].cov[:2, :2] + here.cov[:2, :2]) for k in earlier])
    near = distance - np.minimum(spread, settings.radius_m) <= settings.radius_m
    order = earlier[near][np.argsort(distance[near], kind="stable")]
    return _spread_in_time(order, t_scans, settings)


def _spread_in_time(order: np.ndarray, t_scans: Array, settings: LoopSettings) -> list[int]:
    """The nearest candidates, no two of the same passage."""
    chosen: list[int] = []
    for k in order.tolist():
        if all(abs(t_scans[k] - t_scans[c]) > settings.min_separation_s / 2 for c in chosen):
            chosen.append(k)
        if len(chosen) == settings.max_candidates:
            break
    return chosen


def match_scans(
    a: int,
    b: int,
    scans: list[Scan],
    prior: PlanarPose,
    settings: PicSettings,
    gate_probability: float | None,
    is_loop: bool,
) -> ScanMatch:
    """Register scan b to scan a and judge the result against the prior.

    Parameters
    ----------
    prior : PlanarPose
        Of b in a: ``ne`` are then forward and starboard of a.
    gate_probability : float or None
        Of the chi-square gate on prior and match together, if any.
    """
    q_prior = np.array([*prior.ne, prior.yaw])
    sigma = np.sqrt(np.diag(prior.cov))
    wanted = np.clip(sigma, PRIOR_FLOOR, PRIOR_CAP)
    cov_prior = prior.cov * np.outer(wanted / sigma, wanted / sigma)
    match = register(scans[a], scans[b], q_prior, cov_prior, settings)
    reason = match.failure
    if match.ok:
        difference = match.q - q_prior
        difference[2] = wrap_angle(difference[2])
        d2 = float(difference @ np.linalg.solve(prior.cov + match.cov, difference))
        if gate_probability is not None and d2 > chi2_limit(gate_probability, 3):
            reason = f"contradicts the estimate (chi2 {d2:.1f})"
    return ScanMatch(a, b, match, reason, is_loop)


def relative_pose(a: PlanarPose, b: PlanarPose, joint_cov: Array) -> PlanarPose:
    """Pose of b in a, with its covariance from the joint one of both, shape (6, 6)."""
    c, s = np.cos(a.yaw), np.sin(a.yaw)
    to_a = np.array([[c, s], [-s, c]])
    ne = to_a @ (b.ne - a.ne)
    J = np.zeros((3, 6))
    J[:2, :2], J[:2, 3:5] = -to_a, to_a
    J[0, 2], J[1, 2] = ne[1], -ne[0]
    J[2, 2], J[2, 5] = -1.0, 1.0
    return PlanarPose(ne, float(wrap_angle(b.yaw - a.yaw)), J @ joint_cov @ J.T)
