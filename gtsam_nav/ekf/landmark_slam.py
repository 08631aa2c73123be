"""Landmark SLAM: an extended Kalman filter over the vehicle and the landmarks that it sights.

The planar configuration (odometry, or DVL and compass) is that of *Inertial navigation system aided
by SLAM*, equations (1) to (8): motion with A, W and Q in `planar_vehicle`, observation with its
Jacobians and R in `sensors.landmarks`, augmentation and update in `landmark_filter`. The inertial
one lets the 15 errors of the strapdown filter take the place of the planar three.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gtsam_nav.config import Config
from gtsam_nav.ekf.landmark_filter import LandmarkFilter, Vehicle
from gtsam_nav.ekf.planar_vehicle import PlanarVehicle
from gtsam_nav.ekf.sighting_updates import SightingUpdates
from gtsam_nav.errors import DataError, EstimationError
from gtsam_nav.frames import Array, quaternion_from_rotation
from gtsam_nav.mission import LandmarkSeries, Mission, Sensor
from gtsam_nav.preprocess.alignment import Alignment, align
from gtsam_nav.preprocess.landmark_start import landmark_start
from gtsam_nav.preprocess.planar_motion import PlanarMotion, planar_motion
from gtsam_nav.solution import Innovations, LandmarkEstimates, Progress, Solution, StageClock
from gtsam_nav.trajectory import Trajectory

PRIOR_SIGMAS = 2.0
"""A start that was found from sightings is doubted so much: the same sightings come again."""

NO_PLACE = (
    "the first sightings do not tell where on the landmark map the mission begins: the map is not"
    " used"
)


@dataclass(frozen=True)
class Outset:
    """What the filter starts from.

    Attributes
    ----------
    start : Alignment
    t : ndarray, shape (n,)
        Times that the vehicle goes through.
    vehicle : Vehicle
        At the first of them.
    P : ndarray, shape (size, size)
        Covariance of its errors.
    on_map : bool
        Whether the start is known in the frame of the mission's landmark map.
    """

    start: Alignment
    t: Array
    vehicle: Vehicle
    P: Array
    on_map: bool


def estimate(mission: Mission, config: Config, progress: Progress) -> Solution:
    """Estimate a mission with landmarks.

    Parameters
    ----------
    mission : Mission
        With sightings of landmarks, and with odometry, a DVL and a compass, or an IMU. Surveyed
        landmarks are used with ``landmarks.use_map``; the start is searched on their map where the
        mission does not state it.
    config : Config
    progress : Progress

    Raises
    ------
    DataError
        Where the mission has no sightings, or nothing that tells its motion.
    EstimationError
        Where the filter diverges to values that are not finite.
    """
    clock = StageClock()
    with clock.stage("prepare"):
        sensor, series = _sightings(mission)
        outset = _planar_outset(mission, series, config)
        slam = LandmarkFilter(
            outset.vehicle, outset.P, sensor, elevation=series.elevation is not None
        )
        surveyed = mission.landmark_map if outset.on_map else None
        if surveyed is not None:
            for id_, p_n, sigma in zip(surveyed.id, surveyed.p_n, surveyed.sigma, strict=True):
                slam.survey(int(id_), p_n, float(sigma))
        updates = SightingUpdates(slam, series, sensor.name, config.landmarks)
    with clock.stage("filter"):
        trajectory = _run(slam, updates, outset.t, progress)
        updates.finish()
    start, unplaced = outset.start, config.landmarks.use_map and mission.landmark_map is not None
    t_nis, nis = updates.nis()
    return Solution(
        method="landmark-ekf",
        trajectory=trajectory,
        mission=mission,
        georeferenced=start.georeferenced and start.heading_known,
        rejections=(*mission.rejections, *updates.rejections),
        warnings=(*mission.warnings, *([NO_PLACE] if unplaced and not outset.on_map else [])),
        innovations={sensor.name: Innovations(t_nis, nis, slam.axes)} if len(nis) else {},
        landmarks=_landmarks(slam),
        stage_s=clock.seconds,
    )


def _sightings(mission: Mission) -> tuple[Sensor, LandmarkSeries]:
    sensor = mission.first("landmarks")
    if sensor is None:
        raise DataError(
            f"mission '{mission.name}': landmark-ekf needs sightings of landmarks; the mission has:"
            f" {', '.join(sorted(mission.sensors)) or 'no sensor'}"
        )
    assert isinstance(sensor.series, LandmarkSeries)
    return sensor, sensor.series


def _planar_outset(mission: Mission, series: LandmarkSeries, config: Config) -> Outset:
    motion = planar_motion(mission, config.motion)
    if motion is None:
        raise DataError(
            f"mission '{mission.name}': landmark-ekf needs a DVL or odometry, or an IMU"
            f" (landmark_ekf.motion = auto, odometry or ins); the mission has:"
            f" {', '.join(sorted(mission.sensors))}"
        )
    start, on_map = _planar_start(mission, motion, config)
    t = _times(start.t, mission.span_s[1], config.motion.rate_hz, series)
    vehicle = PlanarVehicle(mission, motion, start, t)
    return Outset(start, t, vehicle, vehicle.P_start, on_map)


def _planar_start(mission: Mission, motion: PlanarMotion, config: Config) -> tuple[Alignment, bool]:
    """Where the mission begins, and whether that is known on the map of surveyed landmarks."""
    stated = align(mission)
    if not config.landmarks.use_map or mission.landmark_map is None:
        return _local(stated), False
    if mission.initial.p_n is not None and stated.heading_known:
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


def _local(start: Alignment) -> Alignment:
    """A start that is merely the frame's zero is known without error."""
    sigma_p = start.sigma_p if start.georeferenced else np.append(np.zeros(2), start.sigma_p[2])
    sigma_yaw = start.sigma_rpy[2] if start.heading_known else 0.0
    return replace(start, sigma_p=sigma_p, sigma_rpy=np.append(start.sigma_rpy[:2], sigma_yaw))


