"""The estimated motion of the body's origin, with its uncertainty."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import ArrayLike

from gtsam_nav.errors import DataError
from gtsam_nav.frames import (
    Array,
    rotation_from_quaternion,
    rpy_from_quaternion,
    skew,
    slerp,
    yaw_from_quaternion,
)
from gtsam_nav.series import BoolArray, IntArray

MAX_GAP_S = 5.0
"""Interpolation never bridges a longer gap."""
SAME_TIME_S = 1e-6
"""Nearer moments are told apart by rounding alone."""
MOST_RECORDS = 5_000_000
"""Six days at 10 Hz; no more fit into memory with their covariances."""
UNIFORM_YAW_SIGMA = float(np.pi / np.sqrt(3.0))
"""Of a yaw of which nothing is known, rad."""


def record_times(start_s: float, stop_s: float, rate_hz: float) -> Array:
    """Times of a trajectory: uniform from the start, and the last moment itself.

    Raises
    ------
    DataError
        Where they are more than `MOST_RECORDS`.
    """
    if (stop_s - start_s) * rate_hz > MOST_RECORDS:
        raise DataError(
            f"from {start_s:.0f} to {stop_s:.0f} s a trajectory at {rate_hz:g} Hz has more than "
            f"{MOST_RECORDS} records: look whether all stamps are in seconds, set a lower "
            "motion.rate_hz, or run a part of it (--start, --stop)"
        )
    t = start_s + np.arange(int((stop_s - start_s) * rate_hz) + 1) / rate_hz
    return np.append(t[t < stop_s - SAME_TIME_S], stop_s)


@dataclass(frozen=True, kw_only=True)
class Trajectory:
    """Poses of the body's origin in local NED.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Mission time, s, strictly increasing.
    p_n : ndarray, shape (n, 3)
        Positions, m.
    q_nb_wxyz : ndarray, shape (n, 4)
        Unit quaternions, body to navigation frame.
    v_n : ndarray, shape (n, 3), optional
        Velocities, m/s.
    cov_pose_n : ndarray, shape (n, 6, 6), optional
        Marginal covariance of (dp_n, dtheta_n): position error in m and rotation error in rad, both
        along the navigation axes, ``R = Exp(dtheta_n) R_estimated``.
    sigma_v_n : ndarray, shape (n, 3), optional
        Standard deviations of v_n, m/s.
    keyframe : ndarray of bool, shape (n,), optional
        Which samples are states of the estimator rather than interpolated between them.

    Raises
    ------
    ValueError
        Where a column has the wrong shape, a value is not finite or time does not increase.
    """

    t: Array
    p_n: Array
    q_nb_wxyz: Array
    v_n: Array | None = None
    cov_pose_n: Array | None = None
    sigma_v_n: Array | None = None
    keyframe: BoolArray | None = None

    def __post_init__(self) -> None:
        n = np.size(self.t)
        shapes = {
            "t": (n,),
            "p_n": (n, 3),
            "q_nb_wxyz": (n, 4),
            "v_n": (n, 3),
            "cov_pose_n": (n, 6, 6),
            "sigma_v_n": (n, 3),
            "keyframe": (n,),
        }
        for name, shape in shapes.items():
            value = getattr(self, name)
            if value is None:
                continue
            values = np.asarray(value, dtype=bool if name == "keyframe" else float)
            if values.shape != shape:
                raise ValueError(f"Trajectory.{name} has shape {values.shape}; {shape} is needed")
            if not np.all(np.isfinite(values)):
                raise ValueError(f"Trajectory.{name} holds NaN or infinity")
            object.__setattr__(self, name, values)
        if np.any(np.diff(self.t) <= 0):
            raise ValueError("Trajectory.t does not strictly increase")
        norms = np.linalg.norm(self.q_nb_wxyz, axis=1, keepdims=True)
        if np.any(np.abs(norms - 1) > 1e-3):
            raise ValueError("Trajectory.q_nb_wxyz holds quaternions that are not of unit length")
        object.__setattr__(self, "q_nb_wxyz", self.q_nb_wxyz / norms)

    def __len__(self) -> int:
        return len(self.t)

    @property
    def R_nb(self) -> Array:  # noqa: N802
        """Rotation matrices, shape (n, 3, 3)."""
        return rotation_from_quaternion(self.q_nb_wxyz)

    @property
    def rpy(self) -> Array:
        """Roll, pitch, yaw, shape (n, 3), rad."""
        return rpy_from_quaternion(self.q_nb_wxyz)

    @property
    def yaw(self) -> Array:
        """Yaw alone, shape (n,), rad."""
        return yaw_from_quaternion(self.q_nb_wxyz)

    @property
    def sigma_p_n(self) -> Array | None:
        """Standard deviations of n, e, d, shape (n, 3), m."""
        if self.cov_pose_n is None:
            return None
        # an origin that is where it is by definition has a variance of zero, but for rounding
        return np.sqrt(np.maximum(np.diagonal(self.cov_pose_n, axis1=1, axis2=2)[:, :3], 0.0))

    @property
    def sigma_rpy(self) -> Array | None:
        """Standard deviations of roll, pitch, yaw, shape (n, 3), rad.

        That of a yaw of which nothing is known is a uniform direction's, pi / sqrt(3).
        """
        if self.cov_pose_n is None:
            return None
        _, pitch, yaw = self.rpy.T
        c, s, o = np.cos(yaw), np.sin(yaw), np.zeros_like(yaw)
        # rates of roll, pitch, yaw for a small rotation about the navigation axes
        J = np.stack(
            [
                np.stack([c / np.cos(pitch), s / np.cos(pitch), o], -1),
                np.stack([-s, c, o], -1),
                np.stack([c * np.tan(pitch), s * np.tan(pitch), o + 1], -1),
            ],
            axis=1,
        )
        cov = J @ self.cov_pose_n[:, 3:, 3:] @ np.swapaxes(J, 1, 2)
        sigma = np.sqrt(np.diagonal(cov, axis1=1, axis2=2))
        return np.asarray(np.minimum(sigma, [np.inf, np.inf, UNIFORM_YAW_SIGMA]))

    def select(self, which: BoolArray | IntArray | slice) -> Trajectory:
        """The samples that a mask, an index array in time order, or a slice picks."""
        picked = {
            f.name: getattr(self, f.name)[which]
            for f in fields(self)
            if getattr(self, f.name) is not None
        }
        return replace(self, **picked)

    def covers(self, t: ArrayLike, max_gap_s: float = MAX_GAP_S) -> BoolArray:
        """Which times can be interpolated without bridging a gap longer than ``max_gap_s``."""
        query = np.asarray(t, dtype=float)
        if len(self) == 0:
            return np.zeros(query.shape, dtype=bool)
        right = np.clip(np.searchsorted(self.t, query, side="left"), 0, len(self) - 1)
        left = np.clip(np.searchsorted(self.t, query, side="right") - 1, 0, len(self) - 1)
        inside = (query >= self.t[0]) & (query <= self.t[-1])
        return np.asarray(inside & (self.t[right] - self.t[left] <= max_gap_s))

    def interpolate(self, t: ArrayLike, max_gap_s: float = MAX_GAP_S) -> Trajectory:
        """The trajectory at other times: linear in position, geodesic in attitude.

        Parameters
        ----------
        t : array_like, shape (m,)
            Strictly increasing mission times.
        max_gap_s : float
            Longest gap that may be bridged.

        Raises
        ------
        ValueError
            Where a time is not covered; see `covers`.
        """
        query = np.asarray(t, dtype=float)
        if not np.all(self.covers(query, max_gap_s)):
            raise ValueError("times outside the trajectory or inside one of its gaps")
        i = np.clip(np.searchsorted(self.t, query, side="right") - 1, 0, max(len(self) - 2, 0))
        j = np.minimum(i + 1, len(self) - 1)
        dt = self.t[j] - self.t[i]
        a = np.where(dt > 0, (query - self.t[i]) / np.where(dt > 0, dt, 1.0), 0.0)

        def blend(values: Array | None) -> Array | None:
            if values is None:
                return None
            w = a.reshape(-1, *([1] * (values.ndim - 1)))
            return np.asarray((1 - w) * values[i] + w * values[j])

        p_n = blend(self.p_n)
        assert p_n is not None
        return Trajectory(
            t=query,
            p_n=p_n,
            q_nb_wxyz=slerp(self.q_nb_wxyz[i], self.q_nb_wxyz[j], a),
            v_n=blend(self.v_n),
            cov_pose_n=blend(self.cov_pose_n),
            sigma_v_n=blend(self.sigma_v_n),
        )

    def at_lever_arm(self, lever_b: ArrayLike) -> Trajectory:
        """The trajectory of another point of the body, with its covariance.

        Parameters
        ----------
        lever_b : array_like, shape (3,)
            The point in body coordinates, m. Velocities are dropped.
        """
        arm_n = self.R_nb @ np.asarray(lever_b, dtype=float)
        cov = self.cov_pose_n
        if cov is not None:
            J = np.broadcast_to(np.eye(6), cov.shape).copy()
            J[:, :3, 3:] = -skew(arm_n)
            cov = J @ cov @ np.swapaxes(J, 1, 2)
        return replace(self, p_n=self.p_n + arm_n, v_n=None, sigma_v_n=None, cov_pose_n=cov)
