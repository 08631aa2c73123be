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
from typing import NamedTuple

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
LEAF_SIZE = 32
"""Points of the search tree's leaves: faster to build than scipy's 10, and no slower to search."""
CAUCHY_K = 2.385
"""Of the refinement, in spreads of the residuals: 95 % as efficient as least squares."""
MAX_STEPS, SETTLED = 6, 5e-4
"""Of the refinement: rad and m."""
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


class _Surroundings(NamedTuple):
    """What lies around m places in the reference.

    Attributes
    ----------
    place : ndarray, shape (m, 3)
        Where it was looked for.
    slack_m : ndarray, shape (m,)
        Less than so far from there the same points are the nearest, within the gate or not.
    is_paired : ndarray of bool, shape (m,)
        Whether the nearest point lies within the gate.
    centre, normal, cov_normal, is_plane : ndarray
        As `_planes` has them.
    """

    place: Array
    slack_m: Array
    is_paired: BoolArray
    centre: Array
    normal: Array
    cov_normal: Array
    is_plane: BoolArray

    def alignment(self, new: Array, placed: Array, R_ab: Array) -> Alignment:
        """Residuals of new points (m, 3), placed near where these surroundings were looked for."""
        met = self.is_paired & self.is_plane
        points, placed, normal = new[met], placed[met], self.normal[met]
        normal_b = normal @ R_ab
        return Alignment(
            residual=np.einsum("mi,mi->m", normal, placed - self.centre[met]),
            jacobian=np.hstack([np.cross(points, normal_b), normal_b]),
            cov_normal_b=R_ab.T @ self.cov_normal[met] @ R_ab,
            arm_b=points,
            place=placed,
            fitness=float(np.mean(self.is_paired)),
        )


class Surfaces:
    """Reference points (n, 3) as the planes around wherever one looks."""

    def __init__(self, reference: Array) -> None:
        from scipy.spatial import KDTree

        self.reference = reference
        # searched a few times only, it need not be balanced
        self._tree = KDTree(reference, leafsize=LEAF_SIZE, balanced_tree=False)

    def align(self, new: Array, R_ab: Array, p_a: Array, gate_m: float) -> Alignment:
        """Residuals of new points (k, 3), placed by a pose."""
        placed = new @ R_ab.T + p_a
        return self._look(placed, gate_m).alignment(new, placed, R_ab)

    def _look(self, place: Array, gate_m: float) -> _Surroundings:
        k = min(NEIGHBOURS, len(self.reference))
        found = self._tree.query(place, k=k + 1)
        distance, index = np.asarray(found[0]), np.asarray(found[1])
        nearest, last, next_one = distance[:, 0], distance[:, k - 1], distance[:, k]
        slack_m = np.minimum(0.5 * (next_one - last), np.abs(nearest - gate_m))
        planes = _planes(self.reference[index[:, :k]])
        return _Surroundings(place, slack_m, nearest < gate_m, *planes)

    def _look_again(self, around: _Surroundings, placed: Array, gate_m: float) -> None:
        """Bring surroundings up to date, in place, of places that moved too far since."""
        gone = np.linalg.norm(placed - around.place, axis=1) >= around.slack_m
        for known, found in zip(around, self._look(placed[gone], gate_m), strict=True):
            known[gone] = found

    def refine(
        self, new: Array, R_ab: Array, p_a: Array, gate_m: float
    ) -> tuple[Array, Array, Alignment]:
        """Move a pose onto the planes; returns rotation, origin, and the alignment there.

        Gauss-Newton under Cauchy weights; along what no plane tells, nothing moves (Zhang, Kaess
        and Singh, *On degeneracy of optimization-based state estimation problems*, ICRA 2016).
        """
        from scipy.spatial.transform import Rotation

        placed = new @ R_ab.T + p_a
        around = self._look(placed, gate_m)
        found = around.alignment(new, placed, R_ab)
        for _ in range(MAX_STEPS):
            if len(found.residual) < LEAST_RESIDUALS:
                break
            scale = max(CAUCHY_K * _spread(found.residual), 1e-6)
            weight = 1.0 / (1.0 + (found.residual / scale) ** 2)
            weighted = found.jacobian * weight[:, None]
            root, axes, real = _whitening(found, np.sqrt(weight))
            gradient = axes.T @ np.linalg.solve(root, weighted.T @ found.residual)
            step = -np.linalg.solve(root.T, axes @ (real * gradient))
            p_a = p_a + R_ab @ step[3:]
            R_ab = R_ab @ Rotation.from_rotvec(step[:3]).as_matrix()
            placed = new @ R_ab.T + p_a
            self._look_again(around, placed, gate_m)
            found = around.alignment(new, placed, R_ab)
            if np.max(np.abs(step)) < SETTLED:
                break
        return R_ab, p_a, found


