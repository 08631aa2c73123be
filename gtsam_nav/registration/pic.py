"""Probabilistic iterative correspondence (pIC) of two uncertain point sets.

Montesano, Minguez and Montano, *Probabilistic scan matching for motion estimation in unstructured
environments* (IROS 2005), as used by Mallios et al. 2014; the covariance of the match is the closed
form of Haralick (1998) and Censi (2007), with walls telling about the pose across themselves only.
`register` runs the compiled ``_pic_kernel`` and ``_pic_information``; `register_readable` is the
same in plain NumPy, and the oracle of their tests.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtsam_nav.frames import Array, rotation_from_rpy, rpy_from_rotation, wrap_angle
from gtsam_nav.registration.result import CloudMatch, PlanarMatch, RelativePose
from gtsam_nav.registration.settings import PicSettings
from gtsam_nav.sensors.noise import SonarNoise
from gtsam_nav.sonar.scans import Scan, planar_rotations

CONVERGED_M, CONVERGED_RAD = 1e-3, 1e-4
PLANAR = [3, 4, 2]
"""Forward, starboard and yaw in a relative pose's turn and shift."""
LEVER_M = 10.0
"""A turn moves echoes this far away: makes it comparable with a shift."""
OBSERVED_M, UNOBSERVED_M = 5.0, 100.0
"""A direction in which the points leave the pose more uncertain than the first is not observed: the
match states the second there, which is no information."""
GATE_IN_STEPS = 4.5
"""While the pose moves, the prior's part in the gate stays as wide as this many of its last steps:
who still comes from far needs a gate that reaches far, who is at rest needs none."""
GATE_FLOOR_SCALE = 1e-3
"""The gate's share of the prior covariance never shrinks below this."""


@dataclass(frozen=True)
class Pairing:
    """Partners of the new scan's points: positions, covariances, and which points have one."""

    paired: Array
    partner: Array
    cov_partner: Array
    cov_point: Array


def register(
    reference: Scan, new: Scan, prior: Array, cov_prior: Array, settings: PicSettings
) -> PlanarMatch:
    """Register a new scan to a reference scan.

    Parameters
    ----------
    reference, new : Scan
        Each in its own level frame.
    prior : ndarray, shape (3,)
        Expected pose of the new scan in the reference scan: x, y, yaw.
    cov_prior : ndarray, shape (3, 3)
        Its covariance: how far to look. It gates the association and does not enter the solution.
    settings : PicSettings

    Returns
    -------
    PlanarMatch
        With a `failure` where points or overlap were too few, points not finite, or the solution
        singular.
    """
    from gtsam_nav.registration._pic_information import information
    from gtsam_nav.registration._pic_kernel import iterate

    if reason := _unusable(reference, new):
        return _failed(prior, cov_prior, reason)
    q, paired, iterations = iterate(
        reference.xy,
        reference.cov,
        new.xy,
        new.cov,
        np.asarray(prior, dtype=float),
        np.asarray(cov_prior, dtype=float),
        settings.gate,
        settings.max_iterations,
        settings.shrink,
        GATE_IN_STEPS,
        GATE_FLOOR_SCALE,
        settings.cauchy_k,
        settings.association == "nearest",
        CONVERGED_M,
        CONVERGED_RAD,
    )
    H, M = information(
        reference.xy, reference.cov, new.xy, new.cov, q, settings.wall_radius_m, settings.cauchy_k
    )
    return _judge(q, H, M, paired / len(new), iterations, prior, cov_prior, settings)


def register_points(
    reference: Array, new: Array, prior: RelativePose, settings: PicSettings
) -> CloudMatch:
    """`register` of points (k, 3) with a sonar's usual range noise, each way; z is not looked at.

    Height, roll and pitch of the match are the prior's, with its covariance.
    """
    noise = SonarNoise().sigma_range_m ** 2 * np.eye(2)

    def planar(xyz: Array) -> Scan:
        return Scan(0.0, np.array(xyz[:, :2]), np.tile(noise, (len(xyz), 1, 1)))

    roll, pitch, yaw = rpy_from_rotation(prior.R_ab)
    turn, in_plane = planar_rotations(yaw), np.ix_(PLANAR, PLANAR)
    # x and y of the plane's match lie along the reference's axes, those of a relative pose do not
    to_a = np.eye(3)
    to_a[:2, :2] = turn
    q = np.array([prior.p_a[0], prior.p_a[1], yaw])
    cov_prior = to_a @ prior.cov[in_plane] @ to_a.T
    match = register(planar(reference), planar(new), q, cov_prior, settings)
    to_a[:2, :2] = planar_rotations(match.q[2])
    cov = prior.cov.copy()
    cov[PLANAR, :] = cov[:, PLANAR] = 0.0
    cov[in_plane] = to_a.T @ match.cov @ to_a
    R_ab = rotation_from_rpy(np.array([roll, pitch, match.q[2]]))
    p_a = np.array([match.q[0], match.q[1], prior.p_a[2]])
    return CloudMatch(RelativePose(R_ab, p_a, cov), match.overlap, match.failure)


