"""Scan matches: which scans to compare, and which of the matches to believe."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.graph.settings import LoopSettings
from gtsam_nav.registration.pic import register
from gtsam_nav.registration.prior import looked_around
from gtsam_nav.registration.result import PlanarMatch
from gtsam_nav.registration.settings import PicSettings
from gtsam_nav.sensors.prediction import chi2_limit
from gtsam_nav.sonar.scans import Scan

SCAN_MATCH, LOOP = "sonar", "loops"
"""What factors of consecutive scans' matches come from, and those of others."""


@dataclass(frozen=True)
class PlanarPose:
    """North, east and yaw of a keyframe, with the covariance of these three."""

    ne: Array
    yaw: float
    cov: Array


@dataclass(frozen=True)
class ScanMatch:
    """A registration of scan b to scan a, with its judgement.

    Attributes
    ----------
    reason : str
        Why it is not used; empty if accepted.
    is_loop : bool
        Whether the scans do not follow each other.
    normalised_residual : float or None
        Of the judgement that rejected it, where there was one.
    is_injected : bool
        Whether it is a fault, made up rather than registered.
    """

    a: int
    b: int
    match: PlanarMatch
    reason: str
    is_loop: bool
    normalised_residual: float | None = None
    is_injected: bool = False

    @property
    def accepted(self) -> bool:
        """Whether the match may enter the graph."""
        return not self.reason

    @property
    def recorded_reason(self) -> str:
        """The reason, which says of a made-up match that it is one."""
        return f"injected {self.reason}".strip() if self.is_injected else self.reason


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
    scans: Sequence[Scan] | Mapping[int, Scan],
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
    match = register(scans[a], scans[b], q_prior, looked_around(prior.cov), settings)
    reason, residual = match.failure, None
    if match.ok:
        difference = match.q - q_prior
        difference[2] = wrap_angle(difference[2])
        d2 = float(difference @ np.linalg.solve(prior.cov + match.cov, difference))
        if gate_probability is not None and d2 > chi2_limit(gate_probability, 3):
            reason, residual = f"contradicts the estimate (chi2 {d2:.1f})", float(np.sqrt(d2))
    return ScanMatch(a, b, match, reason, is_loop, residual)


def relative_pose(a: PlanarPose, b: PlanarPose, joint_cov: Array) -> PlanarPose:
    """Pose of b in a, with its covariance from the joint one of both, shape (6, 6)."""
    q, by_a, by_b = between(np.array([*a.ne, a.yaw]), np.array([*b.ne, b.yaw]))
    J = np.hstack([by_a, by_b])
    return PlanarPose(q[:2], float(q[2]), J @ joint_cov @ J.T)


def between(a: Array, b: Array) -> tuple[Array, Array, Array]:
    """Planar pose of b in a, shape (3,), and its Jacobians in both; all are x, y and yaw."""
    c, s = np.cos(a[2]), np.sin(a[2])
    to_a = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    q = to_a @ (b - a)
    by_a = -to_a
    by_a[:2, 2] = q[1], -q[0]
    q[2] = wrap_angle(q[2])
    return q, by_a, to_a


def compounded(a: Array, b: Array) -> Array:
    """Planar pose b, given in a, in the frame that a is given in; x, y and yaw."""
    c, s = np.cos(a[2]), np.sin(a[2])
    return np.array([a[0] + c * b[0] - s * b[1], a[1] + s * b[0] + c * b[1], a[2] + b[2]])
