"""Pose-based SLAM with an augmented-state EKF on sonar scans.

Mallios et al., *Scan matching SLAM in underwater environments*, Autonomous Robots 36 (2014),
section 4.3: the state holds the pose of every scan; each new one is predicted by dead reckoning and
registered to the one before and to every earlier one nearby. As published, a compass's error is new
at each scan; here it is what the card says, and lasts: what matches show of it is carried on, and
the pose of a scan is that of all its beams, whose headings differ a little from that of its time.
"""

from __future__ import annotations

import numpy as np

from gtsam_nav.config import Config
from gtsam_nav.ekf.augmented_state import AugmentedState
from gtsam_nav.ekf.considered import ConsideredErrors
from gtsam_nav.ekf.scan_registration import ScanMatch, register_scans
from gtsam_nav.ekf.scan_solution import PoseHistory, scan_solution
from gtsam_nav.ekf.scan_track import ScanTrack, follow_scans
from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission
from gtsam_nav.sensors.prediction import chi2_limit
from gtsam_nav.solution import Progress, Solution, StageClock


def estimate(mission: Mission, config: Config, progress: Progress) -> Solution:
    """Estimate the poses of all scans.

    Parameters
    ----------
    mission : Mission
        With a scanning sonar or scans, and a DVL or odometry.
    config : Config
    progress : Progress

    Raises
    ------
    DataError
        Where the mission has no usable sonar, or nothing measures the velocity.
    EstimationError
        Where the dead reckoning diverges.
    """
    clock = StageClock()
    with clock.stage("scans"):
        track = follow_scans(mission, config)
    with clock.stage("filter"):
        pose_filter = PoseFilter(track, config)
        for k in range(1, len(track)):
            pose_filter.add_scan(k)
            progress("pose filter", (k + 1) / len(track))
    state, matches = pose_filter.state, pose_filter.matches
    final = PoseHistory(state.poses, state.marginals)
    online = PoseHistory(np.array(pose_filter.entered), np.array(pose_filter.entered_cov))
    loops = [found for found in matches if found.a != found.b - 1]
    return scan_solution(
        "pose-ekf", track, final, online, matches, loops, clock, knows_misalignment=True
    )


class PoseFilter:
    """The filter over the scans of a track, which must be added in order; the first is there.

    Attributes
    ----------
    state : AugmentedState
    matches : list of ScanMatch
        All that were tried.
    entered, entered_cov : list of ndarray
        Pose and covariance of each scan when it entered.
    """

    def __init__(self, track: ScanTrack, config: Config) -> None:
        self._track = track
        self._settings = config.pose_ekf
        self._pic = track.pic.model_copy(update={"association": config.pose_ekf.association})
        self.state = AugmentedState(
            len(track), track.first, track.first_cov, estimated_scale_sigma(track)
        )
        self.matches: list[ScanMatch] = []
        self.entered: list[Array] = [self.state.poses[-1]]
        self.entered_cov: list[Array] = [self.state.marginal(0)]

    def add_scan(self, k: int) -> None:
        """Predict scan k, and register it to the one before and to all that are near."""
        self.state.augment(*self._track.predict(k, self.state.newest))
        near = loop_candidates(self.state.poses, self._settings.loop_radius_m)
        self.matches += [self._match(earlier, k) for earlier in [k - 1, *near]]
        self.entered.append(self.state.poses[-1])
        self.entered_cov.append(self.state.marginal(k))

    def _match(self, a: int, b: int) -> ScanMatch:
        """Register scan b to scan a, and correct all poses by the result."""
        prior, cov_prior = self.state.displacement(a, b)
        match, (by_a, by_b) = register_scans(self._track, a, b, prior, cov_prior, self._pic)
        if not match.ok:
            return ScanMatch(a, b, match, match.failure)
        gate = chi2_limit(self._settings.gate_probability, 3)
        # errors within scans before the last are new to the state with each match
        bends = np.hstack([by_a if a == b - 1 else np.zeros_like(by_a), by_b])
        whitened = self.state.update(a, b, match.q, match.cov - bends @ bends.T, gate, bends)
        if whitened @ whitened <= gate:
            return ScanMatch(a, b, match, "", whitened)
        possible = np.all(np.isfinite(whitened))
        reason = "innovation gate" if possible else "singular innovation covariance"
        return ScanMatch(a, b, match, reason, whitened)


def estimated_scale_sigma(track: ScanTrack) -> float:
    """Spread of the scale of matched ways, against which the velocity can tell it; else zero.

    Where the velocity's own scale is known no better, it would be taken for that of the matches.
    """
    known = ConsideredErrors.of(track.mission).scale
    return track.match_scale_sigma if track.match_scale_sigma > known else 0.0


def loop_candidates(poses: Array, radius_m: float) -> list[int]:
    """Scans within a distance of the newest, nearest first; the one just before it is none.

    Parameters
    ----------
    poses : ndarray, shape (n, 3)
        North, east and yaw in the order of time.
    """
    distance = np.linalg.norm(poses[:-2, :2] - poses[-1, :2], axis=1)
    order = np.argsort(distance, kind="stable")
    return [int(k) for k in order if distance[k] <= radius_m]
