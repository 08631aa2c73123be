"""Loops between 3-D clouds: where the settled estimate says that the same place was seen again.

Where the estimate tells the relative pose well enough, generalised ICP begins there; else at what
features and RANSAC find. A match that contradicts the estimate more than both uncertainties allow
is no loop. What is accepted sharpens the estimate, so the search goes on until it finds no more.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from gtsam_nav.config import Config
from gtsam_nav.errors import PackageError
from gtsam_nav.frames import Array, rpy_from_rotation
from gtsam_nav.graph import factors
from gtsam_nav.graph.backend import Covariances, graph_of
from gtsam_nav.graph.factors import X
from gtsam_nav.graph.measurements.clouds import cloud_keyframes
from gtsam_nav.graph.problem import Problem, SensorFactor
from gtsam_nav.graph.robust import Robustness
from gtsam_nav.graph.settings import CloudLoopSettings
from gtsam_nav.graph.settling import Settled, settle
from gtsam_nav.odometry.cloud_track import CloudTrack, adjoint
from gtsam_nav.registration import register
from gtsam_nav.registration.open3d_global import global_start
from gtsam_nav.registration.result import CloudMatch, RelativePose
from gtsam_nav.registration.settings import Open3dSettings
from gtsam_nav.sensors.prediction import chi2_limit
from gtsam_nav.solution import LoopClosure, Progress

log = logging.getLogger(__name__)

CLOUD_LOOP = "cloud loops"
"""What these are called among the sensors."""
MAX_ROUNDS = 3
ICP_REACH_VOXELS = 4.0
ICP_REACH_RAD = np.radians(8.0)
"""From starts that are further off, at three sigma, ICP may settle on the wrong surface."""


@dataclass(frozen=True)
class CloudLoop:
    """A registration of keyframe b's cloud to keyframe a's, with its judgement."""

    a: int
    b: int
    match: CloudMatch
    reason: str

    @property
    def accepted(self) -> bool:
        """Whether it is in the graph."""
        return not self.reason


@dataclass
class CloudLoops:
    """All loops of a mission's clouds, and what became of the estimate.

    Attributes
    ----------
    settled : Settled
        With them.
    loops : list of CloudLoop
    entries : list of SensorFactor
        Factors of the accepted ones.
    warnings : list of str
    """

    settled: Settled
    loops: list[CloudLoop] = field(default_factory=list)
    entries: list[SensorFactor] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)


def close_cloud_loops(
    problem: Problem,
    track: CloudTrack | None,
    others: list[SensorFactor],
    settled: Settled,
    config: Config,
    progress: Progress,
) -> CloudLoops:
    """Find loops between clouds and settle the estimate with them.

    Parameters
    ----------
    others : list of SensorFactor
        Everything but the readings.
    settled : Settled
        The estimate without loops between clouds.
    """
    done = CloudLoops(settled)
    if track is None:
        return done
    tried: set[tuple[int, int]] = set()
    try:
        for _ in range(MAX_ROUNDS):
            found = _search(problem, track, others, done, tried, config, progress)
            done.loops += found
            accepted = [loop for loop in found if loop.accepted]
            if not accepted:
                break
            for loop in accepted:
                factor = factors.relative_pose(X(loop.a), X(loop.b), loop.match.pose)
                done.entries.append(SensorFactor(CLOUD_LOOP, factor, config.graph.robust.loops))
            done.settled = settle(problem, [*others, *done.entries], done.settled.values)
    except PackageError as error:
        log.warning("%s", error)
        done.warnings.append(f"no loops between clouds: {error}")
    return done


def _search(
    problem: Problem,
    track: CloudTrack,
    others: list[SensorFactor],
    done: CloudLoops,
    tried: set[tuple[int, int]],
    config: Config,
    progress: Progress,
) -> list[CloudLoop]:
    """Register what may be a loop by the present estimate and was not tried yet."""
    values = done.settled.values
    whole = graph_of([*others, *done.entries])
    whole.push_back(done.settled.factors)
    covariances = Covariances(whole, values, problem.is_stiff)
    keyframe = cloud_keyframes(problem, track)
    s, probability = config.graph.cloud_loops, config.graph.robust.loops.gate_probability
    pairs = _candidates(track, keyframe, values, covariances, s)
    found = []
    settings = config.open3d.model_copy(update={"voxel_m": 0.5 * config.kiss.voxel_m})
    for n, (i, j) in enumerate(pairs):
        if (i, j) not in tried:
            tried.add((i, j))
            prior = relative_prior(values, covariances, keyframe[i], keyframe[j])
            match = match_clouds(track.submap(i), track.submap(j), prior, settings)
            reason = match.failure or contradiction(prior, match, probability)
            found.append(CloudLoop(keyframe[i], keyframe[j], match, reason))
        progress("cloud loops", (n + 1) / len(pairs))
    return found


def _candidates(
    track: CloudTrack,
    keyframe: dict[int, int],
    values: Any,
    covariances: Covariances,
    s: CloudLoopSettings,
) -> list[tuple[int, int]]:
    """Pairs of kept clouds, the earlier first, that may show the same place."""
    chosen, last_s = [], -np.inf
    index = np.array(list(keyframe))
    t = np.array([track.key[j].t for j in index])
    p_n = np.array([values.atNavState(X(k)).position() for k in keyframe.values()])
    cov = [covariances.joint([X(k)])[3:5, 3:5] for k in keyframe.values()]
    spread = np.sqrt([float(np.trace(c)) for c in cov])
    for m in range(len(index)):
        if t[m] - last_s < s.interval_s:
            continue
        last_s = float(t[m])
        distance = np.linalg.norm(p_n[:m, :2] - p_n[m, :2], axis=1)
        allowed = s.radius_m + np.minimum(np.hypot(spread[:m], spread[m]), s.radius_m)
        near = (distance <= allowed) & (t[:m] <= t[m] - s.min_separation_s)
        order = np.flatnonzero(near)[np.argsort(distance[near], kind="stable")]
        passages: list[int] = []
        for k in order.tolist():
            if all(abs(t[k] - t[c]) > s.min_separation_s / 2 for c in passages):
                passages.append(k)
        chosen += [(int(index[k]), int(index[m])) for k in passages[: s.max_candidates]]
    return chosen


def relative_prior(values: Any, covariances: Covariances, a: int, b: int) -> RelativePose:
    """Pose of keyframe b in keyframe a by the estimate, with its covariance."""
    state_a, state_b = values.atNavState(X(a)), values.atNavState(X(b))
    R_a, R_b = state_a.attitude().matrix(), state_b.attitude().matrix()
    R_ab, p_a = R_a.T @ R_b, R_a.T @ (state_b.position() - state_a.position())
    pose = [0, 1, 2, 3, 4, 5, 9, 10, 11, 12, 13, 14]
    joint = covariances.joint([X(a), X(b)])[np.ix_(pose, pose)]
    # a turn and shift of a moves b in a the other way
    J = np.hstack([-adjoint(R_ab.T, -R_ab.T @ p_a), np.eye(6)])
    return RelativePose(R_ab, p_a, J @ joint @ J.T)


def match_clouds(
    reference: Array, new: Array, prior: RelativePose, settings: Open3dSettings
) -> CloudMatch:
    """Register two submaps from the prior, or from anywhere where the prior is vague."""
    if min(len(reference), len(new)) < settings.min_points:  # Open3D finds no features in none
        return CloudMatch(prior, 0.0, f"fewer than {settings.min_points} points")
    sigma = np.sqrt(np.diag(prior.cov))
    start = prior
    far = 3 * sigma[3:].max() > ICP_REACH_VOXELS * settings.voxel_m
    if far or 3 * sigma[:3].max() > ICP_REACH_RAD:
        T_ab = global_start(reference, new, settings)
        if T_ab is None:
            return CloudMatch(prior, 0.0, "no features agree")
        start = RelativePose(T_ab[:3, :3], T_ab[:3, 3], prior.cov)
    return register("open3d-gicp", reference, new, start, settings)


def contradiction(prior: RelativePose, match: CloudMatch, gate_probability: float | None) -> str:
    """Why a match cannot be true if the prior is; empty where it can, and without a gate."""
    if gate_probability is None:
        return ""
    e = prior.error_of(match.pose.R_ab, match.pose.p_a)
    d2 = float(e @ np.linalg.solve(prior.cov + match.pose.cov, e))
    if d2 <= chi2_limit(gate_probability, 6):
        return ""
    return f"contradicts the estimate (chi2 {d2:.1f})"


def cloud_loop_closures(
    loops: list[CloudLoop], problem: Problem, values: Any, robustness: Robustness
) -> tuple[LoopClosure, ...]:
    """The loops as rows of ``loops.csv``: their planar part."""
    rows = []
    for loop in loops:
        pose, tried = loop.match.pose, 1.0 if loop.match.fitness > 0 else np.nan
        yaw = float(rpy_from_rotation(pose.R_ab)[2])
        sigma = np.sqrt(np.diag(pose.cov))
        rows.append(
            LoopClosure(
                t_a=float(problem.t[loop.a]),
                t_b=float(problem.t[loop.b]),
                dx_m=tried * float(pose.p_a[0]),
                dy_m=tried * float(pose.p_a[1]),
                dyaw=tried * yaw,
                sigma_x_m=tried * float(sigma[3]),
                sigma_y_m=tried * float(sigma[4]),
                sigma_yaw=tried * float(sigma[2]),
                score=loop.match.fitness,
                verdict="accepted" if loop.accepted else "rejected",
                reason=loop.reason,
                weight=loop_weight(loop, values, robustness) if loop.accepted else None,
            )
        )
    return tuple(rows)


def loop_weight(loop: CloudLoop, values: Any, robustness: Robustness) -> float:
    """What the robust kernel leaves of a loop at given values."""
    a, b = (values.atNavState(X(k)) for k in (loop.a, loop.b))
    R_a = a.attitude().matrix()
    e = loop.match.pose.error_of(
        R_a.T @ b.attitude().matrix(), R_a.T @ (b.position() - a.position())
    )
    d2 = float(e @ np.linalg.solve(loop.match.pose.cov, e))
    return factors.weight(robustness, d2**0.5)
