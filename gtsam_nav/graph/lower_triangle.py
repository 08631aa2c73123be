"""A symmetric matrix of which little more than the lower triangle is held."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.graph._front_kernel import PANEL


class LowerTriangle:
    """Panels of columns, each from its diagonal block down, so that all arithmetic is dense.

    Parameters
    ----------
    n : int
        Rows and columns; all zero to begin with.

    Attributes
    ----------
    entries : ndarray
        The panels one after the other, each by its columns.
    """

    def __init__(self, n: int) -> None:
        self.n = n
        self.entries = np.zeros(sum(rows * min(rows, PANEL) for rows in range(n, 0, -PANEL)))

    @classmethod
    def of(cls, whole: Array) -> LowerTriangle:
        """From a symmetric matrix; its diagonal blocks are whole."""
        triangle = cls(len(whole))
        for own, panel in triangle.panels():
            panel[:] = whole[own.start :, own]
        return triangle

    def panels(self) -> Iterator[tuple[slice, Array]]:
        """Columns of each panel, and their entries from the first one's diagonal down."""
        begin = 0
        for first in range(0, self.n, PANEL):
            rows, width = self.n - first, min(PANEL, self.n - first)
            end = begin + rows * width
            yield slice(first, first + width), self.entries[begin:end].reshape(width, rows).T
            begin = end

    def subtract_square(self, W: Array) -> None:
        """Take off ``W' W``, W being (k, n) by columns."""
        from scipy.linalg.blas import dgemm

        for own, panel in self.panels():
            dgemm(-1.0, W[:, own.start :], W[:, own], 1.0, panel, trans_a=1, overwrite_c=1)

    def times(self, G: Array) -> Array:
        """``G S`` of this matrix S, G being (k, n) by columns; its diagonal blocks are whole."""
        from scipy.linalg.blas import dgemm

        out = np.zeros(G.shape, order="F")
        for own, panel in self.panels():
            dgemm(1.0, G[:, own.start :], panel, 1.0, out[:, own], overwrite_c=1)
            below = panel[len(panel.T) :]
            if len(below):
                dgemm(1.0, G[:, own], below, 1.0, out[:, own.stop :], trans_b=1, overwrite_c=1)
        return out

    def dense(self) -> Array:
        """The whole matrix."""
        whole = np.zeros((self.n, self.n))
        for own, panel in self.panels():
            whole[own.start :, own] = panel
        return np.tril(whole) + np.tril(whole, -1).T
