"""Scans on a dead-reckoned track: what scan matching and pose SLAM start from.

The dead-reckoning filter gives the motion while a scan is gathered and from one scan to the next;
the covariance of its displacement starts from zero at each scan: Mallios et al. 2014, section 3.2.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gtsam_nav.config import Config
from gtsam_nav.ekf.compass_drift import CompassDrift, mean_white_variance
from gtsam_nav.ekf.compounding import compound, tail_to_tail
from gtsam_nav.ekf.considered import ConsideredErrors
from gtsam_nav.ekf.constant_velocity import YAW, Filtered
from gtsam_nav.ekf.dead_reckoning import DeadReckoned, dead_reckon, filtered_trajectory
from gtsam_nav.ekf.distortion import Distortion, distortions, walking
from gtsam_nav.ekf.scan_walk import between_scans_variance, planar_motion, way_variance
from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.mission import Mission, Rejection, Sensor
from gtsam_nav.preprocess.alignment import Alignment, align
from gtsam_nav.registration.settings import PicSettings
from gtsam_nav.sensors.noise import SonarNoise
from gtsam_nav.series import IntArray
from gtsam_nav.sonar.motion import lies_inverted
from gtsam_nav.sonar.preparation import (
    SonarData,
    deskewed,
    leave_out_defective_sonar,
    sonar_turns,
)
from gtsam_nav.sonar.scans import planar_rotations

PLANAR = np.array([0, 1, YAW])
"""North, east and yaw in the state of the dead-reckoning filter."""
MISALIGNMENT, COMPASS, WITHIN, POSE = 0, 1, slice(2, -3), slice(-3, None)
"""Entries of the errors of the motion, also within a scan, and of the pose of that, which the next
is predicted from."""
NORTH_EAST = slice(-3, -1)
"""Of the pose."""


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
    beams_s : ndarray, shape (n, 2)
        When the first and the last beam of each scan came in.
    drift : CompassDrift or None
        None without a compass. The heading of a scan is wrong by the mean error over its beams.
    white_yaw : ndarray, shape (n,)
        What the compass's white noise adds to the variance of that mean, rad^2.
    frame_cov : ndarray, shape (n, 2, 2)
        How far the position (north, east) at a scan's reference time may be off that of its beams
        on the whole, which is the scan's own, m^2.
    distortions : list of Distortion
        What errors of the motion within each scan do to it.
    between : ndarray, shape (n,)
        Variance of the walk from the last echo of the scan before to the first of each, m^2.
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
    beams_s: Array
    drift: CompassDrift | None
    white_yaw: Array
    frame_cov: Array
    distortions: list[Distortion]
    between: Array
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

    @cached_property
    def walked(self) -> Array:
        """Covariance of north, east and yaw at each record by what adds up since the scan before.

        Shape (r, 3, 3). The error of a compass does not, and is no part of it.
        """
        cov = self.filtered.P[:, PLANAR[:, None], PLANAR]
        if self.drift is not None:
            cov[:, 2, :] = cov[:, :, 2] = 0.0
        return cov

    def pose(self, k: int) -> Array:
        """Dead-reckoned north, east and yaw of scan k, shape (3,)."""
        return np.asarray(self.filtered.x[self.record[k], PLANAR])

    @property
    def first(self) -> Array:
        """Errors of the motion, of which nothing is known, and pose of the first scan, (m + 5,)."""
        return np.append(np.zeros(2 + self.distortions[0].whole.shape[1]), self.pose(0))

    @property
    def first_cov(self) -> Array:
        """Covariance of `first`, shape (m + 5, m + 5)."""
        turned = self._turning(self.pose(0)[:2] - self.filtered.x[0, :2])[:, 0]
        turned[MISALIGNMENT] = 1.0
        variance = ConsideredErrors.of(self.mission).misalignment ** 2
        return self.first_cov_aligned + variance * np.outer(turned, turned)

    @property
    def first_cov_aligned(self) -> Array:
        """The same of a velocity that is not misaligned."""
        first, cov = int(self.record[0]), np.eye(len(self.first))
        cov[COMPASS, COMPASS] = cov[MISALIGNMENT, MISALIGNMENT] = 0.0
        cov[POSE, POSE] = self.walked[first]
        if self.drift is None:
            return cov
        # the walk leads to the scan on the whole, not to its reference time
        reached = self._strayed(0)[1]
        within = 0.5 * float(np.sum(self.distortions[0].ends[0] ** 2))
        cov[NORTH_EAST, NORTH_EAST] += reached @ reached.T - within * np.eye(2)
        cov[NORTH_EAST, WITHIN], cov[WITHIN, NORTH_EAST] = reached, reached.T
        t, ne = self.filtered.t, self.filtered.x[:, :2]
        beams_s = self.beams_s[0]
        spans_s = np.stack([t[[0, first]], beams_s, beams_s[[1, 1]]])
        errors = self.drift.covariance(spans_s) + np.diag([0.0, self.white_yaw[0], 0.0])
        J = self._turning(ne[first] - ne[0])
        return np.asarray(cov + J @ errors @ J.T)

    def _strayed(self, k: int) -> tuple[Array, Array]:
        """How north and east (2, m) are put right by the errors within scan k: onward from the scan
        on the whole to its last echo, and from its first echo to the scan on the whole."""
        onward, reached = -planar_rotations(self.pose(k)[2]) @ self.distortions[k].strayed
        return onward, reached

    def _turning(self, way: Array) -> Array:
        """How errors and pose of a scan change with a compass's errors on a way (2,), over the scan
        at its end and at the end of that, shape (m + 5, 3)."""
        J = np.zeros((len(self.first), 3))
        J[COMPASS, 2] = 1.0
        J[POSE] = [[-way[1], 0.0, 0.0], [way[0], 0.0, 0.0], [0.0, 1.0, 0.0]]
        return J

    def _walked_from_last(self, k: int) -> Array:
        """Of the displacement from the scan before scan k but for a compass's error, (3, 3)."""
        cov = self.walked[self.record[k]].copy()
        cov[:2, :2] += self.frame_cov[k - 1] + self.frame_cov[k]
        return np.asarray(cov)

    @cached_property
    def _compass_errors(self) -> Array:
        """Covariance (n - 1, 5, 5) of a compass's error over five spans of time, from scan to scan.

        Of the beams of a scan, of its last, of the way to the next, of the beams of that, and of
        its last.
        """
        assert self.drift is not None
        before, here = self.beams_s[:-1], self.beams_s[1:]
        way_s = np.stack([self.t[:-1], self.t[1:]], axis=1)
        spans_s = np.stack([before, before[:, [1, 1]], way_s, here, here[:, [1, 1]]], axis=1)
        cov = self.drift.covariance(spans_s)
        cov[:, 0, 0] += self.white_yaw[:-1]
        cov[:, 3, 3] += self.white_yaw[1:]
        return cov

    def predict(self, k: int, last: Array) -> tuple[Array, Array, Array]:
        """Pose of scan k by dead reckoning from the scan before, and the errors of the motion.

        These are the angles by which all ways must be turned, and the compass at the end of the
        scan, and m errors within the scan. With a compass the displacement is aligned with north,
        but for what is left of the error that it had over the last scan, by which that one's pose
        differs from what it said, and at its end; and it starts from where the errors within that
        scan have led by its end. Without one it turns with the pose that it starts from.

        Parameters
        ----------
        k : int
        last : ndarray, shape (m + 5,)
            Errors and pose of the scan before.

        Returns
        -------
        new : ndarray, shape (m + 5,)
        J : ndarray, shape (m + 5, m + 5)
            Its Jacobian in the last.
        cov_added : ndarray, shape (m + 5, m + 5)
        """
        before, here = self.pose(k - 1), self.pose(k)
        new, J, cov = np.zeros_like(last), np.zeros((len(last), len(last))), np.eye(len(last))
        cov[MISALIGNMENT, MISALIGNMENT] = cov[COMPASS, COMPASS] = 0.0
        turned, pose = last[MISALIGNMENT], last[POSE]
        new[MISALIGNMENT], J[MISALIGNMENT, MISALIGNMENT] = turned, 1.0
        if self.drift is None:
            q, _, J_here = tail_to_tail(before, here)
            q[:2] = planar_rotations(turned) @ q[:2]
            new[POSE], J[POSE, POSE], J_q = compound(pose, q)
            J[:, MISALIGNMENT] += self._turning(new[POSE][:2] - pose[:2])[:, 0]
            to_last = J_q @ J_here
            cov[POSE, POSE] = to_last @ self._walked_from_last(k) @ to_last.T
            return new, J, cov
        errors = self._compass_errors[k - 1]
        kept = errors[2:, :2] @ np.linalg.pinv(errors[:2, :2], hermitian=True)
        known = [wrap_angle(pose[2] - before[2]), last[COMPASS]]
        on_the_way, here_off, new[COMPASS] = kept @ known
        way = planar_rotations(on_the_way + turned) @ (here[:2] - before[:2])
        onward, reached = self._strayed(k - 1)[0], self._strayed(k)[1]
        start = pose[:2] + onward @ last[WITHIN]
        new[POSE] = np.append(start + way, wrap_angle(here[2] + here_off))
        turning = self._turning(way)
        J[NORTH_EAST, NORTH_EAST], J[NORTH_EAST, WITHIN] = np.eye(2), onward
        J[:, MISALIGNMENT] += turning[:, 0]
        J[:, [-1, COMPASS]] += turning @ kept
        cov[POSE, POSE] = 0.0
        cov[NORTH_EAST, NORTH_EAST] = reached @ reached.T + self.between[k] * np.eye(2)
        cov[NORTH_EAST, WITHIN], cov[WITHIN, NORTH_EAST] = reached, reached.T
        cov += turning @ (errors[2:, 2:] - kept @ errors[:2, 2:]) @ turning.T
        return new, J, cov

    def displacement(self, k: int) -> tuple[Array, Array]:
        """Dead-reckoned pose of scan k in the scan before (3,), and its covariance (3, 3)."""
        before, here = self.pose(k - 1), self.pose(k)
        q, _, J_here = tail_to_tail(before, here)
        cov = self._walked_from_last(k)
        if self.drift is not None:
            onward, reached = self._strayed(k - 1)[0], self._strayed(k)[1]
            cov[:2, :2] = onward @ onward.T + self.between[k] * np.eye(2) + reached @ reached.T
            # the way lies, and the scan is turned, as seen from the scan before
            relative = np.array([[-1.0, 0.0, 1.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 1.0, 0.0]])
            turning = self._turning(here[:2] - before[:2])[POSE, :2] @ relative
            cov += turning @ self._compass_errors[k - 1] @ turning.T
        constant = ConsideredErrors.of(self.mission)
        along, aside = constant.scale * q[:2], constant.misalignment * q[1::-1] * [-1.0, 1.0]
        cov = J_here @ cov @ J_here.T
        cov[:2, :2] += np.outer(along, along) + np.outer(aside, aside)
        return q, cov

    def shared_with_match(self, k: int, by_before: Array, by_here: Array) -> Array:
        """Covariance (3, 3) of what `displacement` lacks with a match that answers so, (3, m) both,
        to the errors within the scan before and within scan k."""
        shared = np.zeros((3, 3))
        if self.drift is not None:
            from_n = planar_rotations(self.pose(k - 1)[2]).T
            onward, reached = self._strayed(k - 1)[0], self._strayed(k)[1]
            shared[:2] = from_n @ (onward @ by_before.T + reached @ by_here.T)
        return shared


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
    motion = planar_motion(reckoned.filtered, record, drift is not None)
    inverted = lies_inverted(filtered_trajectory(reckoned.filtered, mission), echoes.t)
    sonar = deskewed(echoes.mirrored(inverted), turns, motion)
    noise = SonarNoise.model_validate(_sonar_of(mission).noise)
    pic = with_floors(config.pic, noise)
    yaw_changes = walking(motion.yaw_variance_rad2_s) if drift is None else drift.changes
    way_variance_m2 = way_variance(reckoned.filtered, record)
    distorted = distortions(sonar, motion, way_variance_m2, yaw_changes, pic)
    beam_s = _sonar_of(mission).series.t
    beams_s = np.stack([beam_s[turns.first], beam_s[turns.last - 1]], axis=1)
    return ScanTrack(
        mission=mission,
        start=start,
        reckoned=reckoned,
        sonar=sonar,
        record=record,
        beams_s=beams_s,
        drift=drift,
        white_yaw=mean_white_variance(mission, reckoned.filtered.P[record, YAW, YAW], beams_s),
        distortions=distorted,
        frame_cov=_frame_cov(distorted, reckoned.filtered, record),
        between=between_scans_variance(distorted, reckoned.filtered, record),
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


def with_floors(settings: PicSettings, noise: SonarNoise) -> PicSettings:
    """Settings with the floors of a sonar's card, where it states them."""
    stated = {"floor_xy_m": noise.match_floor_m, "floor_yaw_deg": noise.match_floor_deg}
    return settings.model_copy(update={k: v for k, v in stated.items() if v is not None})


def _frame_cov(distorted: list[Distortion], filtered: Filtered, record: IntArray) -> Array:
    to_n = planar_rotations(filtered.x[record, YAW])
    cov = np.array([d.whole[:2] @ d.whole[:2].T for d in distorted])
    return np.asarray(to_n @ cov @ np.swapaxes(to_n, 1, 2))
