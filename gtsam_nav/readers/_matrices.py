"""Symmetric matrices as files hold them: the upper triangle, row by row."""

from __future__ import annotations

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.series import BoolArray


def symmetric(upper: Array, size: int) -> Array:
    """Matrices (n, size, size) of their upper triangles (n, size (size + 1) / 2)."""
    row, column = np.triu_indices(size)
    matrices = np.empty((len(upper), size, size))
    matrices[:, row, column] = matrices[:, column, row] = upper
    return matrices


def upper_triangle(matrices: Array) -> Array:
    """The reverse of `symmetric`."""
    row, column = np.triu_indices(matrices.shape[1])
    return np.asarray(matrices[:, row, column])


def turn_first(matrices: Array) -> Array:
    """Matrices (n, 6, 6) of shift and turn as those of turn and shift, and back."""
    order = [3, 4, 5, 0, 1, 2]
    return np.asarray(matrices[:, order][:, :, order])


def definite(matrices: Array) -> BoolArray:
    """Which symmetric matrices, shape (n, k, k), are finite and positive definite beyond rounding:
    such have inverses."""
    finite = np.all(np.isfinite(matrices), axis=(1, 2))
    size = matrices.shape[1]
    variances = np.linalg.eigvalsh(np.where(finite[:, None, None], matrices, -np.eye(size)))
    rounding = size * np.finfo(float).eps * np.abs(variances[:, -1])
    return np.asarray(variances[:, 0] > rounding)