def register_readable(
    reference: Scan, new: Scan, prior: Array, cov_prior: Array, settings: PicSettings
) -> PlanarMatch:
    """`register` in plain NumPy: slower, and meant to be read."""
    if reason := _unusable(reference, new):
        return _failed(prior, cov_prior, reason)
    q = np.array(prior, dtype=float)
    scale, iterations = 1.0, 0
    overlap = 0.0
    for iterations in range(1, settings.max_iterations + 1):  # noqa: B007
        pairing = associate(reference, new, q, cov_prior * scale, settings)
        overlap = float(pairing.paired.mean())
        H, gradient = normal_equations(new, q, pairing, settings.cauchy_k)
        if np.linalg.det(H) <= 0:
            break
        step = np.linalg.solve(H, gradient)
        q = np.array([q[0] + step[0], q[1] + step[1], wrap_angle(q[2] + step[2])])
        settled = np.hypot(step[0], step[1]) < CONVERGED_M and abs(step[2]) < CONVERGED_RAD
        if settled and scale <= GATE_FLOOR_SCALE:
            break
        moved = GATE_IN_STEPS**2 * step @ np.linalg.solve(cov_prior, step)
        scale = np.clip(moved, scale * settings.shrink, scale)
        scale = max(float(scale), GATE_FLOOR_SCALE)
    H, M = information_at(reference, new, q, settings)
    return _judge(q, H, M, overlap, iterations, prior, cov_prior, settings)


def associate(
    reference: Scan, new: Scan, q: Array, cov_gate: Array, settings: PicSettings
) -> Pairing:
    """Partner of each point: the mean of its compatible reference points, or the nearest one."""
    c, s = np.cos(q[2]), np.sin(q[2])
    B = np.array([[c, -s], [s, c]])
    placed = q[:2] + new.xy @ B.T
    cov_point = B @ new.cov @ B.T
    J = np.zeros((len(new), 2, 3))
    J[:, 0, 0] = J[:, 1, 1] = 1.0
    J[:, 0, 2], J[:, 1, 2] = -(placed[:, 1] - q[1]), placed[:, 0] - q[0]
    cov_placed = cov_point + J @ cov_gate @ np.swapaxes(J, 1, 2)
    difference = reference.xy[None] - placed[:, None]
    S = cov_placed[:, None] + reference.cov[None]
    d2 = np.einsum("nmi,nmij,nmj->nm", difference, np.linalg.inv(S), difference)
    compatible = d2 < settings.gate
    if settings.association == "nearest":
        nearest = np.argmin(d2, axis=1)
        weight = np.zeros_like(d2)
        weight[np.arange(len(new)), nearest] = compatible[np.arange(len(new)), nearest]
    else:
        weight = compatible * np.exp(-0.5 * d2) / np.sqrt(np.linalg.det(S))
    total = weight.sum(axis=1)
    paired = total > 0
    weight[paired] /= total[paired, None]
    partner = weight @ reference.xy
    spread = reference.xy[None] - partner[:, None]
    scatter = np.einsum("nm,nmi,nmj->nij", weight, spread, spread)
    cov_partner = np.einsum("nm,mij->nij", weight, reference.cov) + scatter
    return Pairing(paired, partner, cov_partner, cov_point)


def normal_equations(new: Scan, q: Array, pairing: Pairing, cauchy_k: float) -> tuple[Array, Array]:
    """Hessian and gradient of the matching cost."""
    k = pairing.paired
    c, s = np.cos(q[2]), np.sin(q[2])
    turned = new.xy[k] @ np.array([[c, s], [-s, c]])
    error = pairing.partner[k] - q[:2] - turned
    J = np.zeros((int(k.sum()), 2, 3))
    J[:, 0, 0] = J[:, 1, 1] = 1.0
    J[:, 0, 2], J[:, 1, 2] = -turned[:, 1], turned[:, 0]
    W = np.linalg.inv(pairing.cov_partner[k] + pairing.cov_point[k])
    d2 = np.einsum("ni,nij,nj->n", error, W, error)
    JtW = np.swapaxes(J, 1, 2) @ W * (1.0 / (1.0 + d2 / cauchy_k**2))[:, None, None]
    return np.sum(JtW @ J, axis=0), np.einsum("nij,nj->i", JtW, error)


