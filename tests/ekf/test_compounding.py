"""Compounding of planar poses: what it means, and its Jacobians."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gtsam_nav.ekf.compounding import compound, inverse, tail_to_tail
from gtsam_nav.frames import Array, wrap_angle

poses = st.tuples(st.floats(-300, 300), st.floats(-300, 300), st.floats(-3.2, 3.2)).map(np.array)


def matrix(pose: Array) -> Array:
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return np.array([[c, -s, pose[0]], [s, c, pose[1]], [0, 0, 1]])


def numerical(function: Callable[[Array], Array], at: Array) -> Array:
    columns = []
    for step in 1e-5 * np.eye(3):
        difference = function(at + step) - function(at - step)
        difference[2] = wrap_angle(difference[2])
        columns.append(difference / 2e-5)
    return np.array(columns).T


@given(poses, poses)
def test_it_is_the_product_of_the_transforms(a: Array, b: Array) -> None:
    np.testing.assert_allclose(matrix(compound(a, b)[0]), matrix(a) @ matrix(b), atol=1e-9)
    np.testing.assert_allclose(matrix(inverse(a)[0]) @ matrix(a), np.eye(3), atol=1e-9)
    q = tail_to_tail(a, b)[0]
    np.testing.assert_allclose(matrix(a) @ matrix(q), matrix(b), atol=1e-9)
    for pose in (q, compound(a, b)[0], inverse(a)[0]):
        assert -np.pi <= pose[2] < np.pi


@given(poses, poses)
def test_the_jacobians_are_those_of_central_differences(a: Array, b: Array) -> None:
    for function in (compound, tail_to_tail):
        _, J_a, J_b = function(a, b)
        np.testing.assert_allclose(
            J_a, numerical(lambda x, f=function: f(x, b)[0], a), rtol=1e-6, atol=1e-6
        )
        np.testing.assert_allclose(
            J_b, numerical(lambda x, f=function: f(a, x)[0], b), rtol=1e-6, atol=1e-6
        )
    _, J = inverse(a)
    np.testing.assert_allclose(J, numerical(lambda x: inverse(x)[0], a), rtol=1e-6, atol=1e-6)
