"""Errors that a filter takes for zero, in its covariance all the same.

The dead-reckoning filter knows white noise alone: its heading follows the compass, its velocity the
Doppler log. What a card states of the constant and slowly varying errors of both stays out of the
estimate, which is then the published one, and enters its covariance: the considered parameters of
Schmidt, *Application of state-space methods to navigation problems* (1966).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import accumulate

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission
from gtsam_nav.sensors.noise import HeadingNoise
from gtsam_nav.sensors.odometry import curvature_sigma, velocity_calibration_sigma
from gtsam_nav.sensors.silences import is_heard, since_heard
from gtsam_nav.series import BoolArray
from gtsam_nav.trajectory import Trajectory


@dataclass(frozen=True)
class ConsideredErrors:
    """Spreads of what a dead-reckoned track does not estimate.

    Attributes
    ----------
    heading, disturbance, misalignment : float
        Constant error of the heading, Gauss-Markov error of the heading, and constant error of the
        velocity's direction in the body, rad.
    disturbance_time_s : float
    scale : float
        Constant error of the speed, as a share of it.
    curvature : float
        Constant turn that odometry does not notice where it tells the turns, rad a metre.
    headings_s : ndarray, shape (k,)
        Stamps of the compass, which tells them instead unless it is silent.
    """

    heading: float
    disturbance: float
    disturbance_time_s: float
    misalignment: float
    scale: float
    curvature: float = 0.0
    headings_s: Array = field(default_factory=lambda: np.empty(0))

    @classmethod
    def of(cls, mission: Mission) -> ConsideredErrors:
        """As the cards of compass and velocity sensor state them."""
        scale, misalignment = velocity_calibration_sigma(mission).tolist()
        compass = mission.first("heading")
        if compass is None:
            return cls(0.0, 0.0, 1.0, misalignment, scale, curvature_sigma(mission))
        noise = HeadingNoise.model_validate(compass.noise)
        constant, disturbance = np.radians([noise.bias_sigma_deg, noise.disturbance_sigma_deg])
        return cls(
            float(constant),
            float(disturbance),
            noise.disturbance_time_s,
            misalignment,
            scale,
            curvature_sigma(mission),
            compass.series.t,
        )

    def hears_compass(self, t: Array) -> BoolArray:
        """Whether a compass tells the turns at times (n,)."""
        stamps = self.headings_s
        if not len(stamps):
            return np.zeros(len(t), dtype=bool)
        return is_heard(stamps, t)

    @property
    def constant(self) -> ConsideredErrors:
        """Those that scans do not show: the constant ones, but for a turn."""
        return replace(self, disturbance=0.0, curvature=0.0)


def with_considered(track: Trajectory, errors: ConsideredErrors) -> Trajectory:
    """A dead-reckoned track with the covariance that these errors add.

    A heading that is wrong turns the way since the start: a constant error all of it, the
    disturbance and an unnoticed turn each step by what they are at the time.
    """
    assert track.v_n is not None
    assert track.cov_pose_n is not None
    assert track.sigma_v_n is not None
    way = (track.p_n - track.p_n[0])[:, :2]
    aside = way[:, ::-1] * [-1.0, 1.0]
    wandered, with_disturbance = _turned_by_disturbance(track.t, aside, errors)
    turned2 = errors.heading**2 + errors.misalignment**2
    cov = track.cov_pose_n.copy()
    cov[:, :2, :2] += wandered + turned2 * aside[:, :, None] * aside[:, None]
    cov[:, :2, :2] += errors.scale**2 * way[:, :, None] * way[:, None]
    cov[:, 5, 5] += errors.heading**2 + errors.disturbance**2
    ahead_m, swept, lacking = _turned_by_curvature(track, way, errors)
    cov[:, :2, :2] += errors.curvature**2 * swept[:, :, None] * swept[:, None]
    cov[:, :2, :2] += lacking[:, :, None] * lacking[:, None]
    cov[:, 5, 5] += errors.curvature**2 * ahead_m**2
    together = with_disturbance + errors.heading**2 * aside
    together += errors.curvature**2 * ahead_m[:, None] * swept
    cov[:, :2, 5] += together
    cov[:, 5, :2] += together
    across = track.v_n[:, [1, 0]]
    variance_v = track.sigma_v_n**2
    turned2_now = turned2 + errors.disturbance**2 + errors.curvature**2 * ahead_m**2
    variance_v[:, :2] += turned2_now[:, None] * across**2
    variance_v += errors.scale**2 * track.v_n**2
    return replace(track, cov_pose_n=cov, sigma_v_n=np.sqrt(variance_v))


def _turned_by_curvature(
    track: Trajectory, way: Array, errors: ConsideredErrors
) -> tuple[Array, Array, Array]:
    """By what one radian a metre turns the course (n,) and moves the position aside (n, 2), and by
    what the way falls short (n, 2): of a course far off only the cosine lies along it."""
    steps = np.diff(way, axis=0)
    driven_m = np.append(0.0, np.cumsum(np.sum(track.R_nb[:-1, :2, 0] * steps, axis=1)))
    # a heading ends the turn, not what it has led to
    ahead_m = since_heard(driven_m, errors.hears_compass(track.t))
    middle = 0.5 * (ahead_m[1:] + ahead_m[:-1])
    turned2 = (errors.curvature * middle) ** 2
    # mean square of one less the cosine
    short2 = 1.5 - 2.0 * np.exp(-0.5 * turned2) + 0.5 * np.exp(-2.0 * turned2)
    aside = middle[:, None] * steps[:, ::-1] * [-1.0, 1.0]
    short = np.sqrt(np.maximum(short2, 0.0))[:, None] * steps
    swept, lacking = (np.cumsum(np.vstack([[0, 0], part]), axis=0) for part in (aside, short))
    return ahead_m, swept, lacking


def _turned_by_disturbance(t: Array, aside: Array, errors: ConsideredErrors) -> tuple[Array, Array]:
    """Covariance (n, 2, 2) of the position by the disturbance, and with it (n, 2)."""
    steps = np.diff(aside, axis=0)
    kept = np.exp(-np.diff(t) / errors.disturbance_time_s)
    # over a step the disturbance that moved the vehicle aside is about that of its middle
    gained = errors.disturbance**2 * np.sqrt(kept)[:, None] * steps
    rows = zip(kept.tolist(), gained, strict=True)
    shared = np.array(
        list(accumulate(rows, lambda y, row: row[0] * y + row[1], initial=np.zeros(2)))
    )
    # before the step it is what the past shares with its middle
    before = np.sqrt(kept)[:, None] * shared[:-1]
    added = steps[:, :, None] * before[:, None] + before[:, :, None] * steps[:, None]
    added += errors.disturbance**2 * steps[:, :, None] * steps[:, None]
    return np.concatenate([np.zeros((1, 2, 2)), np.cumsum(added, axis=0)]), shared
