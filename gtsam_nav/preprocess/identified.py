"""A mission whose sightings are told apart by their places, not by the sensor's ids."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.preprocess.inertial_path import inertial_path
from gtsam_nav.preprocess.landmark_drift import of_odometry
from gtsam_nav.preprocess.landmark_hypotheses import Sighted, explained
from gtsam_nav.preprocess.planar_motion import planar_motion
from gtsam_nav.preprocess.planar_smoothing import SightedPoints
from gtsam_nav.preprocess.settings import MotionSettings
from gtsam_nav.preprocess.tracklets import noise_found
from gtsam_nav.sensors.association import NONE
from gtsam_nav.sensors.landmarks import level_points, variance_factors
from gtsam_nav.sensors.noise import LandmarkNoise
from gtsam_nav.sensors.prediction import chi2_limit
from gtsam_nav.sensors.settings import LandmarkSettings
from gtsam_nav.series import IntArray, LandmarkSeries

MOMENT_S = 0.05
"""Sightings that follow each other faster are of one moment."""
HYPOTHESES = 20
"""That joint association follows side by side."""
MOTION_EXCESS = 4.0
"""By how much the variance of dead reckoning is larger than that of white readings: their errors
share much from one moment to the next."""
NO_MAP = "sightings without ids are not matched with the surveyed landmarks: the map is not used"


def unidentified(mission: Mission) -> Iterator[str]:
    """A warning for each sensor of landmarks most of whose sightings have no id to be used by."""
    for sensor in mission.of_type("landmarks"):
        assert isinstance(sensor.series, LandmarkSeries)
        ids = sensor.series.id
        n = int(np.sum(ids < 0))
        if 2 * n > len(ids):
            yield (
                f"'{sensor.name}': {n} of {len(ids)} sightings have no id and are not used;"
                " landmarks.association=joint tells landmarks apart without"
            )


def identified(mission: Mission, motion: MotionSettings, settings: LandmarkSettings) -> Mission:
    """The mission with ids of its own making: landmarks in the order of their discovery.

    Parameters
    ----------
    mission : Mission
        With one sensor of landmarks, that measures range and bearing, and with a DVL, odometry or
        an IMU that starts at rest.
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
    if len(sensors) > 1:
        raise DataError(
            f"mission '{mission.name}': landmarks.association={settings.association} needs a single"
            f" sensor of landmarks; there are {', '.join(s.name for s in sensors)}. The other"
            " choice is landmarks.association=ids"
        )
    sensor = sensors[0]
    assert isinstance(sensor.series, LandmarkSeries)
    most = HYPOTHESES if settings.association == "joint" else 1
    gate = chi2_limit(settings.gate_probability, 2)
    ids = _numbered(explained(_drive(mission, sensor, motion), most, gate).landmark)
    mission = mission.with_sensor(replace(sensor, series=replace(sensor.series, id=ids)))
    if mission.landmark_map is None or not settings.use_map:
        return mission
    return replace(mission, landmark_map=None, warnings=(*mission.warnings, NO_MAP))


def _drive(mission: Mission, sensor: Sensor, settings: MotionSettings) -> Sighted:
    """The drive as it was dead-reckoned, by inertial readings where nothing measures the speed."""
    motion, series = planar_motion(mission, settings, readings_suffice=True), sensor.series
    assert isinstance(series, LandmarkSeries)
    inertial = None
    if motion is None:
        inertial = inertial_path(mission, settings)
        motion = inertial.motion
    t = _moments(np.append(motion.t[0], series.t))
    p_b, cov_b = level_points(series, sensor)
    seen = SightedPoints(np.searchsorted(t, series.t, side="right") - 1, p_b, cov_b)
    increments = motion.increments(t)
    increments = replace(increments, variance=MOTION_EXCESS * increments.variance)
    # sightings that share errors tell less than their number
    shared = variance_factors(series.t, LandmarkNoise.model_validate(sensor.noise))
    if inertial is not None:
        widened = replace(seen, cov_b=shared[:, None, None] * cov_b)
        return Sighted(increments, widened, 1.0 / shared, inertial.drift(t))
    # they may scatter less than stated too
    variance = noise_found(t, seen, motion) * shared
    drift = of_odometry(increments, motion.scale_sigma, motion.curvature_sigma)
    return Sighted(
        increments, replace(seen, cov_b=variance[:, None, None] * cov_b), 1.0 / shared, drift
    )


def _numbered(landmark: IntArray) -> IntArray:
    """Landmarks in the order of discovery; NONE of what was seen once."""
    names, first, of, count = np.unique(
        landmark, return_index=True, return_inverse=True, return_counts=True
    )
    number = np.full(len(names), NONE)
    kept = np.flatnonzero(count > 1)
    number[kept[np.argsort(first[kept], kind="stable")]] = np.arange(len(kept))
    return np.asarray(number[of])


def _moments(t: Array) -> Array:
    """Times without those that follow another at once."""
    t = np.unique(t)
    return np.asarray(t[np.append(True, np.diff(t) > MOMENT_S)])
