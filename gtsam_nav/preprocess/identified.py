"""A mission whose sightings are told apart by their places, not by the sensor's ids."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.preprocess.landmark_identity import Identities
from gtsam_nav.preprocess.planar_map import PlanarMap
from gtsam_nav.preprocess.planar_motion import PlanarMotion, planar_motion
from gtsam_nav.preprocess.planar_smoothing import SightedPoints
from gtsam_nav.preprocess.settings import MotionSettings
from gtsam_nav.preprocess.tracklets import noise_found, tracklets
from gtsam_nav.sensors.landmarks import level_points, variance_factors
from gtsam_nav.sensors.noise import LandmarkNoise
from gtsam_nav.sensors.prediction import chi2_limit
from gtsam_nav.sensors.settings import LandmarkSettings
from gtsam_nav.series import IntArray, LandmarkSeries

MOMENT_S = 0.05
"""Sightings that follow each other faster are of one moment."""
RESOLVED_SIGMAS = 3.0
"""Landmarks that are nearer to each other, in sigmas of a usual sighting, look alike."""
MOTION_EXCESS = 4.0
"""By how much the variance of dead reckoning is larger than that of white readings: their errors
share much from one moment to the next."""
NO_MAP = "sightings without ids are not matched with the surveyed landmarks: the map is not used"


def identified(mission: Mission, motion: MotionSettings, settings: LandmarkSettings) -> Mission:
    """The mission with ids of its own making: landmarks in the order of their discovery.

    Parameters
    ----------
    mission : Mission
        With one sensor of landmarks, that measures range and bearing, and with a DVL or odometry.
    motion : MotionSettings
    settings : LandmarkSettings
        How landmarks are told apart.

    Raises
    ------
    DataError
        Where the mission does not allow that.
    """
    sensors = mission.of_type("landmarks")
    if not sensors:
        return mission
    dead_reckoned = planar_motion(mission, motion)
    if len(sensors) > 1 or dead_reckoned is None:
        lacks = "a DVL or odometry" if dead_reckoned is None else "a single sensor of landmarks"
        raise DataError(
            f"mission '{mission.name}': landmarks.association={settings.association} needs {lacks}"
        )
    sensor = sensors[0]
    assert isinstance(sensor.series, LandmarkSeries)
    ids = _ids(sensor, dead_reckoned, settings)
    mission = mission.with_sensor(replace(sensor, series=replace(sensor.series, id=ids)))
    if mission.landmark_map is None or not settings.use_map:
        return mission
    return replace(mission, landmark_map=None, warnings=(*mission.warnings, NO_MAP))


def _ids(sensor: Sensor, motion: PlanarMotion, settings: LandmarkSettings) -> IntArray:
    series = sensor.series
    assert isinstance(series, LandmarkSeries)
    t = _moments(np.append(motion.t[0], series.t))
    p_b, cov_b = level_points(series, sensor)
    seen = SightedPoints(np.searchsorted(t, series.t, side="right") - 1, p_b, cov_b)
    seen = replace(seen, cov_b=noise_found(t, seen, motion) * cov_b)
    spread = np.sqrt(np.linalg.eigvalsh(seen.cov_b)[:, -1])
    resolution = RESOLVED_SIGMAS * float(np.median(spread))
    excess = variance_factors(series.t, LandmarkNoise.model_validate(sensor.noise))
    increments = motion.increments(t)
    planar_map = PlanarMap(
        replace(increments, variance=MOTION_EXCESS * increments.variance),
        replace(seen, cov_b=excess[:, None, None] * seen.cov_b),
        motion.scale_sigma,
        motion.curvature_sigma,
        chi2_limit(settings.gate_probability, 2),
    )
    number = tracklets(t, seen, motion)
    return Identities(planar_map, t, number, resolution, settings).run()


def _moments(t: Array) -> Array:
    """Times without those that follow another at once."""
    t = np.unique(t)
    return np.asarray(t[np.append(True, np.diff(t) > MOMENT_S)])
