"""Rigid alignments of an estimate to its reference; never a scale, never a reflection."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from gtsam_nav.evaluation.matching import Matched
from gtsam_nav.frames import Array

AlignmentName = Literal["none", "start", "se2", "se3"]
ALIGNMENTS: tuple[AlignmentName, ...] = ("none", "start", "se2", "se3")

START_RADIUS_M = 30.0
"""The start alignment ends where the reference is this far from its first point."""


@dataclass(frozen=True)
class Aligned:
    """An estimate moved onto its reference.

    Attributes
    ----------
    first : int
        Index of the first sample that is scored; those before it served the fit.
    p_n : ndarray, shape (m, 3)
        Aligned antenna positions at all matched times, m.
    R, p : ndarray, shape (3, 3) and (3,)
        Rotation and translation of the fit.
    error_n : ndarray, shape (m - first, 3)
        Estimate minus reference of the scored samples, m.
    stretch_s : float
        Length of the initial stretch that was fitted but not scored, s.
    """

    first: int
    p_n: Array
    R: Array
    p: Array
    error_n: Array
    stretch_s: float

    @property
    def horizontal_m(self) -> Array:
        """Horizontal errors of the scored samples, m."""
        return np.hypot(self.error_n[:, 0], self.error_n[:, 1])


def align(matched: Matched, name: AlignmentName) -> Aligned | None:
    """Align an estimate to its reference.

    Parameters
    ----------
    matched : Matched
    name : {"none", "start", "se2", "se3"}
        ``start`` fits SE(2) on the shortest initial stretch until the reference is 30 m from its
        first point; ``se2`` and ``se3`` fit everything. SE(2) leaves the vertical as it is.

    Returns
    -------
    Aligned or None
        None where there is nothing to fit or to score.
    """
    estimate_n, reference_n = matched.estimate.p_n, matched.reference.p_n
    m = len(reference_n)
    first = _start_stretch(reference_n) if name == "start" else 0
    if m < (1 if name == "none" else 2) or first >= m:
        return None
    R, p = np.eye(3), np.zeros(3)
    if name == "se3":
        R, p = fit_rigid(estimate_n, reference_n)
    elif name != "none":
        fitted = slice(0, first or m)
        R[:2, :2], p[:2] = fit_rigid(estimate_n[fitted, :2], reference_n[fitted, :2])
    p_n = estimate_n @ R.T + p
    return Aligned(
        first=first,
        p_n=p_n,
        R=R,
        p=p,
        error_n=(p_n - reference_n)[first:],
        stretch_s=float(matched.t[max(first - 1, 0)] - matched.t[0]),
    )


def fit_rigid(source: Array, target: Array) -> tuple[Array, Array]:
    """Least-squares rotation and translation that take source points onto target points.

    Parameters
    ----------
    source, target : ndarray, shape (m, k)
        Corresponding points in k = 2 or 3 dimensions.

    Returns
    -------
    R : ndarray, shape (k, k)
        A proper rotation, even where a reflection would fit better.
    p : ndarray, shape (k,)

    Notes
    -----
    Umeyama, *Least-squares estimation of transformation parameters between two point patterns*,
    IEEE PAMI 13(4), 1991, without the scale.
    """
    source_mean, target_mean = source.mean(axis=0), target.mean(axis=0)
    U, _, Vt = np.linalg.svd((target - target_mean).T @ (source - source_mean))
    proper = np.ones(source.shape[1])
    proper[-1] = np.sign(np.linalg.det(U @ Vt))
    R = (U * proper) @ Vt
    return R, target_mean - R @ source_mean


def _start_stretch(reference_n: Array) -> int:
    """Number of samples until the reference is `START_RADIUS_M` from its first; m where never."""
    if not len(reference_n):
        return 0
    offset = reference_n[:, :2] - reference_n[0, :2]
    away = np.hypot(offset[:, 0], offset[:, 1]) >= START_RADIUS_M
    return int(np.argmax(away)) + 1 if np.any(away) else len(reference_n)
