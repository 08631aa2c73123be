"""Planar poses and landmarks that agree best with the motion and with sightings: what association
needs of SLAM, solved again whenever it changes its mind.

Gauss-Newton on sparse normal equations; the odometry's scale error and curvature are unknowns
beside poses and landmarks. Dellaert and Kaess, *Square root SAM*, Int. J. Robotics Research 25(12),
2006. Cauchy's weights on the sightings: a false one loses its say.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.preprocess.planar_motion import Increments
from gtsam_nav.preprocess.planar_smoothing import SightedPoints
from gtsam_nav.series import IntArray

LEAST_VARIANCE = 1e-10
"""Of an increment, m^2 or rad^2: a standing vehicle still has a solvable problem."""
LEAST_SIGMA = 1e-6
"""Of the odometry's constants: what is known without error still has a finite weight."""
STEPS, LEAST_STEP = 12, 1e-3
"""Of the least squares: most, and the size (m or rad) that ends them."""
WIDTHS = (np.inf, np.inf, 100.0, 10.0)
"""Of the kernel, at first, where landmarks were merged: they pull from afar."""
CONSTANTS = 2


@dataclass(frozen=True)
class MapEstimate:
    """Where the poses and landmarks are, with the factorised information of it all.

    Attributes
    ----------
    x : ndarray, shape (m, 3)
        Poses n, e, course.
    constants : ndarray, shape (2,)
        Scale error and curvature (rad/m) of the odometry.
    landmarks : ndarray, shape (n, 2)
    squared : ndarray, shape (k,)
        Squared normalised residual of each sighting.
    """

    x: Array
    constants: Array
    landmarks: Array
    squared: Array
    _factor: Any

    def landmark_cov(self, landmarks: IntArray) -> Array:
        """Joint covariance (2 k, 2 k) of some landmarks, in their order."""
        first = CONSTANTS + self.x.size + 2 * landmarks
        rows = np.column_stack([first, first + 1]).ravel()
        unit = np.zeros((CONSTANTS + self.x.size + self.landmarks.size, len(rows)))
        unit[rows, np.arange(len(rows))] = 1.0
        return np.asarray(self._factor.solve(unit)[rows])


