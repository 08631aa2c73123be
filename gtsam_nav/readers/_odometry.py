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
    x, y = np.diff(poses[:, :2], axis=0).T
    c, s = np.cos(poses[:-1, 2]), np.sin(poses[:-1, 2])
    turn = np.diff(poses[:, 2])
    v_b, yaw_rate = step_speeds(np.column_stack([c * x + s * y, c * y - s * x, turn]), dt)
    return t[:-1] + dt / 2, v_b, yaw_rate


def step_speeds(steps: Array, dt: Array) -> tuple[Array, Array]:
    """Body velocity (n, 2) and yaw rate (n,), as `speeds_between`, of steps in dt seconds.

    ``steps``, shape (n, 3), are the later pose's x, y (m) and theta (rad, counter-clockwise) in
    the axes of the earlier.
    """
    turn = wrap_angle(steps[:, 2])
    # in the axes halfway through the turn the chord of an arc points straight ahead
    c, s = np.cos(turn / 2), np.sin(turn / 2)
    x, y = steps[:, :2].T
    arc_per_chord = 1.0 / np.sinc(turn / (2 * np.pi))
    v_b = np.column_stack([c * x + s * y, s * x - c * y]) * (arc_per_chord / dt)[:, None]
    return v_b, -turn / dt
