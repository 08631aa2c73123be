"""Landmark SLAM: an extended Kalman filter over the vehicle and the landmarks that it sights.

The planar configuration (odometry, or DVL and compass) is that of *Inertial navigation system aided
by SLAM*, equations (1) to (8): motion with A, W and Q in `planar_vehicle`, observation with its
Jacobians and R in `sensors.landmarks`, augmentation and update in `landmark_filter`. The inertial
one lets the 15 errors of the strapdown filter take the place of the planar three.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from gtsam_nav.config import Config
from gtsam_nav.ekf.inertial_vehicle import AidUpdates, InertialVehicle
from gtsam_nav.ekf.landmark_filter import LandmarkFilter
from gtsam_nav.ekf.landmark_outset import Outset, outset
from gtsam_nav.ekf.sighting_updates import SightingUpdates
from gtsam_nav.errors import DataError, EstimationError
from gtsam_nav.frames import Array, quaternion_from_rotation
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.preprocess.depth_by_ranges import said_of_depth
from gtsam_nav.sensors.twins import said_of_twin
from gtsam_nav.series import LandmarkSeries
from gtsam_nav.solution import Innovations, LandmarkEstimates, Progress, Solution, StageClock
from gtsam_nav.trajectory import Trajectory

PROGRESS_EVERY = 1000
FARTHEST_M = 1e7
"""No place on Earth is farther from another in a local frame."""

NO_PLACE = (
    "nothing tells where on the map of surveyed landmarks the mission begins: the map is not used"
)


def estimate(mission: Mission, config: Config, progress: Progress) -> Solution:
    """Estimate a mission with landmarks.

    Parameters
    ----------
    mission : Mission
        With sightings of landmarks, and with odometry, a DVL and a compass, or an IMU. Surveyed
        landmarks are used with ``landmarks.use_map``; where the mission does not state its start,
        a planar vehicle's is searched on their map.
    config : Config
        ``landmark_ekf.motion`` chooses the vehicle, ``landmarks`` the treatment of the sightings.
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
        begin = outset(mission, series, config)
        slam = LandmarkFilter(begin.vehicle, sensor, elevation=series.elevation is not None)
        if begin.on_map:
            _survey(slam, mission)
        sightings = SightingUpdates(slam, series, sensor, config.landmarks)
    with clock.stage("filter"):
        aids = _aid_updates(slam, begin)
        trajectory = _run(slam, sightings, aids, begin, progress)
        sightings.finish()
    lacks_map = config.landmarks.use_map and mission.landmark_map is not None and not begin.on_map
    return Solution(
        method="landmark-ekf",
        trajectory=trajectory,
        mission=mission,
        georeferenced=begin.georeferenced,
        rejections=(
            *mission.rejections,
            *begin.rejections,
            *sightings.rejections,
            *(() if aids is None else aids.rejections),
        ),
        warnings=(
            *mission.warnings,
            *_idle_sensors(mission, sensor),
            *([NO_PLACE] if lacks_map else []),
            *said_of_depth(mission, config.landmarks.use_map, estimated=False),
        ),
        innovations=_innovations(sensor, slam, sightings, aids),
        landmarks=_landmarks(slam),
        gnss_used=begin.gnss_used + (0 if aids is None else aids.fixes_used),
        stage_s=clock.seconds,
    )


def _sightings(mission: Mission) -> tuple[Sensor, LandmarkSeries]:
    sensor = mission.first("landmarks")
    if sensor is None:
        present = sorted(name for name, other in mission.sensors.items() if len(other.series))
        raise DataError(
            f"mission '{mission.name}': landmark-ekf needs sightings of landmarks;"
            f" there are samples of: {', '.join(present) or 'nothing'}"
        )
    assert isinstance(sensor.series, LandmarkSeries)
    return sensor, sensor.series


def _idle_sensors(mission: Mission, taken: Sensor) -> Iterator[str]:
    """Sensors of landmarks beside the one whose sightings are used."""
    for sensor in mission.of_type("landmarks"):
        if sensor is not taken:
            choice = f"landmark-ekf takes the first, '{taken.name}'; graph takes all"
            yield said_of_twin(sensor, choice)


