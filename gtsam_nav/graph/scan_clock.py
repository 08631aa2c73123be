"""What a scanner's stamps are off by: its scans tell how the vehicle moved, its clock only when.

Scans are registered in pairs, and the motion between their stamps, moved by a constant, must be
what is found. A vehicle that turns steadily says nothing of the constant; where its speeds change
most between the two, the pair tells most.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace

import numpy as np

from gtsam_nav.config import Config
from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.graph.scan_matching import PRIOR_FLOOR, between
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.preprocess.motion import VehicleMotion
from gtsam_nav.registration.pic import register
from gtsam_nav.sensors.prediction import chi2_limit
from gtsam_nav.series import IntArray
from gtsam_nav.solution import ClockOffset
from gtsam_nav.sonar.motion import PlanarMotion
from gtsam_nav.sonar.preparation import SonarData

log = logging.getLogger(__name__)

MOST_PAIRS = 200
MAX_STEPS = 30
STILL_SIGMAS = 0.01
SLOPE_S = 0.05
"""Half of the time over which the motion's derivative is taken."""
CAUCHY = 2.385
"""The kernel's scale, 95 % efficient on Gaussian residuals."""
MEDIAN = chi2_limit(0.5, 3)


@dataclass(frozen=True)
class _Pairs:
    """Registered pairs of scans: stamps (n, 2), and the pose of b in a with its covariance."""

    t: Array
    q: Array
    cov: Array

    def residuals(self, motion: PlanarMotion, offset_s: float) -> Array:
        """Found less what the motion says, shape (n, 3)."""
        off = self.q - increments(motion, self.t + offset_s)
        off[:, 2] = wrap_angle(off[:, 2])
        return off


def increments(motion: PlanarMotion, t: Array) -> Array:
    """Pose at the second of two times in that at the first, shape (n, 3), for times (n, 2)."""
    (ne_a, yaw_a), (ne_b, yaw_b) = (motion.at(column) for column in t.T)
    pairs = zip(np.column_stack([ne_a, yaw_a]), np.column_stack([ne_b, yaw_b]), strict=True)
    return np.array([between(a, b)[0] for a, b in pairs]).reshape(-1, 3)


def planar_of(motion: VehicleMotion) -> PlanarMotion:
    """The planar part of a vehicle's motion."""
    return PlanarMotion.of(
        motion.trajectory, motion.position_variance_m2_s, motion.yaw_variance_rad2_s
    )


def with_scans_in_time(
    mission: Mission, sonar: SonarData | None, motion: VehicleMotion, config: Config
) -> tuple[Mission, SonarData | None, tuple[ClockOffset, ...]]:
    """The mission and its scans with their stamps put right, where the mission asks for it."""
    sensor = mission.first("scans")
    if sensor is None or sonar is None or not (sonar.at_once and sensor.time_offset_sigma_s):
        return mission, sonar, ()
    found = find_scan_clock(sensor, sonar, planar_of(motion), config)
    moved = replace(sensor, series=sensor.series.shift(found.offset_s))
    return mission.with_sensor(moved), sonar.shift(found.offset_s), (found,)


def find_scan_clock(
    sensor: Sensor, sonar: SonarData, motion: PlanarMotion, config: Config
) -> ClockOffset:
    """What must be added to the stamps of scans that are taken at once.

    Parameters
    ----------
    sensor : Sensor
        The scanner; its ``time_offset_sigma_s`` is the spread of the constant beforehand.
    motion : PlanarMotion
        By all other sensors.
    """
    pairs = _registered(sonar, motion, config)
    prior_sigma_s = sensor.time_offset_sigma_s
    offset_s, sigma_s, scale2 = 0.0, prior_sigma_s, 1.0
    for _ in range(MAX_STEPS):
        e = pairs.residuals(motion, offset_s)
        slope = _slopes(motion, pairs.t + offset_s)
        W = np.linalg.inv(pairs.cov)
        squared = np.einsum("ni,nij,nj->n", e, W, e)
        scale2 = max(1.0, float(np.median(squared)) / MEDIAN) if len(e) else 1.0
        weight = 1.0 / (1.0 + squared / scale2 / CAUCHY**2) / scale2
        information = np.einsum("n,ni,nij,nj->", weight, slope, W, slope) + prior_sigma_s**-2
        gradient = np.einsum("n,ni,nij,nj->", weight, slope, W, e) - offset_s / prior_sigma_s**2
        step = float(gradient / information)
        offset_s, sigma_s = offset_s + step, float(information**-0.5)
        if abs(step) < STILL_SIGMAS * sigma_s:
            break
    log.info("stamps of '%s': %+.3f s, sigma %.3f s", sensor.name, offset_s, sigma_s)
    return ClockOffset(sensor.name, "time_offset", offset_s, sigma_s, prior_sigma_s)


def _slopes(motion: PlanarMotion, t: Array) -> Array:
    """Derivative of the increments in a constant added to their times, shape (n, 3)."""
    later, earlier = (increments(motion, t + side) for side in (SLOPE_S, -SLOPE_S))
    change = later - earlier
    change[:, 2] = wrap_angle(change[:, 2])
    return change / (2 * SLOPE_S)


def _registered(sonar: SonarData, motion: PlanarMotion, config: Config) -> _Pairs:
    """The pairs of scans in sequence that tell most, registered."""
    t = np.column_stack([sonar.turns.t_ref[:-1], sonar.turns.t_ref[1:]])
    variance = np.diff(t, axis=1) * [
        [motion.position_variance_m2_s, motion.position_variance_m2_s, motion.yaw_variance_rad2_s]
    ]
    chosen = _telling(_slopes(motion, t), variance)
    found, cov = [], []
    kept = []
    for k in chosen.tolist():
        a, b = sonar.scans[k], sonar.scans[k + 1]
        if min(len(a), len(b)) < config.sonar.scans.min_points:
            continue
        prior = increments(motion, t[k : k + 1])[0]
        match = register(a, b, prior, np.diag(PRIOR_FLOOR**2), config.pic)
        if match.ok:
            kept.append(k)
            found.append(match.q)
            cov.append(match.cov + np.diag(variance[k]))
    shape = (len(kept), 3)
    return _Pairs(t[kept], np.reshape(found, shape), np.reshape(cov, (*shape, 3)))


def _telling(slope: Array, variance: Array) -> IntArray:
    """Indices of the pairs whose increments change most for their uncertainty, in order."""
    told = np.sum(slope**2 / np.maximum(variance, 1e-12), axis=1)
    return np.sort(np.argsort(-told, kind="stable")[:MOST_PAIRS])
