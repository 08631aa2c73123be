"""Scans on a dead-reckoned track: what scan matching and pose SLAM start from.

The dead-reckoning filter gives the motion while a scan is gathered and from one scan to the next;
the covariance of its displacement starts from zero at each scan: Mallios et al. 2014, section 3.2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtsam_nav.config import Config
from gtsam_nav.ekf.compounding import compound, tail_to_tail
from gtsam_nav.ekf.constant_velocity import YAW, Filtered
from gtsam_nav.ekf.dead_reckoning import DeadReckoned, dead_reckon
from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission, Rejection, Sensor
from gtsam_nav.preprocess.alignment import Alignment, align
from gtsam_nav.sensors.noise import HeadingNoise
from gtsam_nav.series import IntArray
from gtsam_nav.sonar.motion import PlanarMotion
from gtsam_nav.sonar.preparation import (
    SonarData,
    deskewed,
    leave_out_defective_sonar,
    sonar_turns,
)

PLANAR = np.array([0, 1, YAW])
"""North, east and yaw in the state of the dead-reckoning filter."""


@dataclass(frozen=True)
class ScanTrack:
    """Deskewed scans, and the dead reckoning that runs through them.

    Attributes
    ----------
    mission : Mission
        With the one sonar that is used.
    start : Alignment
    reckoned : DeadReckoned
        Recorded at the trajectory's rate and at each scan's reference time.
    sonar : SonarData
    record : ndarray of int, shape (n,)
        Record of each scan's reference time.
    complete_s : ndarray, shape (n,)
        When the last beam of each scan came in.
    displacement_cov : ndarray, shape (r, 3, 3)
        Of north, east and yaw at each record since the scan before it (the start, before the
        first); the yaw is absolute where there is a compass.
    has_compass : bool
    min_points : int
        A scan with fewer is not registered.
    rejections, warnings : tuple
        The mission's included.
    """

    mission: Mission
    start: Alignment
    reckoned: DeadReckoned
    sonar: SonarData
    record: IntArray
    complete_s: Array
    displacement_cov: Array
    has_compass: bool
    min_points: int
    rejections: tuple[Rejection, ...]
    warnings: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.record)

    @property
    def instrument(self) -> Sensor:
        """The sonar."""
        return _sonar_of(self.mission)

    @property
    def filtered(self) -> Filtered:
        """All records of the dead-reckoning filter."""
        return self.reckoned.filtered

    @property
    def t(self) -> Array:
        """Reference times of the scans, shape (n,), s."""
        return self.sonar.turns.t_ref

    def pose(self, k: int) -> Array:
        """Dead-reckoned north, east and yaw of scan k, shape (3,)."""
        return np.asarray(self.filtered.x[self.record[k], PLANAR])

    def cov_since_last(self, k: int) -> Array:
        """Covariance of the displacement from the scan before scan k, shape (3, 3)."""
        return np.asarray(self.displacement_cov[self.record[k]])

    def predict(self, k: int, last: Array) -> tuple[Array, Array, Array]:
        """Pose of scan k by dead reckoning from the pose of the scan before.

        With a compass the displacement is aligned with north: x and y add, the yaw is the
        compass's. Without one it turns with the pose that it starts from.

        Returns
        -------
        pose : ndarray, shape (3,)
        J_last : ndarray, shape (3, 3)
            Its Jacobian in the last pose.
        cov_added : ndarray, shape (3, 3)
        """
        before, here, cov = self.pose(k - 1), self.pose(k), self.cov_since_last(k)
        if self.has_compass:
            pose = np.append(last[:2] + here[:2] - before[:2], here[2])
            return pose, np.diag([1.0, 1.0, 0.0]), cov
        q, _, J_here = tail_to_tail(before, here)
        pose, J_last, J_q = compound(last, q)
        J = J_q @ J_here
        return pose, J_last, J @ cov @ J.T

    def displacement(self, k: int) -> tuple[Array, Array]:
        """Dead-reckoned pose of scan k in the scan before (3,), and its covariance (3, 3)."""
        q, J_before, J_here = tail_to_tail(self.pose(k - 1), self.pose(k))
        cov = J_here @ self.cov_since_last(k) @ J_here.T
        if self.has_compass:
            yaw_variance = self.cov_since_last(k - 1)[2, 2]
            cov += yaw_variance * np.outer(J_before[:, 2], J_before[:, 2])
        return q, cov


def follow_scans(mission: Mission, config: Config) -> ScanTrack:
    """Dead-reckon a mission and form its scans.

    Raises
    ------
    DataError
        Where the mission has no usable sonar, or nothing measures the velocity.
    EstimationError
        Where the filter diverges to values that are not finite.
    """
    start = align(mission)
    mission, echoes, left_out, warnings = leave_out_defective_sonar(mission, config.sonar)
    turns = sonar_turns(mission, config.sonar)
    if echoes is None or turns is None:
        why = "".join(f"; {warning}" for warning in warnings)
        raise DataError(
            f"mission '{mission.name}': scan matching needs a turn of a scanning sonar (beams)"
            f" or scans; the mission has: {', '.join(sorted(mission.sensors))}{why}"
        )
    has_compass = mission.first("heading") is not None
    restarted = (0, 1) if has_compass else (0, 1, YAW)
    reckoned = dead_reckon(mission, start, config, turns.t_ref, restarted)
    record = np.searchsorted(reckoned.filtered.t, turns.t_ref)
    motion = _planar_motion(reckoned.filtered, record, has_compass)
    return ScanTrack(
        mission=mission,
        start=start,
        reckoned=reckoned,
        sonar=deskewed(echoes, turns, motion),
        record=record,
        complete_s=_sonar_of(mission).series.t[turns.last - 1],
        displacement_cov=_displacement_cov(reckoned.filtered, record, mission),
        has_compass=has_compass,
        min_points=config.sonar.scans.min_points,
        rejections=(*mission.rejections, *left_out, *reckoned.rejections),
        warnings=(*mission.warnings, *warnings),
    )


def _sonar_of(mission: Mission) -> Sensor:
    sonar = mission.first("beams") or mission.first("scans")
    assert sonar is not None
    return sonar


def _planar_motion(filtered: Filtered, record: IntArray, has_compass: bool) -> PlanarMotion:
    """The track for deskewing, with the usual growth of its displacement's variance."""
    ends = np.append(record[1:], len(filtered.t) - 1)
    elapsed = np.maximum(filtered.t[ends] - filtered.t[record], 1e-6)
    n, e, yaw = np.diagonal(filtered.P[ends], axis1=1, axis2=2)[:, PLANAR].T
    position_growth = float(np.median((n + e) / (2 * elapsed)))
    # an absolute heading's error is drawn anew about every second, that of a turn grows
    yaw_growth = float(np.median(yaw if has_compass else yaw / elapsed))
    track = np.unwrap(filtered.x[:, YAW])
    return PlanarMotion(filtered.t, filtered.x[:, :2], track, position_growth, yaw_growth)


def _displacement_cov(filtered: Filtered, record: IntArray, mission: Mission) -> Array:
    """North, east and yaw since the last scan; a compass's error turns the displacement with it."""
    cov = filtered.P[:, PLANAR[:, None], PLANAR]
    compass = mission.first("heading")
    if compass is None:
        return cov
    sigma = np.radians(HeadingNoise.model_validate(compass.noise).disturbance_sigma_deg)
    since = np.searchsorted(record, np.arange(len(cov)))
    origin = np.append(0, record)[since]
    north, east = (filtered.x[:, :2] - filtered.x[origin, :2]).T
    turning = np.stack([-east, north, np.ones(len(cov))], axis=1)
    return np.asarray(cov + sigma**2 * np.einsum("ri,rj->rij", turning, turning))
