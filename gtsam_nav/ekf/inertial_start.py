"""Coarse alignment: the state that the filter begins with, and how little is known of it.

What a sensor measures is wide here: its own first reading narrows it, and is not counted twice.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gtsam_nav.ekf.strapdown import ACCEL_BIAS, GYRO_BIAS, NU, RHO, SIZE, THETA, InertialState
from gtsam_nav.ekf.yaw_by_fixes import yaw_shown_by_fixes
from gtsam_nav.frames import (
    Array,
    earth_rate_n,
    quaternion_from_rpy,
    rotation_from_rpy,
    rpy_from_rotation,
    sag_m,
)
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.preprocess.alignment import align
from gtsam_nav.preprocess.first_fixes import ANY_SPEED_M_S, first_fixes, located
from gtsam_nav.preprocess.rest import Rest, initial_rest
from gtsam_nav.preprocess.settings import MotionSettings
from gtsam_nav.sensors.depth import origin_depths
from gtsam_nav.sensors.noise import ImuNoise
from gtsam_nav.sensors.orientation import UNMEASURED_TILT_SIGMA_RAD, headings_true
from gtsam_nav.series import GnssSeries

AGAIN_SIGMAS = 3.0
"""What the first fixes and depths tell of the start is doubted so much: they come again."""
UNKNOWN_YAW_SIGMA_RAD = np.pi / np.sqrt(3)
"""Of a heading that may be any."""
FOUND_YAW_SIGMA_RAD = np.radians(15.0)
"""Of a yaw that a smoother found: near enough for errors that are linear in it, and wide, since the
same measurements tell it again."""
COURSE_SIGMAS, COURSE_WITHIN_S = 5.0, 2.0
"""A vehicle that moves so far as soon begins on its course, until it is known where it points."""
FOUND_YAW_DRIFT_RAD = np.radians(10.0)
"""What the gyro's bias turns such a yaw by until motion shows it."""
GYROCOMPASS_SIGMA_RAD = np.radians(5.0)
"""Gyros whose biases turn a gyrocompass by more than this are none."""


@dataclass(frozen=True)
class FoundYaw:
    """The yaw at the start, rad, and the gyro's biases (3,), rad/s, that a smoother found.

    For ``unknown_s`` since the start the filter had known neither.
    """

    yaw: float
    gyro_bias_b: Array
    unknown_s: float


@dataclass(frozen=True)
class InertialStart:
    """State and covariance (15, 15) at the start.

    Attributes
    ----------
    state : InertialState
    P : ndarray, shape (15, 15)
    rest : Rest or None
        What the IMU feels while it is quiet at first.
    gyrocompass : bool
        Whether the rates at rest tell the heading.
    georeferenced : bool
    arm_b : ndarray, shape (3,)
        Of the antenna whose fix told the place; zero where none did.
    """

    state: InertialState
    P: Array
    rest: Rest | None
    gyrocompass: bool
    georeferenced: bool
    arm_b: Array

    def with_yaw(self, found: FoundYaw) -> InertialStart:
        """The same start with a yaw that was found since, and known until motion shows it."""
        before = self.state.body.R_nb
        roll, pitch, _ = rpy_from_rotation(before)
        rpy = np.array([roll, pitch, found.yaw])
        R_nb, P = rotation_from_rpy(rpy), self.P.copy()
        most_drift = FOUND_YAW_DRIFT_RAD / max(found.unknown_s, 1.0)
        for entries, most in ((THETA, FOUND_YAW_SIGMA_RAD), (GYRO_BIAS, most_drift), (RHO, np.inf)):
            P_n = before @ P[entries, entries] @ before.T
            P_n[2, 2] = min(P_n[2, 2], most**2)
            P[entries, entries] = R_nb.T @ P_n @ R_nb
        p_n = self.state.p_n + (before - R_nb) @ self.arm_b
        state = replace(
            self.state, q_nb_wxyz=quaternion_from_rpy(rpy), p_n=p_n, gyro_bias_b=found.gyro_bias_b
        )
        return replace(self, state=state, P=P)