def information_at(
    reference: Scan, new: Scan, q: Array, settings: PicSettings
) -> tuple[Array, Array]:
    """Hessian and its noise-driven twin at a solution, for the covariance.

    Partners slide along walls, so that agreement along a wall is no evidence: where the reference
    points around a point form a wall, it tells about the pose across that wall only. The wall's
    direction is a fit to these points; the variance of its lean lends the information along it a
    share that is taken off again. In H alone: M is the noise's own.
    """
    from gtsam_nav.registration._pic_information import WALL_ELONGATION, WALL_EXTENT, WIDER

    H, M = np.zeros((3, 3)), np.zeros((3, 3))
    B = planar_rotations(q[2])
    for turned, cov in zip(new.xy @ B.T, B @ new.cov @ B.T, strict=True):
        offset = reference.xy - q[:2] - turned
        distance = np.linalg.norm(offset, axis=1)
        around = offset[distance < settings.wall_radius_m]
        if len(around) == 0:
            continue
        if len(around) < 3:
            around = offset[distance < WIDER * settings.wall_radius_m]
        nearest = int(np.argmin(distance))
        S = cov + reference.cov[nearest]
        variances, axes = np.linalg.eigh(np.cov(around.T, bias=True).reshape(2, 2))
        normal, along = axes.T
        noise2, is_long = normal @ S @ normal, variances[1] > WALL_EXTENT * along @ S @ along
        if is_long and variances[1] > WALL_ELONGATION * max(variances[0], 0.0):
            W = np.outer(normal, normal) / noise2
            error = around.mean(axis=0)
            lean2 = max(variances[0], noise2) / (len(around) * variances[1])
            lent = lean2 * np.outer(along, along) / noise2
        else:
            W, lent = np.linalg.inv(S), np.zeros((2, 2))
            error = offset[nearest]
        J = np.array([[1.0, 0.0, -turned[1]], [0.0, 1.0, turned[0]]])
        weight = 1.0 / (1.0 + error @ W @ error / settings.cauchy_k**2)
        H += weight * J.T @ (W - lent) @ J
        M += weight**2 * J.T @ W @ J
    return H, M


def _unusable(reference: Scan, new: Scan) -> str:
    """Why these scans cannot be registered; empty where they can."""
    if min(len(reference), len(new)) < 3:
        return "fewer than three points"
    if not (np.isfinite(reference.xy).all() and np.isfinite(new.xy).all()):
        return "points that are not finite"
    return ""


def _judge(
    q: Array,
    H: Array,
    M: Array,
    overlap: float,
    iterations: int,
    prior: Array,
    cov_prior: Array,
    settings: PicSettings,
) -> PlanarMatch:
    if not np.all(np.isfinite(q)) or overlap == 0.0:
        return _failed(prior, cov_prior, "no compatible points")
    if not np.all(np.isfinite(H)):
        return _failed(prior, cov_prior, "points that are certain: their covariances are singular")
    observed, unobserved = _directions(H)
    if observed.shape[1] < 2:
        return _failed(prior, cov_prior, "singular: the points do not fix the pose")
    floor = np.array([settings.floor_xy_m, settings.floor_xy_m, np.radians(settings.floor_yaw_deg)])
    gain = observed_inverse(H)
    cov = gain @ M @ gain.T + UNOBSERVED_M**2 * unobserved @ unobserved.T + np.diag(floor**2)
    failure = ""
    if overlap < settings.min_overlap:
        failure = f"overlap {overlap:.2f} below {settings.min_overlap:.2f}"
    return PlanarMatch(q, 0.5 * (cov + cov.T), overlap, iterations, failure, unobserved.T)


def observed_inverse(H: Array) -> Array:
    """Inverse of an information in the directions that it tells of, zero in the others."""
    observed, _ = _directions(H)
    return observed @ np.linalg.inv(observed.T @ H @ observed) @ observed.T


def _directions(H: Array) -> tuple[Array, Array]:
    """Directions of x, y and yaw that an information tells of and those that it does not, in the
    columns of (3, k) and (3, 3 - k); their unit is a metre, by a shift or at the lever."""
    to_metres = np.diag([1.0, 1.0, 1.0 / LEVER_M])
    information, axes = np.linalg.eigh(to_metres @ H @ to_metres)
    told = information > 1.0 / OBSERVED_M**2
    return to_metres @ axes[:, told], to_metres @ axes[:, ~told]


def _failed(prior: Array, cov_prior: Array, reason: str) -> PlanarMatch:
    return PlanarMatch(np.array(prior, float), np.array(cov_prior, float), 0.0, 0, reason)
