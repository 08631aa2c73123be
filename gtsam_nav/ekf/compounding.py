"""Planar poses (x, y, yaw) put together and taken apart, with their Jacobians.

Smith, Self and Cheeseman, *Estimating uncertain spatial relationships in robotics* (1990): the
compounding of two displacements, the inverse of one, and the displacement between two poses.
"""

from __future__ import annotations

import numpy as np

from gtsam_nav.frames import Array, wrap_angle


def compound(a: Array, b: Array) -> tuple[Array, Array, Array]:
    """Pose b, given in pose a, in the frame of a: ``a (+) b`` with its Jacobians in a and b.

    Parameters
    ----------
    a, b : ndarray, shape (3,)
        Metres and radians.
    """
    c, s = np.cos(a[2]), np.sin(a[2])
    turned = np.array([c * b[0] - s * b[1], s * b[0] + c * b[1]])
    pose = np.array([a[0] + turned[0], a[1] + turned[1], wrap_angle(a[2] + b[2])])
    J_a = np.array([[1.0, 0.0, -turned[1]], [0.0, 1.0, turned[0]], [0.0, 0.0, 1.0]])
    J_b = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return pose, J_a, J_b


def inverse(a: Array) -> tuple[Array, Array]:
    """The frame of pose a as seen from a: ``(-) a`` with its Jacobian."""
    c, s = np.cos(a[2]), np.sin(a[2])
    x, y = -c * a[0] - s * a[1], s * a[0] - c * a[1]
    J = np.array([[-c, -s, y], [s, -c, -x], [0.0, 0.0, -1.0]])
    return np.array([x, y, wrap_angle(-a[2])]), J


def tail_to_tail(a: Array, b: Array) -> tuple[Array, Array, Array]:
    """Pose b in pose a, both given in one frame: ``(-) a (+) b`` with its Jacobians in a and b."""
    from_a, J_inverse = inverse(a)
    q, J_from_a, J_b = compound(from_a, b)
    return q, J_from_a @ J_inverse, J_b