def inertial_start(mission: Mission, imu: Sensor, settings: MotionSettings) -> InertialStart:
    """Roll and pitch by levelling, the yaw by what there is: see `_yaw`."""
    begin, rest = align(mission), initial_rest(imu)
    rpy = begin.rpy.copy()
    if rest is not None and mission.first("attitude") is None:
        fx, fy, fz = rest.force_b
        rpy[:2] = np.arctan2(-fy, -fz), np.arctan2(fx, np.hypot(fy, fz))
    rpy[2], sigma_yaw, gyrocompass = _yaw(mission, imu, rest, rpy)
    shown = None
    if not (begin.heading_known or gyrocompass):
        shown = yaw_shown_by_fixes(mission, imu, replace(begin, rpy=rpy), settings)
    if shown is not None:
        rpy[2], sigma_yaw = shown.yaw, shown.sigma
    R_nb = rotation_from_rpy(rpy)
    sigma_p, arm_b = begin.sigma_p.copy(), np.zeros(3)
    receiver = mission.first("gnss")
    if receiver is not None and mission.initial.p_n is None and begin.georeferenced:
        sigma_p, arm_b = AGAIN_SIGMAS * sigma_p, receiver.xyz_b
    p_n = begin.p_n + (rotation_from_rpy(begin.rpy) - R_nb) @ arm_b
    depth = mission.first("depth")
    if depth is not None:
        depth_m, sigma_depth = origin_depths(depth, np.array([begin.t]), R_nb[None])
        p_n[2], sigma_p[2] = depth_m[0] + sag_m(p_n, mission.origin), AGAIN_SIGMAS * sigma_depth[0]
    v_n, sigma_v = _velocity(mission)
    tilt = UNMEASURED_TILT_SIGMA_RAD
    noise = ImuNoise.model_validate(imu.noise)
    P = np.zeros((SIZE, SIZE))
    P[THETA, THETA] = R_nb.T @ np.diag([tilt**2, tilt**2, sigma_yaw**2]) @ R_nb
    P[RHO, RHO] = R_nb.T @ np.diag(sigma_p**2) @ R_nb
    P[NU, NU] = sigma_v**2 * np.eye(3)
    P[GYRO_BIAS, GYRO_BIAS] = noise.gyro_bias_sigma_rad_s**2 * np.eye(3)
    P[ACCEL_BIAS, ACCEL_BIAS] = noise.accel_bias_sigma_m_s2**2 * np.eye(3)
    state = InertialState(begin.t, quaternion_from_rpy(rpy), p_n, v_n, np.zeros(3), np.zeros(3))
    known = begin.heading_known or gyrocompass or mission.first("gnss") is not None
    known = known and (shown is None or shown.in_world)
    return InertialStart(state, P, rest, gyrocompass, begin.georeferenced and known, arm_b)


def _yaw(mission: Mission, imu: Sensor, rest: Rest | None, rpy: Array) -> tuple[float, float, bool]:
    """Yaw, its standard deviation, and whether the gyros told it.

    In this order: as stated, by gyrocompass, by compass, any (until the fixes show it), or the zero
    of a local frame.
    """
    if mission.initial.heading is not None:
        return mission.initial.heading, mission.initial.sigma_heading, False
    if rest is not None and mission.origin is not None:
        earth_n = earth_rate_n(mission.origin.latitude_deg)
        bias = ImuNoise.model_validate(imu.noise).gyro_bias_sigma_rad_s
        sigma = float(np.hypot(bias, rest.sigma_rate.max())) / max(earth_n[0], 1e-9)
        if sigma < GYROCOMPASS_SIGMA_RAD:
            # Groves (2013), equation (5.105)
            level = rotation_from_rpy([rpy[0], rpy[1], 0.0]) @ rest.rate_b
            return float(np.arctan2(-level[1], level[0])), UNKNOWN_YAW_SIGMA_RAD, True
    if headings_true(mission) is not None:
        return float(rpy[2]), UNKNOWN_YAW_SIGMA_RAD, False
    if mission.first("gnss") is not None:
        course = _first_course(mission)
        return float(rpy[2] if course is None else course), UNKNOWN_YAW_SIGMA_RAD, False
    return float(rpy[2]), 1e-3, False


def _first_course(mission: Mission) -> float | None:
    """Course from the first fix that the next ones bear out to the next that is clearly elsewhere,
    rad; None of a vehicle that hardly moves."""
    receiver = mission.first("gnss")
    assert receiver is not None
    series = receiver.series
    assert isinstance(series, GnssSeries)
    series = series.select(located(series))
    if not len(series):
        return None
    first = first_fixes(series).first
    soon = series.t - series.t[first] < COURSE_WITHIN_S
    way = (series.p_n - series.p_n[first])[:, :2]
    clear_m = COURSE_SIGMAS * np.hypot(series.sigma[:, 0], series.sigma[first, 0])
    clear = np.flatnonzero(soon & (np.hypot(*way.T) > clear_m) & (np.arange(len(way)) > first))
    return float(np.arctan2(*way[clear[0], ::-1])) if len(clear) else None


def _velocity(mission: Mission) -> tuple[Array, float]:
    receiver = mission.first("gnss")
    if receiver is None:
        return np.zeros(3), ANY_SPEED_M_S
    assert isinstance(receiver.series, GnssSeries)
    found = first_fixes(receiver.series)
    return found.v_n, found.sigma_v
