"""What a scanner's scans tell of its clock and of the odometry's wheels, before all is estimated.

Scans are registered in pairs that follow each other, and the motion between their stamps must be
what is found. Stamps that are late by a constant show where the vehicle's speeds change from one
scan to the other; wheels of unequal size, in a turn in proportion to the way that the odometry does
not know of. Both are constants of the mission: Censi et al., *Simultaneous calibration of odometry
and sensor parameters for mobile robots* (T-RO 2013), with the clock in place of the mounting.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace

import numpy as np

from gtsam_nav.config import Config
from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.graph.scan_matching import between
from gtsam_nav.mission import Mission
from gtsam_nav.preprocess.motion import VehicleMotion
from gtsam_nav.registration.pic import register
from gtsam_nav.registration.prior import PRIOR_FLOOR
from gtsam_nav.sensors.odometry import curvature_sigma
from gtsam_nav.sensors.prediction import chi2_limit
from gtsam_nav.series import IntArray, OdometrySeries
from gtsam_nav.solution import ClockOffset
from gtsam_nav.sonar.motion import PlanarMotion
from gtsam_nav.sonar.preparation import SonarData

log = logging.getLogger(__name__)

MOST_PAIRS = 150
"""Registered for each constant: those that tell most of it."""
MAX_STEPS = 30
STILL_SIGMAS = 0.01
SLOPE_S = 0.05
"""Half of the time over which the motion's derivative is taken."""
CAUCHY = 2.385
"""The kernel's scale, 95 % efficient on Gaussian residuals."""
SURE_SIGMAS = 3.0
TURNED_BY = ("heading", "attitude", "imu", "dvl")
"""Where any of these is on board, odometry does not turn the vehicle."""


@dataclass(frozen=True)
class ScanCalibration:
    """Constants of a mission by its scans.

    Attributes
    ----------
    clock : ClockOffset or None
        Of the scanner; None where it was not in doubt.
    curvature_rad_m, sigma_rad_m : float
        Turn a metre that the odometry's yaw rate lacks, and its standard deviation.
    """

    clock: ClockOffset | None
    curvature_rad_m: float
    sigma_rad_m: float

    @property
    def offset_s(self) -> float:
        """What must be added to the scans' stamps, s."""
        return self.clock.offset_s if self.clock else 0.0

    def corrected(self, mission: Mission) -> Mission:
        """The mission with scans and odometry put right."""
        scans = mission.first("scans")
        assert scans is not None
        series = scans.series.shift(self.offset_s)
        mission = mission.with_sensor(replace(scans, series=series))
        odometry = mission.first("odometry")
        if odometry is None or self.curvature_rad_m == 0.0:
            return mission
        wheels = odometry.series
        assert isinstance(wheels, OdometrySeries)
        yaw_rate = wheels.yaw_rate + self.curvature_rad_m * wheels.v_b[:, 0]
        # the stated sigma stays: the graph takes the same scans in, and they would count twice
        return mission.with_sensor(replace(odometry, series=replace(wheels, yaw_rate=yaw_rate)))

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the user must hear of."""
        if abs(self.curvature_rad_m) < SURE_SIGMAS * self.sigma_rad_m or not self.sigma_rad_m:
            return ()
        found, sigma = np.degrees([self.curvature_rad_m, self.sigma_rad_m])
        return (
            f"the odometry lacks a turn of {found:.2f} deg/m (sigma {sigma:.2f}) by the scans:"
            " put right",
        )


def calibrate_by_scans(
    mission: Mission, sonar: SonarData | None, motion: VehicleMotion, config: Config
) -> ScanCalibration | None:
    """Find the constants; None where the scans are not taken at once, or all is known.

    Parameters
    ----------
    motion : VehicleMotion
        By all other sensors.
    """
    scanner = mission.first("scans")
    if sonar is None or scanner is None or not sonar.at_once:
        return None
    sigma = np.array([scanner.time_offset_sigma_s, _curvature_sigma(mission)])
    if not np.any(sigma):
        return None
    pairs = _registered(sonar, planar_of(motion), config)
    (offset_s, curvature), (offset_sigma_s, sigma_rad_m) = _fitted(pairs, sigma)
    log.info("stamps of '%s': %+.3f s, sigma %.3f s", scanner.name, offset_s, offset_sigma_s)
    log.info("odometry lacks %+.3f deg/m", np.degrees(curvature))
    clock = ClockOffset(scanner.name, "time_offset", offset_s, offset_sigma_s, float(sigma[0]))
    return ScanCalibration(clock if sigma[0] else None, curvature, sigma_rad_m)


def planar_of(motion: VehicleMotion) -> PlanarMotion:
    """The planar part of a vehicle's motion."""
    return PlanarMotion.of(
        motion.trajectory, motion.position_variance_m2_s, motion.yaw_variance_rad2_s
    )


