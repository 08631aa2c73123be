"""The trajectory between keyframes, on the sensors that fill the time between them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from gtsam_nav.frames import (
    Array,
    quaternion_from_rotation,
    rotation_from_quaternion,
    rotation_from_rpy,
    wrap_angle,
)
from gtsam_nav.graph.bridge import Bridge, inertial_bridge, joint_of_neighbours, steady_bridge
from gtsam_nav.graph.carried import Carried, carried, coasted, joined
from gtsam_nav.graph.factors import B, X
from gtsam_nav.graph.preintegration import InertialStep
from gtsam_nav.graph.problem import Problem
from gtsam_nav.trajectory import Trajectory

TANGENT = np.r_[0:3, 6:9, 3:6]
"""Attitude, velocity and position where GTSAM has attitude, position and velocity."""
AT_ONCE = 64
"""So many intervals together: their covariances are no small matter."""
POSE = np.r_[6:9, 0:3]
"""Position, then attitude, among attitude, velocity and position."""


def dense_trajectory(
    problem: Problem, values: Any, keyframes: Trajectory, covariances: Mapping[int, Array]
) -> Trajectory:
    """Keyframes and what is between: by the IMU where there is one that is fast enough, else by the
    vehicle's own motion.

    Parameters
    ----------
    covariances : mapping of int to ndarray, shape (9, 9)
        Of each keyframe's tangent, by its key.
    """
    if problem.uses_imu:
        return _along_imu(problem, values, keyframes, covariances)
    return _along_motion(problem, keyframes)


def _dense_times(problem: Problem, t_key: Array) -> Array:
    """The motion's times and the keyframes'."""
    inside = problem.motion.t[(problem.motion.t >= t_key[0]) & (problem.motion.t <= t_key[-1])]
    beside = t_key[np.clip(np.searchsorted(t_key, inside - 1e-6), 0, len(t_key) - 1)]
    return np.unique(np.concatenate([inside[np.abs(beside - inside) > 1e-6], t_key]))


def _along_motion(problem: Problem, keyframes: Trajectory) -> Trajectory:
    """The vehicle's own motion, corrected between keyframes as the refinement does.

    Each of the two keyframes around a time carries the motion along, turned by its own correction;
    the result lies between the two by the time's fraction of the interval. The smoothed velocity is
    as uncertain as where it was read, whatever more the keyframes know or lack (their heading).
    """
    assert keyframes.v_n is not None
    assert keyframes.cov_pose_n is not None
    assert keyframes.sigma_v_n is not None
    motion, t_key = problem.motion, keyframes.t
    t = _dense_times(problem, t_key)
    before = np.clip(np.searchsorted(t_key, t, side="right") - 1, 0, len(t_key) - 2)
    f = ((t - t_key[before]) / (t_key[before + 1] - t_key[before]))[:, None]
    p_own, rpy_own = motion.at(t)
    p_key, rpy_key = motion.at(t_key)
    # one that grows past half a turn goes on between two keyframes
    turn = np.unwrap(wrap_angle(keyframes.rpy - rpy_key), axis=0)
    heading_turns = rotation_from_rpy(turn * [0.0, 0.0, 1.0])
    ends = [
        keyframes.p_n[k] + np.einsum("nij,nj->ni", heading_turns[k], p_own - p_key[k])
        for k in (before, before + 1)
    ]
    v_b = np.stack([np.interp(t, motion.t, axis) for axis in motion.v_b.T], axis=1)
    v_b_key = np.stack([np.interp(t_key, motion.t, axis) for axis in motion.v_b.T], axis=1)
    v_gap = keyframes.v_n - np.einsum("nij,nj->ni", keyframes.R_nb, v_b_key)
    R_nb = rotation_from_rpy(rpy_own + _between(t, t_key, turn))
    own2, own2_key = (np.interp(at, motion.t, motion.sigma_v)[:, None] ** 2 for at in (t, t_key))
    more = _between(t, t_key, keyframes.sigma_v_n**2 - own2_key)
    return Trajectory(
        t=t,
        p_n=(1 - f) * ends[0] + f * ends[1],
        q_nb_wxyz=quaternion_from_rotation(R_nb),
        v_n=np.einsum("nij,nj->ni", R_nb, v_b) + _between(t, t_key, v_gap),
        cov_pose_n=_between(t, t_key, keyframes.cov_pose_n.reshape(-1, 36)).reshape(-1, 6, 6),
        sigma_v_n=np.sqrt(np.maximum(own2 + more, 0.0)),
        keyframe=np.isin(t, t_key),
    )


def _along_imu(
    problem: Problem, values: Any, keyframes: Trajectory, covariances: Mapping[int, Array]
) -> Trajectory:
    """The IMU's readings from each keyframe on; what they miss the next one by is spread."""
    t_key = keyframes.t
    t = _dense_times(problem, t_key)
    bounds = np.searchsorted(t, t_key, side="right")
    bounds[0] = 0  # the first keyframe's own time goes with the first interval
    cov_n = _covariances_n(keyframes.R_nb, [covariances[X(k)] for k in range(len(t_key))])
    parts = []
    for first in range(1, len(t_key), AT_ONCE):
        ks = range(first, min(first + AT_ONCE, len(t_key)))
        own = [t[bounds[k - 1] : bounds[k]] for k in ks]
        parts.append(_intervals(problem, values, keyframes, cov_n, ks, own))
    R_nb, p_n, v_n, cov_pose_n, sigma_v_n = (
        np.concatenate(columns) for columns in zip(*parts, strict=True)
    )
    return Trajectory(
        t=t,
        p_n=p_n,
        q_nb_wxyz=quaternion_from_rotation(R_nb),
        v_n=v_n,
        cov_pose_n=cov_pose_n,
        sigma_v_n=sigma_v_n,
        keyframe=np.isin(t, t_key),
    )


