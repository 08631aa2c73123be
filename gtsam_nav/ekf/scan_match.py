"""Scan matching alone (MSISpIC): consecutive scans registered and chained, no loops.

Mallios et al. 2014, section 4.2, and its baseline of that name. The chain knows no absolute
heading: the compass only deskews the scans and starts the registrations, so that a heading which
wanders within the scans adds up over the chain, where dead reckoning forgets it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtsam_nav.config import Config
from gtsam_nav.ekf.compounding import compound
from gtsam_nav.ekf.scan_registration import ScanMatch, register_scans
from gtsam_nav.ekf.scan_solution import PoseHistory, scan_solution
from gtsam_nav.ekf.scan_track import POSE, WITHIN, ScanTrack, follow_scans
from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.mission import Mission
from gtsam_nav.registration.result import PlanarMatch
from gtsam_nav.sensors.prediction import chi2_limit
from gtsam_nav.solution import Progress, Solution, StageClock


@dataclass(frozen=True)
class ChainEnd:
    """The newest scan of a chain.

    Attributes
    ----------
    pose : ndarray, shape (3,)
    cov : ndarray, shape (3, 3)
    bent : ndarray, shape (3, m)
        Covariance of the pose with the errors, of unit variance, of the motion within the scan,
        which the next match meets again.
    """

    pose: Array
    cov: Array
    bent: Array

    def followed_by(self, q: Array, cov: Array, by_last: Array, by_new: Array) -> ChainEnd:
        """The next scan by a displacement q (3,) with its covariance (3, 3), and how it answers to
        the errors within this scan and within the next, (3, m) both, which cov counts."""
        pose, J_last, J_q = compound(self.pose, q)
        shared = J_last @ self.bent @ (J_q @ by_last).T
        independent = J_last @ self.cov @ J_last.T + J_q @ cov @ J_q.T
        return ChainEnd(pose, independent + shared + shared.T, J_q @ by_new)


def estimate(mission: Mission, config: Config, progress: Progress) -> Solution:
    """Chain the registrations of consecutive scans.

    Where one fails, the dead-reckoned displacement takes its place.

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
    with clock.stage("matching"):
        cov = track.first_cov_aligned
        ends, matches = [ChainEnd(track.pose(0), cov[POSE, POSE], cov[POSE, WITHIN])], []
        for k in range(1, len(track)):
            found, (by_last, by_new) = match_consecutive(track, k, config)
            q, cov = track.displacement(k)
            told = np.zeros((3, 3))
            if found.accepted:
                q, cov, told = completed(found.match, q, cov)
            ends.append(ends[-1].followed_by(q, cov, told @ by_last, told @ by_new))
            matches.append(found)
            progress("scan matching", (k + 1) / len(track))
    history = PoseHistory(np.array([e.pose for e in ends]), np.array([e.cov for e in ends]))
    way = history.poses[:, :2] - history.poses[0, :2]
    history.covs[:, :2, :2] += track.match_scale_sigma**2 * way[:, :, None] * way[:, None]
    return scan_solution("scan-match", track, history, history, matches, (), clock)


def match_consecutive(
    track: ScanTrack, k: int, config: Config
) -> tuple[ScanMatch, tuple[Array, Array]]:
    """Register scan k to the one before, and test the result against the dead reckoning.

    How it answers to the errors of the motion within either is as from `register_scans`.
    """
    prior, cov_prior = track.displacement(k)
    match, bends = register_scans(track, k - 1, k, prior, cov_prior, track.pic)
    if not match.ok:
        return ScanMatch(k - 1, k, match, match.failure), bends
    difference = match.q - prior
    difference[2] = wrap_angle(difference[2])
    shared = track.shared_with_match(k, *bends)
    S = cov_prior + match.cov + shared + shared.T
    whitened: Array = np.linalg.solve(np.linalg.cholesky(S), difference)
    contradicts = whitened @ whitened > chi2_limit(config.pose_ekf.gate_probability, 3)
    return ScanMatch(k - 1, k, match, "innovation gate" if contradicts else "", whitened), bends


def completed(match: PlanarMatch, prior: Array, cov_prior: Array) -> tuple[Array, Array, Array]:
    """A match, and in directions that the scans do not tell what dead reckoning knows.

    Returns
    -------
    q : ndarray, shape (3,)
    cov : ndarray, shape (3, 3)
    told : ndarray, shape (3, 3)
        How q follows the match.
    """
    if not len(match.unobserved):
        return match.q, match.cov, np.eye(3)
    difference = match.q - prior
    difference[2] = wrap_angle(difference[2])
    gain = np.asarray(np.linalg.solve(cov_prior + match.cov, cov_prior).T)
    cov = cov_prior - gain @ cov_prior
    return prior + gain @ difference, 0.5 * (cov + cov.T), gain
