"""Scans on a dead-reckoned track: what scan matching and pose SLAM start from.

The dead-reckoning filter gives the motion while a scan is gathered and from one scan to the next;
the covariance of its displacement starts from zero at each scan: Mallios et al. 2014, section 3.2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtsam_nav.config import Config
from gtsam_nav.ekf.compass_drift import CompassDrift
from gtsam_nav.ekf.compounding import compound, tail_to_tail
from gtsam_nav.ekf.constant_velocity import YAW, Filtered
from gtsam_nav.ekf.dead_reckoning import DeadReckoned, dead_reckon
from gtsam_nav.ekf.distortion import Distortion, distortions
from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.mission import Mission, Rejection, Sensor
from gtsam_nav.preprocess.alignment import Alignment, align
from gtsam_nav.preprocess.compass_turns import disturbance_walk_rad2_s
from gtsam_nav.registration.settings import PicSettings
from gtsam_nav.sensors.noise import SonarNoise
from gtsam_nav.sensors.orientation import headings_true
from gtsam_nav.series import IntArray
from gtsam_nav.sonar.motion import PlanarMotion
from gtsam_nav.sonar.preparation import (
    SonarData,
    deskewed,
    leave_out_defective_sonar,
    sonar_turns,
)
from gtsam_nav.sonar.scans import planar_rotations

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
    span_s : float
        Usual time between the first and the last beam of a scan.
    displacement_cov : ndarray, shape (r, 3, 3)
        Of north, east and yaw at each record since the scan before it; before the first, of the
        pose itself. What a compass measures anew at each time counts in full.
    first_cov : ndarray, shape (3, 3)
        Of the pose of the first scan, whose heading is as wrong as the compass over all its beams.
    drift : CompassDrift or None
        None without a compass.
    frame_yaw_variance : float
        How far the heading at a scan's reference time may be off that of its beams on the whole,
        which is the scan's own: the compass drifts, and its white noise cancels out; rad^2.
    frame_cov : ndarray, shape (n, 2, 2)
        And how far the position (north, east) may be off that of its beams, in the same way, m^2.
    distortions : list of Distortion
        What errors of the motion within each scan do to it.
    match_scale_sigma : float
        Spread of the share by which all ways between matched scans are wrong.
    pic : PicSettings
        With the floors that the sonar's card states.
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
    span_s: float
    displacement_cov: Array
    first_cov: Array
    drift: CompassDrift | None
    frame_yaw_variance: float
    frame_cov: Array
    distortions: list[Distortion]
    match_scale_sigma: float
    pic: PicSettings
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

    def _cov_since_last(self, k: int) -> Array:
        """Covariance of the displacement from the scan before scan k, shape (3, 3)."""
        cov = self.displacement_cov[self.record[k]].copy()
        cov[:2, :2] += self._frames_cov(k)
        return np.asarray(cov)

    def _frames_cov(self, k: int) -> Array:
        """Of north and east between the positions of scan k and the one before, (2, 2)."""
        return np.asarray(self.frame_cov[k - 1 : k + 1].sum(axis=0))

    def predict(self, k: int, last: Array) -> tuple[Array, Array, Array]:
        """Pose of scan k by dead reckoning from the pose of the scan before.

        With a compass the displacement is aligned with north, but for what is left of the error
        that it had at the last scan: by that much a scan's pose differs from what it said. Without
        one the displacement turns with the pose that it starts from.

        Returns
        -------
        pose : ndarray, shape (3,)
        J_last : ndarray, shape (3, 3)
            Its Jacobian in the last pose.
        cov_added : ndarray, shape (3, 3)
        """
        before, here = self.pose(k - 1), self.pose(k)
        if self.drift is None:
            q, _, J_here = tail_to_tail(before, here)
            pose, J_last, J_q = compound(last, q)
            J = J_q @ J_here
            return pose, J_last, J @ self._cov_since_last(k) @ J.T
        elapsed_s = self.t[k] - self.t[k - 1]
        kept = self.drift.kept(elapsed_s)
        on_the_way, here_off = kept * wrap_angle(last[2] - before[2])
        way = planar_rotations(on_the_way) @ (here[:2] - before[:2])
        pose = np.append(last[:2] + way, wrap_angle(here[2] + here_off))
        turning = _turning(way)
        J_last = np.diag([1.0, 1.0, 0.0])
        J_last[:, 2] += turning @ kept
        cov = turning @ self.drift.gained(elapsed_s) @ turning.T
        cov[:2, :2] += self.filtered.P[self.record[k], :2, :2] + self._frames_cov(k)
        return pose, J_last, cov

    def displacement(self, k: int) -> tuple[Array, Array]:
        """Dead-reckoned pose of scan k in the scan before (3,), and its covariance (3, 3)."""
        q, J_before, J_here = tail_to_tail(self.pose(k - 1), self.pose(k))
        cov = J_here @ self._cov_since_last(k) @ J_here.T
        if self.drift is not None:
            white = self.filtered.P[self.record[k - 1], YAW, YAW]
            cov += white * np.outer(J_before[:, 2], J_before[:, 2])
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
        raise _no_scans(mission, warnings)
    drift = CompassDrift.of(mission)
    restarted = (0, 1) if drift is not None else (0, 1, YAW)
    reckoned = dead_reckon(mission, start, config, turns.t_ref, restarted)
    record = np.searchsorted(reckoned.filtered.t, turns.t_ref)
    motion = _planar_motion(reckoned.filtered, record, drift is not None)
    sonar = deskewed(echoes, turns, motion)
    noise = SonarNoise.model_validate(_sonar_of(mission).noise)
    pic = _with_floors(config.pic, noise)
    yaw_growth = motion.yaw_variance_rad2_s if drift is None else disturbance_walk_rad2_s(mission)
    way_variance = _way_variance(reckoned.filtered, record)
    distorted = distortions(sonar, motion, way_variance, yaw_growth, pic)
    beam_s = _sonar_of(mission).series.t
    span_s = float(np.median(beam_s[turns.last - 1] - beam_s[turns.first]))
    displacement_cov = _displacement_cov(reckoned.filtered, record, drift)
    first_s = beam_s[turns.first[0] : turns.last[0]]
    white = _mean_white_variance(mission, reckoned.filtered.P[record[0]], first_s)
    return ScanTrack(
        mission=mission,
        start=start,
        reckoned=reckoned,
        sonar=sonar,
        record=record,
        complete_s=beam_s[turns.last - 1],
        span_s=span_s,
        displacement_cov=displacement_cov,
        first_cov=_first_cov(displacement_cov[record[0]], drift, span_s, white),
        drift=drift,
        frame_yaw_variance=_frame_yaw_variance(reckoned.filtered, record, drift, span_s),
        distortions=distorted,
        frame_cov=_frame_cov(distorted, reckoned.filtered, record),
        match_scale_sigma=noise.scale_sigma,
        pic=pic,
        min_points=config.sonar.scans.min_points,
        rejections=(*mission.rejections, *left_out, *reckoned.rejections),
        warnings=(*mission.warnings, *warnings),
    )


def _no_scans(mission: Mission, warnings: tuple[str, ...]) -> DataError:
    why = "".join(f"; {warning}" for warning in warnings)
    return DataError(
        f"mission '{mission.name}': scan matching needs a turn of a scanning sonar (beams)"
        f" or scans; the mission has: {', '.join(sorted(mission.sensors))}{why}"
    )


def _sonar_of(mission: Mission) -> Sensor:
    sonar = mission.first("beams") or mission.first("scans")
    assert sonar is not None
    return sonar


def _with_floors(settings: PicSettings, noise: SonarNoise) -> PicSettings:
    """Settings with the floors of a sonar's card, where it states them."""
    stated = {"floor_xy_m": noise.match_floor_m, "floor_yaw_deg": noise.match_floor_deg}
    return settings.model_copy(update={k: v for k, v in stated.items() if v is not None})


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


