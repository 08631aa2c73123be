"""Symmetric matrices of which the lower triangle is held, against dense linear algebra."""

from __future__ import annotations

import numpy as np
import pytest

from gtsam_nav.graph._front_kernel import PANEL
from gtsam_nav.graph.lower_triangle import LowerTriangle


@pytest.mark.parametrize("n", [0, 5, PANEL, 2 * PANEL + 40])
def test_it_is_the_dense_matrix_it_stands_for(n: int) -> None:
    rng = np.random.default_rng(n)
    whole = rng.normal(size=(n, n))
    whole = whole + whole.T
    triangle = LowerTriangle.of(whole)
    assert triangle.entries.size <= n * (n + PANEL) // 2 + PANEL
    np.testing.assert_array_equal(triangle.dense(), whole)
    rows = np.asfortranarray(rng.normal(size=(7, n)))
    np.testing.assert_allclose(triangle.times(rows), rows @ whole, atol=1e-11)
    triangle.subtract_square(rows)
    np.testing.assert_allclose(triangle.dense(), whole - rows.T @ rows, atol=1e-11)
