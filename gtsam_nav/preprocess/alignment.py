"""Where and how the vehicle stands when the estimate begins."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array, Origin, rotation_from_rpy, sag_m, wrap_angle
from gtsam_nav.mission import Mission
from gtsam_nav.preprocess.first_fixes import first_fixes, locating_receiver
from gtsam_nav.sensors.depth import origin_depths
from gtsam_nav.sensors.orientation import headings_true, tilt_at
from gtsam_nav.series import GnssSeries, ImuSeries

UNKNOWN_SIGMA_M = 1.0
"""Spread of a start that only defines the local frame."""

UNKNOWN_SPEED_M_S = 1.0
"""How fast the vehicle may have moved before a first fix that came late."""

PUNCTUAL_S = 2.0
"""A first fix within so short a time counts as the start's."""


@dataclass(frozen=True)
class Alignment:
    """State of the body at the start of the estimate.

    Attributes
    ----------
    t : float
        Mission time, s.
    p_n, sigma_p : ndarray, shape (3,)
        Position and its standard deviations, m.
    rpy, sigma_rpy : ndarray, shape (3,)
        Roll, pitch, yaw and their standard deviations, rad.
    georeferenced : bool
        Whether the position is known in the navigation frame, or merely its zero.
    heading_known : bool
        Whether the yaw is measured or stated; else it is merely the local frame's zero.
    """

    t: float
    p_n: Array
    sigma_p: Array
    rpy: Array
    sigma_rpy: Array
    georeferenced: bool
    heading_known: bool = True

    @property
    def R_nb(self) -> Array:  # noqa: N802
        """Rotation matrix of the attitude."""
        return rotation_from_rpy(self.rpy)

    def level_at(self, ne: Array, origin: Origin | None) -> Array:
        """Another place (2,) of the depth of this start, shape (3,)."""
        p_n = np.append(ne, self.p_n[2])
        p_n[2] += sag_m(p_n, origin) - sag_m(self.p_n, origin)
        return p_n


def align(mission: Mission) -> Alignment:
    """Initial alignment from the mission's statement, GNSS, AHRS and rest levelling.

    Parameters
    ----------
    mission : Mission
        With the GNSS fixes that may be used, and no others.

    Raises
    ------
    DataError
        Where no sensor has a sample.
    """
    start, stop = mission.span_s
    if stop <= start:
        raise DataError(f"mission '{mission.name}' has no span in time to estimate over")
    heading, sigma_heading = _heading(mission)
    tilt, sigma_tilt = _tilt(mission, start)
    rpy = np.array([*tilt, heading])
    R_nb = rotation_from_rpy(rpy)
    p_n, sigma_p, georeferenced = _position(mission, start, R_nb)
    gauge = mission.first("depth")
    if gauge is not None:
        depth_m, sigma_depth = origin_depths(gauge, np.array([start]), R_nb[None])
        p_n[2], sigma_p[2] = depth_m[0] + sag_m(p_n, mission.origin), sigma_depth[0]
    sigma_rpy = np.array([sigma_tilt, sigma_tilt, sigma_heading])
    known = mission.initial.heading is not None or headings_true(mission) is not None
    return Alignment(start, p_n, sigma_p, rpy, sigma_rpy, georeferenced, known)


def _heading(mission: Mission) -> tuple[float, float]:
    initial = mission.initial
    if initial.heading is not None:
        return initial.heading, initial.sigma_heading
    headings = headings_true(mission)
    if headings is not None:
        return float(wrap_angle(headings.heading[0])), float(headings.sigma[0])
    return 0.0, 1e-3  # the local frame is the vehicle's own


def _tilt(mission: Mission, start: float) -> tuple[Array, float]:
    if mission.first("attitude") is None:
        levelled = level_at_rest(mission, start)
        if levelled is not None:
            return levelled, float(np.radians(1.0))
    tilt, sigma = tilt_at(mission, np.array([start]))
    return tilt[0], float(sigma[0])


def level_at_rest(mission: Mission, start: float, window_s: float = 2.0) -> Array | None:
    """Roll and pitch, rad, from the specific force of a vehicle at rest; None where it moves.

    Groves (2013), equation (5.101): at rest the accelerometers feel gravity's reaction alone.
    """
    imu = mission.first("imu")
    if imu is None or not at_rest(mission, start, window_s):
        return None
    series = imu.series.crop(start, start + window_s)
    assert isinstance(series, ImuSeries)
    fx, fy, fz = imu.R_bs @ series.accel_i.mean(axis=0)
    return np.array([np.arctan2(-fy, -fz), np.arctan2(fx, np.hypot(fy, fz))])


def at_rest(mission: Mission, start: float, window_s: float = 2.0) -> bool:
    """Whether the IMU's readings stay still over a window: rates steady, force near gravity."""
    imu = mission.first("imu")
    if imu is None:
        return False
    series = imu.series.crop(start, start + window_s)
    assert isinstance(series, ImuSeries)
    if len(series) < 5:
        return False
    steady = np.all(series.gyro_i.std(axis=0) < 0.02) and np.all(series.accel_i.std(axis=0) < 0.15)
    force = float(np.linalg.norm(series.accel_i.mean(axis=0)))
    return bool(steady and abs(force - 9.81) < 0.5)


def _position(mission: Mission, start: float, R_nb: Array) -> tuple[Array, Array, bool]:
    initial = mission.initial
    if initial.p_n is not None:
        return np.array(initial.p_n, dtype=float), np.full(3, initial.sigma_p), True
    fix = start_fix(mission)
    if fix is None:
        return np.zeros(3), np.full(3, UNKNOWN_SIGMA_M), False
    moved_m = UNKNOWN_SPEED_M_S * max(fix.t - start - PUNCTUAL_S, 0.0)
    return fix.p_n - R_nb @ fix.lever_b, np.hypot(fix.sigma, moved_m), True


@dataclass(frozen=True)
class StartFix:
    """The fix that a start is taken from: its time, antenna position, sigmas (3,) and lever arm."""

    t: float
    p_n: Array
    sigma: Array
    lever_b: Array


def start_fix(mission: Mission) -> StartFix | None:
    """The first fix that those after it bear out; None where no fix tells a position."""
    gnss = locating_receiver(mission)
    if gnss is None:
        return None
    series = gnss.series
    assert isinstance(series, GnssSeries)
    k = first_fixes(series).first
    return StartFix(float(series.t[k]), series.p_n[k], series.sigma[k], gnss.xyz_b)