def _grid(start_s: float, stop_s: float, rate_hz: float) -> Array:
    t = start_s + np.arange(int((stop_s - start_s) * rate_hz) + 2) * (1.0 / rate_hz)
    return np.asarray(t[t <= stop_s], dtype=float)


def _times(start_s: float, stop_s: float, rate_hz: float, series: LandmarkSeries) -> Array:
    """When the state is recorded, and when something is seen."""
    seen = series.t[(series.t >= start_s) & (series.t <= stop_s)]
    return np.union1d(_grid(start_s, stop_s, rate_hz), seen)


def _run(
    slam: LandmarkFilter, updates: SightingUpdates, t: Array, progress: Progress
) -> Trajectory:
    """Go through all times; the trajectory has the state after the updates of each."""
    R_nb, p_n, v_n = np.empty((len(t), 3, 3)), np.empty((len(t), 3)), np.empty((len(t), 3))
    P = np.empty((len(t), *slam.vehicle_cov.shape))
    first, last = (np.searchsorted(updates.series.t, t, side=side) for side in ("left", "right"))
    for k in range(len(t)):
        if k:
            slam.advance()
        if last[k] > first[k]:
            updates.take(np.arange(first[k], last[k]))
        body = slam.vehicle.body
        R_nb[k], p_n[k], v_n[k], P[k] = body.R_nb, body.p_n, body.v_n, slam.vehicle_cov
        if k % 1000 == 0:
            progress("landmark filter", k / len(t))
    if not np.all(np.isfinite(p_n)) or not np.all(np.isfinite(P)):
        raise EstimationError("landmark-ekf diverged: the state is not finite")
    progress("landmark filter", 1.0)
    return Trajectory(
        t=t,
        p_n=p_n,
        q_nb_wxyz=quaternion_from_rotation(R_nb),
        v_n=v_n,
        cov_pose_n=slam.vehicle.pose_cov(P),
    )


def _landmarks(slam: LandmarkFilter) -> LandmarkEstimates:
    """Landmarks with the sensor's ids, else numbers in the order of discovery."""
    ids = [landmark.id for landmark in slam.landmarks]
    unused = iter(k for k in range(2 * len(ids) + 1) if k not in ids)
    return LandmarkEstimates(
        np.array([id_ if id_ >= 0 else next(unused) for id_ in ids], dtype=np.int64),
        slam.p_n.copy(),
        np.array([slam.landmark_cov(k) for k in range(len(ids))]).reshape(-1, 3, 3),
    )