def _covariances_n(R_nb: Array, covariances: list[Array]) -> Array:
    """Covariances of keyframes, of attitude, velocity and position along n, shape (n, 9, 9)."""
    to_n = np.zeros((len(R_nb), 9, 9))
    for part in (slice(0, 3), slice(3, 6), slice(6, 9)):
        to_n[:, part, part] = R_nb
    turned = to_n @ np.array(covariances) @ np.swapaxes(to_n, 1, 2)
    return np.asarray(turned[:, TANGENT[:, None], TANGENT])


def _intervals(
    problem: Problem, values: Any, keyframes: Trajectory, cov_n: Array, ks: range, t: list[Array]
) -> tuple[Array, Array, Array, Array, Array]:
    """Attitude, position and velocity at times into some keyframes, the last of each of which is
    the keyframe's own, with the covariance of the pose and the sigmas of the velocity."""
    from scipy.spatial.transform import Rotation

    assert keyframes.v_n is not None
    on_way = _carried(problem, values, ks, t)
    R_nb, v_n, p_n = on_way.R_nb, on_way.v_n, on_way.p_n
    last, into = np.cumsum([len(own) for own in t]) - 1, np.array(ks)
    gained = v_n[last] - keyframes.v_n[into - 1]
    bridges = [_bridge(problem, k, own, by) for k, own, by in zip(ks, t, gained, strict=True)]
    links = np.array([_link(problem, k, bridge) for k, bridge in zip(ks, bridges, strict=True)])
    joint = joint_of_neighbours(cov_n[into - 1], cov_n[into], links)
    R_into = rotation_from_quaternion(keyframes.q_nb_wxyz[into])
    turned = R_into @ np.swapaxes(R_nb[last], 1, 2)
    speed, shift = keyframes.v_n[into] - v_n[last], keyframes.p_n[into] - p_n[last]
    missed = np.hstack([Rotation.from_matrix(turned).as_rotvec(), speed, shift])
    put_right = np.concatenate(
        [bridge.by_end @ by for bridge, by in zip(bridges, missed, strict=True)]
    )
    turn, speed, shift = np.split(put_right, 3, axis=1)
    cov = np.concatenate([b.covariance(both) for b, both in zip(bridges, joint, strict=True)])
    return (
        Rotation.from_rotvec(turn).as_matrix() @ R_nb,
        p_n + shift,
        v_n + speed,
        cov[:, POSE[:, None], POSE],
        np.sqrt(np.maximum(np.diagonal(cov, axis1=1, axis2=2)[:, 3:6], 0.0)),
    )