def _frame_yaw_variance(
    filtered: Filtered, record: IntArray, drift: CompassDrift | None, span_s: float
) -> float:
    if drift is None:
        return 0.0
    return drift.middle_variance(span_s) + float(np.median(filtered.P[record, YAW, YAW]))


def _way_variance(filtered: Filtered, record: IntArray) -> Array:
    """Of the way up to each record, along each axis, but for the compass's drift, shape (r,)."""
    level = 0.5 * (filtered.P[:, 0, 0] + filtered.P[:, 1, 1])
    before = np.append(0.0, np.cumsum(level[record]))
    return np.asarray(before[np.searchsorted(record, np.arange(len(level)))] + level)


def _frame_cov(distorted: list[Distortion], filtered: Filtered, record: IntArray) -> Array:
    to_n = planar_rotations(filtered.x[record, YAW])
    cov = np.array([d.whole[:2] @ d.whole[:2].T for d in distorted])
    return np.asarray(to_n @ cov @ np.swapaxes(to_n, 1, 2))


def _displacement_cov(filtered: Filtered, record: IntArray, drift: CompassDrift | None) -> Array:
    """North, east and yaw since the last scan; a compass's drift turns the displacement with it."""
    cov = filtered.P[:, PLANAR[:, None], PLANAR]
    if drift is None:
        return cov
    since = np.searchsorted(record, np.arange(len(cov)))
    origin = np.append(0, record)[since]
    turning = _turning(filtered.x[:, :2] - filtered.x[origin, :2])
    elapsed_s = filtered.t - filtered.t[origin]
    drifted = drift.change(elapsed_s)
    first = since == 0
    drifted[first] = drift.whole(elapsed_s[first])
    return np.asarray(cov + turning @ drifted @ np.swapaxes(turning, 1, 2))


def _first_cov(
    at_reference: Array, drift: CompassDrift | None, span_s: float, white_variance: float
) -> Array:
    if drift is None:
        return at_reference
    lessened = np.sqrt((drift.mean_variance(span_s) + white_variance) / at_reference[2, 2])
    return at_reference * np.outer([1.0, 1.0, lessened], [1.0, 1.0, lessened])


def _mean_white_variance(mission: Mission, P: Array, beam_s: Array) -> float:
    """Variance of the mean of a compass's white noise over the beams of a scan, rad^2.

    At the most what the filter's covariance P at the scan's reference time says of one instant.
    """
    headings = headings_true(mission)
    if headings is None:
        return 0.0
    inside = headings.sigma[(headings.t >= beam_s[0]) & (headings.t <= beam_s[-1])]
    at_reference = float(P[YAW, YAW])
    if len(inside) < 2:
        return at_reference
    return min(at_reference, float(np.mean(inside**2)) / len(inside))


def _turning(way: Array) -> Array:
    """How north, east and yaw change, on ways (..., 2), with a compass's mean and last error.

    Shape (..., 3, 2).
    """
    J = np.zeros((*way.shape[:-1], 3, 2))
    J[..., 0, 0], J[..., 1, 0], J[..., 2, 1] = -way[..., 1], way[..., 0], 1.0
    return J