def _survey(slam: LandmarkFilter, mission: Mission) -> None:
    surveyed = mission.landmark_map
    assert surveyed is not None
    for id_, p_n, sigma in zip(surveyed.id, surveyed.p_n, surveyed.sigma, strict=True):
        slam.survey(int(id_), p_n, float(sigma))


def _aid_updates(slam: LandmarkFilter, begin: Outset) -> AidUpdates | None:
    if not isinstance(begin.vehicle, InertialVehicle):
        return None
    return AidUpdates(slam, begin.vehicle, begin.aids)


@dataclass
class Track:
    """The states as they are recorded."""

    R_nb: list[Array] = field(default_factory=list)
    p_n: list[Array] = field(default_factory=list)
    v_n: list[Array] = field(default_factory=list)
    cov: list[Array] = field(default_factory=list)

    def record(self, slam: LandmarkFilter) -> None:
        """Add the state of now."""
        body = slam.vehicle.body
        self.R_nb.append(body.R_nb)
        self.p_n.append(body.p_n)
        self.v_n.append(body.v_n)
        self.cov.append(slam.vehicle.pose_cov(slam.vehicle_cov))

    def trajectory(self, t: Array) -> Trajectory:
        """As a trajectory at the times of the records."""
        p_n, cov = np.array(self.p_n), np.array(self.cov)
        if not (np.all(np.isfinite(p_n)) and np.all(np.isfinite(cov))):
            raise EstimationError("landmark-ekf diverged: the state is not finite")
        if np.max(np.abs(p_n)) > FARTHEST_M:
            raise EstimationError(
                f"landmark-ekf diverged: {np.max(np.abs(p_n)):.0e} m from where the mission began;"
                " sightings that contradict the motion do so: `inspect` tells their units and signs"
            )
        return Trajectory(
            t=t,
            p_n=p_n,
            q_nb_wxyz=quaternion_from_rotation(np.array(self.R_nb)),
            v_n=np.array(self.v_n),
            cov_pose_n=cov,
        )


def _run(
    slam: LandmarkFilter,
    sightings: SightingUpdates,
    aids: AidUpdates | None,
    begin: Outset,
    progress: Progress,
) -> Trajectory:
    """Go through all times; the trajectory has the state after the updates of each."""
    t, track = begin.t, Track()
    first, last = (np.searchsorted(sightings.series.t, t, side=s) for s in ("left", "right"))
    for k in range(len(t)):
        if k:
            slam.advance()
        if aids is not None:
            aids.take_all(float(t[k]))
        if last[k] > first[k]:
            sightings.take(np.arange(first[k], last[k]))
        track.record(slam)
        if k % PROGRESS_EVERY == 0:
            progress("landmark filter", k / len(t))
    progress("landmark filter", 1.0)
    return track.trajectory(t)


def _innovations(
    sensor: Sensor, slam: LandmarkFilter, sightings: SightingUpdates, aids: AidUpdates | None
) -> dict[str, Innovations]:
    """Of what was used, by sensor."""
    found = {} if aids is None else aids.innovations()
    if sightings.used:
        whitened = np.array([innovation for _, innovation in sightings.used])
        t, nis = np.array([t for t, _ in sightings.used]), np.sum(whitened**2, axis=1)
        found[sensor.name] = Innovations(t, nis, slam.axes, whitened)
    return found


def _landmarks(slam: LandmarkFilter) -> LandmarkEstimates:
    """Landmarks with the sensor's ids, else numbers in the order of discovery."""
    ids = [landmark.id for landmark in slam.landmarks]
    unused = iter(k for k in range(2 * len(ids) + 1) if k not in ids)
    return LandmarkEstimates(
        np.array([id_ if id_ >= 0 else next(unused) for id_ in ids], dtype=np.int64),
        slam.p_n.copy(),
        np.array([slam.landmark_cov(k) for k in range(len(ids))]).reshape(-1, 3, 3),
    )