def _link(problem: Problem, k: int, bridge: Bridge) -> Array:
    """Information that ties keyframe k to the one before it: the bridge's, and the displacement's
    where the velocity is measured."""
    link = bridge.link.copy()
    if problem.measures_velocity and problem.steps[k] is not None:
        variance = problem.motion.displacement_variance(problem.t[k - 1], problem.t[k])
        link[6:, 6:] += np.eye(3) / variance
    return link


def _bridge(problem: Problem, k: int, t: Array, gained_n: Array) -> Bridge:
    """Between keyframe k and the one before it, which differ by that velocity, at times t."""
    step, motion = problem.steps[k], problem.motion
    after_s, span_s = t - problem.t[k - 1], float(problem.t[k] - problem.t[k - 1])
    if step is not None:
        p, force_n = step.parameters, gained_n / span_s - step.parameters.n_gravity
        gyro2, accel2 = p.getGyroscopeCovariance()[0, 0], p.getAccelerometerCovariance()[0, 0]
        return inertial_bridge(after_s, span_s, force_n, gyro2, accel2)
    x = after_s * (span_s - after_s) / span_s**2
    turned = motion.yaw_variance_rad2_s * span_s * x
    moved_whole = float(motion.displacement_variance(problem.t[k - 1], problem.t[k]))
    speed = 4 * x * np.interp(t, motion.t, motion.sigma_v) ** 2
    link = 1.0 / np.array([motion.yaw_variance_rad2_s * span_s, np.inf, moved_whole])
    noise = np.repeat(np.stack([turned, speed, moved_whole * x], 1), 3, 1)
    return steady_bridge(after_s / span_s, noise, np.repeat(link, 3))


def _carried(problem: Problem, values: Any, ks: range, t: list[Array]) -> Carried:
    """States at times into some keyframes by the IMU from the one before each on; where that is
    silent, by momentum or the vehicle's own motion."""
    by_imu = [(i, k) for i, k in enumerate(ks) if isinstance(problem.steps[k], InertialStep)]
    found: list[Carried | None] = [None] * len(ks)
    if by_imu:
        whole = carried(
            [step for _, k in by_imu if isinstance(step := problem.steps[k], InertialStep)],
            [values.atNavState(X(k - 1)) for _, k in by_imu],
            [values.atConstantBias(B(k - 1)) for _, k in by_imu],
            [t[i] - problem.t[k - 1] for i, k in by_imu],
        )
        ends = np.cumsum([len(t[i]) for i, _ in by_imu])[:-1]
        for (i, _), one in zip(by_imu, whole.split(ends), strict=True):
            found[i] = one
    return joined(
        one or _without_readings(problem, values.atNavState(X(k - 1)), k, own)
        for one, k, own in zip(found, ks, t, strict=True)
    )


def _without_readings(problem: Problem, before: Any, k: int, t: Array) -> Carried:
    """From the keyframe before k on, where the IMU is silent."""
    if problem.steps[k] is None:
        return _by_own_motion(problem, before, k, t)
    return coasted(before, t - problem.t[k - 1])


def _by_own_motion(problem: Problem, before: Any, k: int, t: Array) -> Carried:
    """From the keyframe before k on."""
    motion = problem.motion
    turned = before.attitude().matrix() @ problem.R_nb[k - 1].T
    p_own, rpy_own = motion.at(t)
    R_nb = turned @ rotation_from_rpy(rpy_own)
    v_b = np.stack([np.interp(t, motion.t, axis) for axis in motion.v_b.T], axis=1)
    lacking_n = before.velocity() - before.attitude().matrix() @ problem.v_b[k - 1]
    v_n = np.einsum("nij,nj->ni", R_nb, v_b) + lacking_n
    return Carried(R_nb, v_n, before.position() + (p_own - problem.p_n[k - 1]) @ turned.T)


def _between(t: Array, t_key: Array, values: Array) -> Array:
    return np.stack([np.interp(t, t_key, column) for column in values.T], axis=1)
