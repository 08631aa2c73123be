"""What two aligned point sets tell about their relative pose: the covariance of a cloud match.

Points slide along surfaces, so that agreement tells about the pose across a surface only: the
information is that of point-to-plane residuals, wherever the reference is locally plane, whichever
cost the minimiser had. Normals are noisy too, and many of them feign information along a corridor:
what their noise alone would give is taken off, so that the way along stays as unknown as it is. The
noise is the spread of the residuals found, and grows by how much neighbouring residuals err
together, measured on them too (the design effect of cluster sampling, Kish 1965).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtsam_nav.frames import Array, skew
from gtsam_nav.series import BoolArray

NEIGHBOURS = 10
"""Reference points that a plane is fitted to."""
FLATNESS = 9.0
"""Surroundings are a plane where their least variance is smaller than the next by this factor."""
OUTLIER_SPREADS = 3.0
"""Residuals beyond so many robust standard deviations are of points that have no true partner."""
BLOCK_SPACINGS = 8.0
"""Residuals within a cube of so many spacings of points are taken to err together."""
FEIGNED = 2.0
"""Information counts beyond so many times what the noise of the normals is expected to feign."""
LEAST_RESIDUALS = 20
VAGUE_RAD, VAGUE_M = 1.0, 10.0
"""Spread of what a match says nothing about."""


@dataclass(frozen=True)
class Alignment:
    """Point-to-plane residuals of aligned points.

    Attributes
    ----------
    residual : ndarray, shape (m,)
        Of the points that met a plane of the reference, m.
    jacobian : ndarray, shape (m, 6)
        By a turn and a shift of the new points, along their own axes.
    cov_normal_b : ndarray, shape (m, 3, 3)
        Of the plane's unit normal, along the new points' axes.
    arm_b : ndarray, shape (m, 3)
        The points themselves, along the same axes, m.
    place : ndarray, shape (m, 3)
        The points in the reference.
    fitness : float
        Share of all new points that have a partner within the gate.
    """

    residual: Array
    jacobian: Array
    cov_normal_b: Array
    arm_b: Array
    place: Array
    fitness: float


def alignment(reference: Array, new: Array, R_ab: Array, p_a: Array, gate_m: float) -> Alignment:
    """Residuals of new points (k, 3), placed by a pose, against a reference (n, 3)."""
    from scipy.spatial import KDTree

    placed = new @ R_ab.T + p_a
    k = min(NEIGHBOURS, len(reference))
    found = KDTree(reference).query(placed, k=k)
    distance, index = np.reshape(found[0], (-1, k)), np.reshape(found[1], (-1, k))
    paired = distance[:, 0] < gate_m
    centre, normal, cov_normal, is_plane = _planes(reference[index[paired]])
    points, placed = new[paired][is_plane], placed[paired][is_plane]
    centre, normal, cov_normal = centre[is_plane], normal[is_plane], cov_normal[is_plane]
    normal_b = normal @ R_ab
    return Alignment(
        residual=np.einsum("mi,mi->m", normal, placed - centre),
        jacobian=np.hstack([np.cross(points, normal_b), normal_b]),
        cov_normal_b=R_ab.T @ cov_normal @ R_ab,
        arm_b=points,
        place=placed,
        fitness=float(np.mean(paired)),
    )


def _planes(around: Array) -> tuple[Array, Array, Array, BoolArray]:
    """Centre, normal, the normal's covariance and flatness of groups of points, shape (m, k, 3)."""
    centre = around.mean(axis=1)
    offset = around - centre[:, None]
    scatter, axes = np.linalg.eigh(np.einsum("mki,mkj->mij", offset, offset))
    scatter = np.maximum(scatter, 1e-12)
    is_plane = scatter[:, 1] > FLATNESS * scatter[:, 0]
    # first-order perturbation of the least eigenvector: it tilts towards the two others
    noise = scatter[:, 0] / max(around.shape[1] - 3, 1)
    tilt = noise[:, None] / scatter[:, 1:]
    cov_normal = np.einsum("mia,ma,mja->mij", axes[:, :, 1:], tilt, axes[:, :, 1:])
    return centre, axes[:, :, 0], cov_normal, np.asarray(is_plane)


def match_covariance(found: Alignment, spacing_m: float) -> Array | None:
    """Covariance (6, 6) of the pose as in `RelativePose`; None where too few points met a plane.

    Parameters
    ----------
    found : Alignment
    spacing_m : float
        Typical distance between neighbouring points.
    """
    if len(found.residual) < LEAST_RESIDUALS:
        return None
    middle = np.median(found.residual)
    spread = 1.4826 * float(np.median(np.abs(found.residual - middle)))
    kept = np.abs(found.residual) <= OUTLIER_SPREADS * max(spread, abs(float(middle)), 1e-6)
    residual, jacobian = found.residual[kept], found.jacobian[kept]
    variance = float(np.mean(residual**2)) + 1e-12
    excess = design_effect(residual, found.place[kept], BLOCK_SPACINGS * spacing_m)
    vague = np.diag([VAGUE_RAD**-2] * 3 + [VAGUE_M**-2] * 3)
    information = _information(jacobian, found.arm_b[kept], found.cov_normal_b[kept])
    cov = np.linalg.inv(information / (variance * excess) + vague)
    return np.asarray(0.5 * (cov + cov.T))


def _information(jacobian: Array, arm_b: Array, cov_normal_b: Array) -> Array:
    """Sum of the residuals' outer products, shape (6, 6), without what noisy normals feign."""
    whole = jacobian.T @ jacobian + 1e-9 * np.eye(6)
    straight = np.broadcast_to(np.eye(3), cov_normal_b.shape)
    by_normal = np.concatenate([skew(arm_b), straight], axis=1)
    feigned = np.einsum("mai,mij,mbj->ab", by_normal, cov_normal_b, by_normal)
    root = np.linalg.cholesky(whole)
    half = np.linalg.solve(root, feigned)
    share, axes = np.linalg.eigh(np.linalg.solve(root, half.T))
    kept = root @ axes * np.sqrt(np.maximum(1.0 - FEIGNED * share, 0.0))
    return np.asarray(kept @ kept.T)


def design_effect(residual: Array, place: Array, block_m: float) -> float:
    """By how much the variance of a sum of residuals exceeds that of independent ones; at least 1.

    Those in one cube of side ``block_m`` count as a cluster.
    """
    cell = np.floor(place / block_m).astype(np.int64)
    _, which = np.unique(cell, axis=0, return_inverse=True)
    sums = np.bincount(which.ravel(), residual)
    return max(1.0, float(np.sum(sums**2) / max(np.sum(residual**2), 1e-12)))
