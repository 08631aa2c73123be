"""The planar vehicle of landmark SLAM: equations (1) to (4) of the paper.

State: n, e and course (the paper's x, y, phi), three constants of what tells the speed, the error k
of its scale, the curvature c of a path that it takes for straight and the angle a by which it is
mounted askew, and the slow error b of a compass that tells the turns, which forgets itself by a
share f each step; with spreads of zero they are out of the game, and the filter is the paper's. A
step moves the vehicle by what odometry, or a DVL and a compass, say of the span: forward and
starboard increments d_x, d_y and a turn d_phi, each with zero-mean Gaussian noise of covariance Q::

    d_n     = d_x cos(course) - d_y sin(course)
    d_e     = d_x sin(course) + d_y cos(course)
    n      += (m + k + s) d_n - a d_e
    e      += (m + k + s) d_e + a d_n
    course += d_phi + c d_c + f b - w
    b      += -f b + w

The way d_c that a curvature turns is that over which wheels tell the turns; a compass that is heard
again takes off what they had turned.

Of a step only the cosine of the course's error lies along the course. Its mean m (one in the paper)
shortens the way, and what it differs from it, s, wanders with the course as an error of scale does:
this bends the spread of positions as that of the courses bends them, which no straight line can.

Noise of the compass does not add up: it is in a course of now, and that of the first reading in all
courses since.

Depth, roll and pitch are what the mission measures of them.
"""

from __future__ import annotations

import math

import numpy as np

from gtsam_nav.ekf.local_level import LocalLevel
from gtsam_nav.ekf.whole_turn import covariance_after, jacobian_before
from gtsam_nav.frames import Array, sag_m
from gtsam_nav.mission import Mission
from gtsam_nav.preprocess.alignment import Alignment
from gtsam_nav.preprocess.planar_motion import PlanarMotion
from gtsam_nav.sensors.depth import origin_depths
from gtsam_nav.sensors.orientation import level_attitudes, tilt_at
from gtsam_nav.sensors.prediction import BodyState

LOST_RAD = 0.3
"""A course less certain than that is lost: its spread warns, and shortens the way no further."""