def _curvature_sigma(mission: Mission) -> float:
    """Of the turn that goes unnoticed, rad/m; zero where odometry does not turn the vehicle."""
    return 0.0 if any(map(mission.of_type, TURNED_BY)) else curvature_sigma(mission)


@dataclass(frozen=True)
class _Pairs:
    """Registered pairs of scans: stamps (n, 2), and the pose of b in a with its covariance."""

    motion: PlanarMotion
    t: Array
    q: Array
    cov: Array

    def residuals(self, offset_s: float, curvature: float) -> Array:
        """Found less what the motion says, shape (n, 3)."""
        predicted = increments(self.motion, self.t + offset_s)
        turned = curvature * _by_curvature(self.motion, self.t + offset_s)
        off = self.q - predicted - turned
        off[:, 2] = wrap_angle(off[:, 2])
        return off

    def slopes(self, offset_s: float) -> Array:
        """Derivative of what the motion says in offset and curvature, shape (n, 3, 2)."""
        return slopes(self.motion, self.t + offset_s)


def increments(motion: PlanarMotion, t: Array) -> Array:
    """Pose at the second of two times in that at the first, shape (n, 3), for times (n, 2)."""
    (ne_a, yaw_a), (ne_b, yaw_b) = (motion.at(column) for column in t.T)
    pairs = zip(np.column_stack([ne_a, yaw_a]), np.column_stack([ne_b, yaw_b]), strict=True)
    return np.array([between(a, b)[0] for a, b in pairs]).reshape(-1, 3)


def slopes(motion: PlanarMotion, t: Array) -> Array:
    """Derivative of the increments in a constant added to their times, and in a curvature."""
    later, earlier = (increments(motion, t + side) for side in (SLOPE_S, -SLOPE_S))
    change = later - earlier
    change[:, 2] = wrap_angle(change[:, 2])
    return np.stack([change / (2 * SLOPE_S), _by_curvature(motion, t)], axis=2)


def _by_curvature(motion: PlanarMotion, t: Array) -> Array:
    """The same in the curvature of the way between: half of the turn has come halfway."""
    q = increments(motion, t)
    way = q[:, 0]
    return np.column_stack([-0.5 * way * q[:, 1], 0.5 * way * q[:, 0], way])


def _fitted(pairs: _Pairs, prior_sigma: Array) -> tuple[list[float], list[float]]:
    """Offset and curvature with their sigmas, by Gauss-Newton under a kernel."""
    free = prior_sigma > 0
    prior = np.diag(np.where(free, 1.0 / np.where(free, prior_sigma, 1.0) ** 2, 0.0))[free][:, free]
    p, W = np.zeros(2), np.linalg.inv(pairs.cov)
    information = prior
    for _ in range(MAX_STEPS):
        e, J = pairs.residuals(*p), pairs.slopes(p[0])[:, :, free]
        squared = np.einsum("ni,nij,nj->n", e, W, e)
        scale2 = max(1.0, float(np.median(squared)) / chi2_limit(0.5, 3)) if len(e) else 1.0
        weight = 1.0 / (1.0 + squared / scale2 / CAUCHY**2) / scale2
        information = np.einsum("n,nia,nij,njb->ab", weight, J, W, J) + prior
        gradient = np.einsum("n,nia,nij,nj->a", weight, J, W, e) - prior @ p[free]
        step = np.linalg.solve(information, gradient)
        p[free] += step
        if step @ information @ step < STILL_SIGMAS**2:
            break
    sigma = np.zeros(2)
    sigma[free] = np.sqrt(np.diag(np.linalg.inv(information)))
    return p.tolist(), sigma.tolist()


def _registered(sonar: SonarData, motion: PlanarMotion, config: Config) -> _Pairs:
    """The pairs of scans in sequence that tell most, registered."""
    t = np.column_stack([sonar.turns.t_ref[:-1], sonar.turns.t_ref[1:]])
    position, yaw = motion.position_variance_m2_s, motion.yaw_variance_rad2_s
    variance = np.diff(t, axis=1) * [position, position, yaw]
    kept, found, cov = [], [], []
    for k in _telling(slopes(motion, t), variance).tolist():
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
    return _Pairs(motion, t[kept], np.reshape(found, shape), np.reshape(cov, (*shape, 3)))


def _telling(slope: Array, variance: Array) -> IntArray:
    """Indices of the pairs whose increments change most for their uncertainty, in order."""
    told = np.sum(slope**2 / np.maximum(variance, 1e-12)[:, :, None], axis=1)
    best = np.argsort(-told, axis=0, kind="stable")[:MOST_PAIRS]
    return np.unique(best)
