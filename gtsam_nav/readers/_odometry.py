"""Speeds from poses: what a file of planar odometry poses says of the motion between them."""

from __future__ import annotations

import numpy as np

from gtsam_nav.frames import Array, wrap_angle


def speeds_between(t: Array, poses: Array) -> tuple[Array, Array, Array]:
    """Mean body velocity and yaw rate between successive poses.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Rising, s.
    poses : ndarray, shape (n, 3)
        x, y (m) and theta (rad), counter-clockwise.

    Returns
    -------
    middle : ndarray, shape (n - 1,)
        Stamps halfway.
    v_b : ndarray, shape (n - 1, 2)
        Forward and to starboard, m/s, of a steady turn that makes the step.
    yaw_rate : ndarray, shape (n - 1,)
        Clockwise, rad/s.
    """
    dt = np.diff(t)
    turn = wrap_angle(np.diff(poses[:, 2]))
    # in the axes halfway through the turn the chord of an arc points straight ahead
    theta = poses[:-1, 2] + turn / 2
    c, s = np.cos(theta), np.sin(theta)
    x, y = np.diff(poses[:, :2], axis=0).T
    arc_per_chord = 1.0 / np.sinc(turn / (2 * np.pi))
    v_b = np.column_stack([c * x + s * y, s * x - c * y]) * (arc_per_chord / dt)[:, None]
    return t[:-1] + dt / 2, v_b, -turn / dt