class PlanarVehicle:
    """Goes from the start through given times.

    Parameters
    ----------
    mission : Mission
        For depth and tilt.
    motion : PlanarMotion
    start : Alignment
        At the first of the times.
    t : ndarray, shape (n,)
        Mission times, s, rising.

    Attributes
    ----------
    x : ndarray, shape (8,)
        North, east, course, scale error, curvature, compass error, shortening s, misalignment a.
    P_start : ndarray, shape (8, 8)
        Covariance of the state at the start.
    """

    size = 8
    pose = slice(0, 3)

    def __init__(self, mission: Mission, motion: PlanarMotion, start: Alignment, t: Array) -> None:
        self._increments, self._dt = motion.increments(t), np.diff(t)
        _, self._sigma_tilt = tilt_at(mission, t)
        self._R_level = level_attitudes(mission, t)
        self._depth, self._sigma_depth = _depths(mission, start, t, self._R_level)
        self._level = None if mission.origin is None else LocalLevel(mission.origin)
        slow = [motion.scale_sigma, motion.curvature_sigma, motion.disturbance_sigma]
        self._white2 = motion.white_sigma**2
        sigma = [*start.sigma_p[:2], start.sigma_rpy[2], *slow, 0.0, motion.misalignment_sigma]
        self.P_start = np.diag(sigma) ** 2
        self.P_start[2, 2] += self._white2
        self.P_start[6, 6] = _cosine_variance(self.P_start[2, 2])
        self._forgotten = -np.expm1(-self._dt / motion.disturbance_time_s)
        self._disturbance2 = motion.disturbance_sigma**2
        self._k = 0
        self.x = np.array([*start.p_n[:2], start.rpy[2], 0.0, 0.0, 0.0, 0.0, 0.0])
        self._v_n = np.zeros(3)
        self._body = self._whole()

    def advance(self, P: Array) -> tuple[Array, Array]:
        """Go to the next time from a state of covariance P (8, 8): the Jacobian A in the state, and
        the noise W Q W' that it adds."""
        k = self._k
        course, scale, curvature, compass_error, shortening, askew = self.x[2:].tolist()
        c, s = math.cos(course), math.sin(course)
        dx, dy = self._increments.displacement_b[k].tolist()
        north, east = c * dx - s * dy, s * dx + c * dy
        factor = _mean_cosine(P[2, 2]) + scale + shortening
        forgotten = float(self._forgotten[k])
        A = np.eye(8)
        moved_n, moved_e = factor * north - askew * east, factor * east + askew * north
        A[:2, 2] = -moved_e, moved_n
        A[:2, 3] = A[:2, 6] = north, east
        A[:2, 7] = -east, north
        bent_m = float(self._increments.bent_m[k])
        A[2, 4], A[2, 5], A[5, 5] = bent_m, forgotten, 1 - forgotten
        W = np.zeros((8, 3))
        W[:3] = [[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]
        variance = self._increments.variance[k].copy()
        if self._disturbance2:
            # the turn is as wrong as the compass's error has grown
            W[5, 2] = -1.0
            variance[2] = self._disturbance2 * (1 - (1 - forgotten) ** 2)
        A[6, 6], shortening_variance = _wandered(P, A[2], float(variance[2]))
        step = np.zeros(8)
        step[:2] = moved_n, moved_e
        step[2] = self._increments.turn[k] + curvature * bent_m + forgotten * compass_error
        step[5] = -forgotten * compass_error
        step[6] = (A[6, 6] - 1) * shortening
        self._v_n = np.array([step[0] / self._dt[k], step[1] / self._dt[k], 0.0])
        self._k += 1
        self.correct(step)
        added = (W * variance) @ W.T
        added[6, 6] = shortening_variance
        return A, added

    def correct(self, error: Array) -> None:
        """Add to the state."""
        self.x = self.x + error
        self._body = self._whole()

    def _whole(self) -> BodyState:
        n, e, course = self.x[:3].tolist()
        c, s = math.cos(course), math.sin(course)
        R_nb = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ self._R_level[self._k]
        p_n = np.array([n, e, self._depth[self._k]])
        if self._level is not None:
            p_n[2] += self._level.sag_m(p_n)
        return BodyState(R_nb, p_n, self._v_n)

    @property
    def body(self) -> BodyState:
        """What the sensor models take."""
        return self._body

    @property
    def body_jacobian(self) -> Array:
        """Errors of `BodyState` in those of the state, shape (9, 8)."""
        R_nb = self._body.R_nb
        jacobian = np.zeros((9, 8))
        jacobian[:3, 2] = R_nb[2]
        jacobian[3:6, :2] = R_nb[:2].T
        return jacobian

    def pose_cov(self, P: Array) -> Array:
        """Covariance (6, 6) of position and rotation along the navigation axes.

        Depth, roll and pitch are as uncertain as their sensors.

        Parameters
        ----------
        P : ndarray, shape (8, 8)
            Of the state.
        """
        cov = np.zeros((6, 6))
        cov[:2, :2], cov[5, 5] = P[:2, :2], P[2, 2] + self._white2
        cov[:2, 5] = cov[5, :2] = P[:2, 2]
        cov[2, 2] = self._sigma_depth[self._k] ** 2
        cov[3, 3] = cov[4, 4] = self._sigma_tilt[self._k] ** 2
        return cov

    def after(self, P: Array, error: Array, first: int, axes: int) -> Array:
        """The covariance that a correction leaves; it tells nothing of a turn of all."""
        return covariance_after(P, error, first, axes)

    def before(self, H: Array, error: Array, first: int, axes: int) -> Array:
        """A Jacobian of now in the errors before a correction."""
        return jacobian_before(H, error, first, axes)


def _mean_cosine(variance: float) -> float:
    """Of a course's error."""
    return math.exp(-0.5 * min(variance, LOST_RAD**2))


def _cosine_variance(variance: float) -> float:
    """Of the cosine of a course's error."""
    return 0.5 * math.expm1(-variance) ** 2


def _wandered(P: Array, A_course: Array, turn_variance: float) -> tuple[float, float]:
    """Share of the shortening that a step keeps, and the variance that it adds.

    The square of the course's error goes by the square of the share that the next has of this, and
    after a correction of the course by as much as that has left.
    """
    now, then = float(P[2, 2]), float(A_course @ P @ A_course) + turn_variance
    of_now = _cosine_variance(now)
    kept = (float(A_course @ P[:, 2]) / now) ** 2 if now > 0 else 1.0
    added = max(_cosine_variance(then) - kept**2 * of_now, 0.0)
    left = math.sqrt(of_now / P[6, 6]) if P[6, 6] > of_now else 1.0
    return kept * left, added


def _depths(mission: Mission, start: Alignment, t: Array, R_level: Array) -> tuple[Array, Array]:
    """Depth of the body's origin below the level surface, and its sigma: the start's where nothing
    measures it."""
    gauge = mission.first("depth")
    if gauge is None:
        depth_m = start.p_n[2] - sag_m(start.p_n, mission.origin)
        return np.full(len(t), depth_m), np.full(len(t), start.sigma_p[2])
    return origin_depths(gauge, t, R_level)