class PlanarMap:
    """The problem of a whole mission, or of its beginning.

    Parameters
    ----------
    increments : Increments
        Between successive poses.
    seen : SightedPoints
        In the order of their poses.
    scale_sigma, curvature_sigma : float
        As `PlanarMotion` has them.
    doubt : float
        Squared normalised residual at which a sighting counts half.
    """

    def __init__(
        self,
        increments: Increments,
        seen: SightedPoints,
        scale_sigma: float,
        curvature_sigma: float,
        doubt: float,
    ) -> None:
        self.increments, self.seen, self.doubt = increments, seen, doubt
        self._information = np.linalg.inv(seen.cov_b)
        self._constants_precision = (
            1.0 / np.maximum([scale_sigma, curvature_sigma], LEAST_SIGMA) ** 2
        )
        self.x, self.constants = np.zeros((1, 3)), np.zeros(CONSTANTS)

    def points(self, x: Array) -> Array:
        """Where the sightings from the given poses, the first ones, put their landmarks, (k, 2)."""
        k = int(np.searchsorted(self.seen.pose, len(x)))
        R = _rotations(x[self.seen.pose[:k], 2])
        return np.asarray(x[self.seen.pose[:k], :2] + np.einsum("kij,kj->ki", R, self.seen.p_b[:k]))

    def solve(self, landmark: IntArray, n_poses: int, *, merged: bool = False) -> MapEstimate:
        """Estimate the first poses and the landmarks that are seen from them.

        Parameters
        ----------
        landmark : ndarray of int, shape (k,)
            Which landmark each of the sightings from these poses is of, without gaps; -1 is none.
        merged : bool
            Whether that changed since the last solution.
        """
        x = self._extended(n_poses)
        used = np.flatnonzero(landmark >= 0)
        of = landmark[used]
        count = np.bincount(of)
        points = self.points(x)[used]
        landmarks = np.column_stack([np.bincount(of, axis) / count for axis in points.T])
        constants = self.constants
        widths = (*WIDTHS, *[1.0] * STEPS) if merged else (1.0,) * STEPS
        for width in widths:
            system = _System(CONSTANTS + x.size + landmarks.size)
            self._add_motion(system, x, constants)
            squared = self._add_sightings(system, x, landmarks, used, of, width)
            step, factor = system.solved()
            constants = constants + step[:CONSTANTS]
            x = x + step[CONSTANTS : CONSTANTS + x.size].reshape(-1, 3)
            landmarks = landmarks + step[CONSTANTS + x.size :].reshape(-1, 2)
            if width == 1.0 and np.max(np.abs(step[CONSTANTS:])) < LEAST_STEP:
                break
        self.x, self.constants = x, constants
        every = np.full(len(landmark), np.nan)
        every[used] = squared
        return MapEstimate(x, constants, landmarks, every, factor)

    def _extended(self, n_poses: int) -> Array:
        """The poses of the last solution, and those that the motion adds to them."""
        x = np.zeros((n_poses, 3))
        known = min(len(self.x), n_poses)
        x[:known] = self.x[:known]
        scale, curvature = self.constants
        for k in range(known, n_poses):
            d, c, s = self.increments.displacement_b[k - 1], *_cos_sin(x[k - 1, 2])
            x[k, :2] = x[k - 1, :2] + (1 + scale) * np.array(
                [c * d[0] - s * d[1], s * d[0] + c * d[1]]
            )
            x[k, 2] = x[k - 1, 2] + self.increments.turn[k - 1] + curvature * d[0]
        return x

    def _add_motion(self, system: _System, x: Array, constants: Array) -> None:
        m = len(x)
        own = CONSTANTS + 3 * np.arange(m - 1)[:, None] + np.arange(6)
        columns = np.column_stack([np.tile(np.arange(CONSTANTS), (m - 1, 1)), own])
        to_body = np.swapaxes(_rotations(x[:-1, 2]), 1, 2)
        moved_b = np.einsum("kij,kj->ki", to_body, np.diff(x[:, :2], axis=0))
        d, turn = self.increments.displacement_b[: m - 1], self.increments.turn[: m - 1]
        residual = np.empty((m - 1, 3))
        residual[:, :2] = moved_b - (1 + constants[0]) * d
        residual[:, 2] = wrap_angle(np.diff(x[:, 2]) - turn - constants[1] * d[:, 0])
        J = np.zeros((m - 1, 3, CONSTANTS + 6))
        J[:, :2, 0], J[:, 2, 1] = -d, -d[:, 0]
        J[:, :2, 2:4], J[:, :2, 5:7] = -to_body, to_body
        J[:, 0, 4], J[:, 1, 4] = moved_b[:, 1], -moved_b[:, 0]
        J[:, 2, 4], J[:, 2, 7] = -1.0, 1.0
        weight = 1.0 / np.maximum(self.increments.variance[: m - 1], LEAST_VARIANCE)
        system.add(columns, J, weight[:, :, None] * np.eye(3), residual)
        # the frame is that of the first pose
        fixed = np.append(np.arange(CONSTANTS), CONSTANTS + np.arange(3))
        precision = np.append(self._constants_precision, np.full(3, 1.0 / LEAST_VARIANCE))
        off = np.append(constants, x[0])
        system.add(fixed[None], np.eye(5)[None], np.diag(precision)[None], off[None])

    def _add_sightings(
        self,
        system: _System,
        x: Array,
        landmarks: Array,
        used: IntArray,
        of: IntArray,
        width: float,
    ) -> Array:
        pose = self.seen.pose[used]
        to_body = np.swapaxes(_rotations(x[pose, 2]), 1, 2)
        seems_b = np.einsum("kij,kj->ki", to_body, landmarks[of] - x[pose, :2])
        residual = seems_b - self.seen.p_b[used]
        J = np.zeros((len(used), 2, 5))
        J[:, :, :2], J[:, :, 3:] = -to_body, to_body
        J[:, 0, 2], J[:, 1, 2] = seems_b[:, 1], -seems_b[:, 0]
        information = self._information[used]
        squared = np.einsum("ki,kij,kj->k", residual, information, residual)
        weight = 1.0 / (1.0 + squared / (width * self.doubt))
        columns = np.column_stack(
            [
                CONSTANTS + 3 * pose[:, None] + np.arange(3),
                CONSTANTS + x.size + 2 * of[:, None] + np.arange(2),
            ]
        )
        system.add(columns, J, weight[:, None, None] * information, residual)
        return np.asarray(squared)


class _System:
    """Sparse normal equations."""

    def __init__(self, size: int) -> None:
        self._gradient = np.zeros(size)
        self._rows: list[IntArray] = []
        self._columns: list[IntArray] = []
        self._entries: list[Array] = []

    def add(self, columns: IntArray, J: Array, information: Array, residual: Array) -> None:
        """Terms of k factors: columns (k, n), J (k, m, n), information (k, m, m) and residual."""
        JtW = np.swapaxes(J, 1, 2) @ information
        n = columns.shape[1]
        self._rows.append(np.repeat(columns, n, axis=1).ravel())
        self._columns.append(np.tile(columns, (1, n)).ravel())
        self._entries.append((JtW @ J).ravel())
        np.add.at(self._gradient, columns, (JtW @ residual[..., None])[..., 0])

    def solved(self) -> tuple[Array, Any]:
        """The step to the optimum, and the factorised matrix."""
        from scipy.sparse import csc_array
        from scipy.sparse.linalg import splu

        where = np.concatenate(self._rows), np.concatenate(self._columns)
        size = len(self._gradient)
        H = csc_array((np.concatenate(self._entries), where), shape=(size, size))
        options = {"SymmetricMode": True}
        factor = splu(H, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
        return -np.asarray(factor.solve(self._gradient)), factor


def _cos_sin(angle: float) -> tuple[float, float]:
    return float(np.cos(angle)), float(np.sin(angle))


def _rotations(angle: Array) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.moveaxis(np.array([[c, -s], [s, c]]), 2, 0)
