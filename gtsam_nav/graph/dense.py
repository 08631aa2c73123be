"""The trajectory between keyframes, on the sensors that fill the time between them."""

from __future__ import annotations

from typing import Any

import gtsam
import numpy as np

from gtsam_nav.frames import Array, quaternion_from_rotation, rotation_from_rpy, wrap_angle
from gtsam_nav.graph.factors import B, X
from gtsam_nav.graph.problem import InertialStep, Problem
from gtsam_nav.trajectory import Trajectory


def dense_trajectory(problem: Problem, values: Any, keyframes: Trajectory) -> Trajectory:
    """Keyframes and what is between: the vehicle's own motion, or the IMU's."""
    if problem.measures_velocity:
        return _along_motion(problem, keyframes)
    return _along_imu(problem, values, keyframes)


def _dense_times(problem: Problem, t_key: Array) -> Array:
    """The motion's times and the keyframes'."""
    inside = problem.motion.t[(problem.motion.t >= t_key[0]) & (problem.motion.t <= t_key[-1])]
    beside = t_key[np.clip(np.searchsorted(t_key, inside - 1e-6), 0, len(t_key) - 1)]
    return np.unique(np.concatenate([inside[np.abs(beside - inside) > 1e-6], t_key]))


def _along_motion(problem: Problem, keyframes: Trajectory) -> Trajectory:
    """The vehicle's own motion, corrected between keyframes as the refinement does.

    Each of the two keyframes around a time carries the motion along, turned by its own correction;
    the result lies between the two by the time's fraction of the interval.
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
    turn = wrap_angle(keyframes.rpy - rpy_key)
    heading_turns = rotation_from_rpy(turn * [0.0, 0.0, 1.0])
    ends = [
        keyframes.p_n[k] + np.einsum("nij,nj->ni", heading_turns[k], p_own - p_key[k])
        for k in (before, before + 1)
    ]
    v_b = np.stack([np.interp(t, motion.t, axis) for axis in motion.v_b.T], axis=1)
    v_b_key = np.stack([np.interp(t_key, motion.t, axis) for axis in motion.v_b.T], axis=1)
    v_gap = keyframes.v_n - np.einsum("nij,nj->ni", keyframes.R_nb, v_b_key)
    R_nb = rotation_from_rpy(rpy_own + _between(t, t_key, turn))
    return Trajectory(
        t=t,
        p_n=(1 - f) * ends[0] + f * ends[1],
        q_nb_wxyz=quaternion_from_rotation(R_nb),
        v_n=np.einsum("nij,nj->ni", R_nb, v_b) + _between(t, t_key, v_gap),
        cov_pose_n=_between(t, t_key, keyframes.cov_pose_n.reshape(-1, 36)).reshape(-1, 6, 6),
        sigma_v_n=_between(t, t_key, keyframes.sigma_v_n),
        keyframe=np.isin(t, t_key),
    )


def _along_imu(problem: Problem, values: Any, keyframes: Trajectory) -> Trajectory:
    """The IMU's readings from each keyframe on; what they miss the next one by is spread evenly."""
    from scipy.spatial.transform import Rotation

    assert keyframes.v_n is not None
    assert keyframes.cov_pose_n is not None
    assert keyframes.sigma_v_n is not None
    t_key = keyframes.t
    t = _dense_times(problem, t_key)
    k = np.clip(np.searchsorted(t_key, t, side="left"), 1, len(t_key) - 1)
    R_nb, p_n, v_n = np.empty((len(t), 3, 3)), np.empty((len(t), 3)), np.empty((len(t), 3))
    bounds = np.searchsorted(k, np.arange(1, len(t_key) + 1))
    for j, step in enumerate(problem.steps[1:], start=1):
        assert step is not None
        before, bias = values.atNavState(X(j - 1)), values.atConstantBias(B(j - 1))
        elapsed = t[bounds[j - 1] : bounds[j]] - t_key[j - 1]
        for i, state in enumerate(_predicted(step, before, bias, elapsed), start=bounds[j - 1]):
            R_nb[i], p_n[i], v_n[i] = state.attitude().matrix(), state.position(), state.velocity()
    span = np.diff(t_key)[k - 1][:, None]
    f = (t - t_key[k - 1])[:, None] / span
    last = bounds[k] - 1  # the keyframe's own time ends each stretch
    p_miss, v_miss = keyframes.p_n[k] - p_n[last], keyframes.v_n[k] - v_n[last]
    turn = Rotation.from_matrix(np.swapaxes(R_nb[last], 1, 2) @ keyframes.R_nb[k]).as_rotvec()
    R_nb = R_nb @ Rotation.from_rotvec(f * turn).as_matrix()
    return Trajectory(
        t=t,
        p_n=p_n + f**2 * (3 - 2 * f) * p_miss + f**2 * (f - 1) * span * v_miss,
        q_nb_wxyz=quaternion_from_rotation(R_nb),
        v_n=v_n + 6 * f * (1 - f) * p_miss / span + f * (3 * f - 2) * v_miss,
        cov_pose_n=_between(t, t_key, keyframes.cov_pose_n.reshape(-1, 36)).reshape(-1, 6, 6),
        sigma_v_n=_between(t, t_key, keyframes.sigma_v_n),
        keyframe=np.isin(t, t_key),
    )


def _predicted(step: InertialStep, before: Any, bias: Any, elapsed: Array) -> list[Any]:
    """States at times after a keyframe, by its readings."""
    ends = np.cumsum(step.dt)
    edges = np.union1d(ends, elapsed[elapsed > 0])
    row = np.minimum(np.searchsorted(ends, edges), len(ends) - 1)
    wanted = np.isin(edges, elapsed)
    pim = gtsam.PreintegratedImuMeasurements(step.parameters, bias)
    states = [before] * int(np.sum(elapsed <= 0))
    for k, dt, is_wanted in zip(row, np.diff(edges, prepend=0.0), wanted, strict=True):
        pim.integrateMeasurement(step.accel[k], step.gyro[k], dt)
        if is_wanted:
            states.append(pim.predict(before, bias))
    return states


def _between(t: Array, t_key: Array, values: Array) -> Array:
    return np.stack([np.interp(t, t_key, column) for column in values.T], axis=1)
