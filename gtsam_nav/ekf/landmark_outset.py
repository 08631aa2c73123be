"""What landmark SLAM starts from: the vehicle that its motion sensors make, and where it begins."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gtsam_nav.config import Config
from gtsam_nav.ekf.aid import Aid
from gtsam_nav.ekf.aiding import aids_of
from gtsam_nav.ekf.inertial_start import InertialStart, inertial_start
from gtsam_nav.ekf.inertial_vehicle import InertialVehicle
from gtsam_nav.ekf.planar_vehicle import PlanarVehicle
from gtsam_nav.ekf.strapdown import NU, THETA, Strapdown
from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission, Rejection, Sensor
from gtsam_nav.preprocess.accelerometer_units import check_accelerometer_unit
from gtsam_nav.preprocess.alignment import Alignment, align, at_rest
from gtsam_nav.preprocess.landmark_start import landmark_start
from gtsam_nav.preprocess.planar_motion import PlanarMotion, planar_motion
from gtsam_nav.series import LandmarkSeries
from gtsam_nav.trajectory import record_times

PRIOR_SIGMAS = 2.0
"""A start that was found from sightings is doubted so much: the same sightings come again."""


@dataclass(frozen=True)
class Outset:
    """What the filter starts from.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Times that the vehicle goes through.
    vehicle : PlanarVehicle or InertialVehicle
        At the first of them.
    on_map : bool
        Whether the start is known in the frame of the mission's surveyed landmarks.
    georeferenced : bool
    aids : list of Aid
        Of the inertial vehicle.
    rejections : tuple of Rejection
    gnss_used : int
        Fixes that told the start.
    """

    t: Array
    vehicle: PlanarVehicle | InertialVehicle
    on_map: bool
    georeferenced: bool
    aids: tuple[Aid, ...] = ()
    rejections: tuple[Rejection, ...] = ()
    gnss_used: int = 0


def outset(mission: Mission, series: LandmarkSeries, config: Config) -> Outset:
    """The vehicle that ``landmark_ekf.motion`` asks for, or that the mission has the sensors of.

    Raises
    ------
    DataError
        Where nothing tells the motion, or not what is asked for.
    """
    wanted = config.landmark_ekf.motion
    motion = None if wanted == "ins" else planar_motion(mission, config.motion)
    if motion is not None:
        return _planar(mission, motion, series, config)
    imu = None if wanted == "odometry" else mission.first("imu")
    if imu is not None:
        return _inertial(mission, imu, series, config)
    needs = {
        "auto": "a DVL or odometry, or else an IMU",
        "odometry": "a DVL with valid samples or odometry (landmark_ekf.motion=odometry)",
        "ins": "an IMU (landmark_ekf.motion=ins)",
    }
    raise DataError(
        f"mission '{mission.name}': landmark-ekf needs {needs[wanted]};"
        f" the mission has: {', '.join(sorted(mission.sensors))}"
    )


def _planar(
    mission: Mission, motion: PlanarMotion, series: LandmarkSeries, config: Config
) -> Outset:
    start, on_map = _planar_start(mission, motion, config)
    t = np.union1d(record_times(*mission.span_s, config.motion.rate_hz), _since(series.t, start.t))
    by_fix = start.georeferenced and not on_map and mission.initial.p_n is None
    return Outset(
        t,
        PlanarVehicle(mission, motion, start, t),
        on_map,
        start.georeferenced and start.heading_known,
        gnss_used=int(by_fix),
    )


def _planar_start(mission: Mission, motion: PlanarMotion, config: Config) -> tuple[Alignment, bool]:
    """Where the mission begins, and whether that is known on the map of surveyed landmarks."""
    stated = align(mission)
    if not _has_map(mission, config):
        return _local(stated), False
    if stated.georeferenced and stated.heading_known:
        return stated, True
    found = landmark_start(mission, motion, config.landmarks)
    if found is None:
        return _local(stated), False
    doubted = replace(
        found,
        sigma_p=PRIOR_SIGMAS * found.sigma_p,
        sigma_rpy=found.sigma_rpy * [1.0, 1.0, PRIOR_SIGMAS],
    )
    return doubted, True


def _has_map(mission: Mission, config: Config) -> bool:
    return config.landmarks.use_map and mission.landmark_map is not None


def _local(start: Alignment) -> Alignment:
    """A start that is merely the frame's zero is known without error."""
    sigma_p = start.sigma_p if start.georeferenced else np.append(np.zeros(2), start.sigma_p[2])
    sigma_yaw = start.sigma_rpy[2] if start.heading_known else 0.0
    return replace(start, sigma_p=sigma_p, sigma_rpy=np.append(start.sigma_rpy[:2], sigma_yaw))


def _inertial(mission: Mission, imu: Sensor, series: LandmarkSeries, config: Config) -> Outset:
    check_accelerometer_unit(mission, imu)
    begin = align(mission)
    strapdown = Strapdown(imu, mission.origin)
    start = inertial_start(mission, imu, config.motion)
    start = _standing(mission, begin, start, config)
    aids, rejections = aids_of(mission, strapdown, start, config)
    measured = [_since(own, start.state.t) for own in (series.t, *(aid.t for aid in aids))]
    t = np.unique(np.concatenate([record_times(*mission.span_s, config.motion.rate_hz), *measured]))
    return Outset(
        t,
        InertialVehicle(strapdown, start, aids, t),
        start.georeferenced and _has_map(mission, config),
        start.georeferenced,
        tuple(aids),
        rejections,
    )


def _standing(
    mission: Mission, begin: Alignment, start: InertialStart, config: Config
) -> InertialStart:
    """A start without an idea of the velocity, on a vehicle that is quiet: it stands.

    The first landmarks are seen before a long rest is proved, and their bearings are not linear in
    a tilt and a velocity of any size.
    """
    aided = any(mission.first(kind) for kind in ("gnss", "dvl", "odometry"))
    if aided or not (start.rest is not None or at_rest(mission, begin.t)):
        return start
    P, R_nb = start.P.copy(), start.state.body.R_nb
    P[NU, NU] = config.motion.zero_velocity_sigma_m_s**2 * np.eye(3)
    if start.rest is None:
        P_n = R_nb @ P[THETA, THETA] @ R_nb.T
        P_n[:2, :2] = np.diag(begin.sigma_rpy[:2] ** 2)
        P[THETA, THETA] = R_nb.T @ P_n @ R_nb
    return replace(start, P=P)


def _since(t: Array, start_s: float) -> Array:
    return t[t >= start_s]
