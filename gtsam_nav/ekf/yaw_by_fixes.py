"""The yaw at the start that the first fixes show, where velocities tell the way beside them.

An error-state filter whose yaw may be any linearises in the wrong place: with a measured velocity
each of its first steps goes in a direction that the next fix contradicts. The way by dead reckoning
turned onto the fixes tells the direction before the filter starts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.preprocess.alignment import Alignment
from gtsam_nav.preprocess.measured_turns import MAX_RATE_GAP_S
from gtsam_nav.preprocess.motion import (
    FIRST_FIXES_S,
    measures_velocity,
    turn_onto_fixes,
    vehicle_motion,
)
from gtsam_nav.preprocess.settings import MotionSettings
from gtsam_nav.preprocess.turning import unmeasured_yaw_variance_rad2_s
from gtsam_nav.sensors.noise import ImuNoise
from gtsam_nav.sensors.silences import silent_spells
from gtsam_nav.series import GnssSeries
from gtsam_nav.trajectory import UNIFORM_YAW_SIGMA

LOCAL_SIGMA_RAD = 1e-3
"""Of a yaw that is the local frame's by definition."""


@dataclass(frozen=True)
class ShownYaw:
    """The yaw at the start and its standard deviation, rad.

    Where the fixes lie too close together to show one it is the local frame's, not the world's.
    """

    yaw: float
    sigma: float
    in_world: bool


def yaw_shown_by_fixes(
    mission: Mission, imu: Sensor, start: Alignment, settings: MotionSettings
) -> ShownYaw | None:
    """Compare the way by velocities and gyro with the fixes of their first minute.

    Returns
    -------
    ShownYaw or None
        None without fixes or velocities, or where the fixes come too late to tell of the start: the
        yaw would be no surer than one of which nothing is known.
    """
    gnss = mission.first("gnss")
    if gnss is None:
        return None
    early = mission.crop(stop_s=float(gnss.series.t[0]) + FIRST_FIXES_S)
    if not measures_velocity(early):
        return None
    motion = vehicle_motion(early, start, settings, imu)
    turn = turn_onto_fixes(early, motion)
    fixes = early.sensors[gnss.name].series
    assert isinstance(fixes, GnssSeries)
    yaw = float(start.rpy[2])
    if turn is None:
        return ShownYaw(yaw, LOCAL_SIGMA_RAD, False) if len(fixes) == len(gnss.series) else None
    p_n, _ = motion.at(fixes.t)
    noise = float(np.median(fixes.sigma[:, :2])) / float(np.hypot(*np.std(p_n[:, :2], axis=0)))
    bias = ImuNoise.model_validate(imu.noise).gyro_bias_sigma_rad_s
    missed = unmeasured_yaw_variance_rad2_s(settings) * _silent_s(imu, *early.span_s)
    variance = noise**2 + (bias * (float(np.mean(fixes.t)) - start.t)) ** 2 + missed
    sigma = float(np.sqrt(variance))
    return ShownYaw(yaw + turn, sigma, True) if sigma < UNIFORM_YAW_SIGMA else None


def _silent_s(imu: Sensor, from_s: float, to_s: float) -> float:
    """How long in all, within a span, a gyro says nothing of the turns."""
    return float(np.sum(np.diff(silent_spells(imu.series.t, from_s, to_s, MAX_RATE_GAP_S))))