def _planes(around: Array) -> tuple[Array, Array, Array, BoolArray]:
    """Centre, normal, the normal's covariance and flatness of groups of points, shape (m, k, 3)."""
    centre = around.mean(axis=1)
    offset = around - centre[:, None]
    scatter, axes = np.linalg.eigh(offset.mT @ offset)
    scatter = np.maximum(scatter, 1e-12)
    is_plane = scatter[:, 1] > FLATNESS * scatter[:, 0]
    # first-order perturbation of the least eigenvector: it tilts towards the two others
    noise = scatter[:, 0] / max(around.shape[1] - 3, 1)
    tilt = noise[:, None] / scatter[:, 1:]
    along = axes[:, :, 1:]
    cov_normal = (along * tilt[:, None]) @ along.mT
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
    kept = np.abs(found.residual) <= OUTLIER_SPREADS * max(_spread(found.residual), 1e-6)
    residual = found.residual[kept]
    variance = float(np.mean(residual**2)) + 1e-12
    excess = design_effect(residual, found.place[kept], BLOCK_SPACINGS * spacing_m)
    vague = np.diag([VAGUE_RAD**-2] * 3 + [VAGUE_M**-2] * 3)
    root, axes, real = _whitening(found, kept.astype(float))
    known = root @ axes * np.sqrt(real)
    information = known @ known.T
    cov = np.linalg.inv(information / (variance * excess) + vague)
    return np.asarray(0.5 * (cov + cov.T))


def design_effect(residual: Array, place: Array, block_m: float) -> float:
    """By how much the variance of a sum of residuals exceeds that of independent ones; at least 1.

    Those in one cube of side ``block_m`` count as a cluster.
    """
    cell = np.floor(place / block_m).astype(np.int64)
    _, which = np.unique(cell, axis=0, return_inverse=True)
    sums = np.bincount(which.ravel(), residual)
    return max(1.0, float(np.sum(sums**2) / max(np.sum(residual**2), 1e-12)))


def _spread(residual: Array) -> float:
    """Robust standard deviation about zero."""
    return 1.4826 * float(np.median(np.abs(residual)))


def _whitening(found: Alignment, root_weight: Array) -> tuple[Array, Array, Array]:
    """Root L of the information L L', orthogonal axes U in its coordinates, and what is real.

    The last, shape (6,), is the share of the information along each axis that the noise of the
    normals does not feign, 0 to 1: ``L U diag(real) U' L'`` is what the points truly tell.
    """
    jacobian = found.jacobian * root_weight[:, None]
    straight = np.broadcast_to(np.eye(3), found.cov_normal_b.shape)
    # the Jacobian of a residual is linear in its plane's normal
    by_normal = np.concatenate([skew(found.arm_b), straight], axis=1) * root_weight[:, None, None]
    feigned = np.einsum("mai,mij,mbj->ab", by_normal, found.cov_normal_b, by_normal, optimize=True)
    root = np.linalg.cholesky(jacobian.T @ jacobian + 1e-9 * np.eye(6))
    half = np.linalg.solve(root, feigned)
    share, axes = np.linalg.eigh(np.linalg.solve(root, half.T))
    return (
        np.asarray(root, float),
        np.asarray(axes, float),
        np.clip(1.0 - FEIGNED * share, 0.0, 1.0),
    )
