"""Dead reckoning: the constant-velocity EKF on velocity, heading and depth of a mission."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gtsam_nav.config import Config
from gtsam_nav.ekf.considered import ConsideredErrors, with_considered
from gtsam_nav.ekf.constant_velocity import (
    DEPTH,
    VELOCITY,
    YAW,
    Filtered,
    Measurements,
    Restarts,
    Start,
    run,
)
from gtsam_nav.ekf.direct_measurements import collect_measurements
from gtsam_nav.ekf.late_fix import through_late_fix
from gtsam_nav.ekf.water_lock import with_water_motion
from gtsam_nav.errors import EstimationError
from gtsam_nav.frames import Array, quaternion_from_rpy, sag_m
from gtsam_nav.mission import Mission, Rejection
from gtsam_nav.preprocess.alignment import Alignment, align
from gtsam_nav.preprocess.settings import MotionSettings
from gtsam_nav.sensors.noise import HeadingNoise
from gtsam_nav.sensors.orientation import tilt_at
from gtsam_nav.sensors.prediction import chi2_limit
from gtsam_nav.sensors.silences import said_of_silences
from gtsam_nav.solution import Innovations, Progress, Solution, StageClock
from gtsam_nav.trajectory import SAME_TIME_S, Trajectory, record_times

START_SIGMA = (10.0, 10.0, 5.0, 1.0)
"""Of u, v, w (m/s) and r (rad/s) before the first measurement; their mean is zero. Wide, since a
vehicle that is already under way would otherwise be gated out for ever."""

VELOCITY_SIZES = slice(2, 4)
"""Places in the gate of measurements of three and four entries: velocities, with a turn rate."""


@dataclass(frozen=True)
class DeadReckoned:
    """What the filter made of a mission.

    Attributes
    ----------
    measurements : Measurements
    filtered : Filtered
        At the trajectory's rate, and at the restarts.
    rejections : tuple of Rejection
        The samples that were left out or gated.
    """

    measurements: Measurements
    filtered: Filtered
    rejections: tuple[Rejection, ...]

    @property
    def innovations(self) -> dict[str, Innovations]:
        """Of what was used, by sensor."""
        z, filtered = self.measurements, self.filtered
        used = {k: np.flatnonzero(filtered.used & (z.sensor == k)) for k in range(len(z.names))}
        found = {}
        for k, own in used.items():
            if len(own):
                size = int(z.size[own[0]])
                whitened = filtered.whitened[own, :size]
                found[z.names[k]] = Innovations(z.t[own], filtered.nis[own], size, whitened)
        return found


def estimate(mission: Mission, config: Config, progress: Progress) -> Solution:
    """Dead-reckon a mission.

    Parameters
    ----------
    mission : Mission
        With a DVL or odometry; heading and depth are used where present.
    config : Config
    progress : Progress

    Raises
    ------
    DataError
        Where the mission has neither a DVL with valid samples nor odometry.
    EstimationError
        Where the filter diverges to values that are not finite.
    """
    clock = StageClock()
    with clock.stage("filter"):
        start = align(mission)
        reckoned = dead_reckon(mission, start, config)
    progress("dead reckoning", 1.0)
    track = with_considered(
        filtered_trajectory(reckoned.filtered, mission), ConsideredErrors.of(mission)
    )
    return Solution(
        method="dr",
        trajectory=through_late_fix(track, mission, start),
        mission=mission,
        georeferenced=start.georeferenced and start.heading_known,
        rejections=(*mission.rejections, *reckoned.rejections),
        warnings=(*mission.warnings, *_said_of_compass(mission)),
        innovations=reckoned.innovations,
        gnss_used=fixes_used(mission, start),
        stage_s=clock.seconds,
    )


def _said_of_compass(mission: Mission) -> Iterator[str]:
    """What stands in for it; of silences that nothing bridges every method is told."""
    compass = mission.first("heading")
    if compass is not None and mission.first("odometry") is not None:
        yield from said_of_silences(compass, mission, "the odometry tells the turns")


def fixes_used(mission: Mission, start: Alignment) -> int:
    """How many fixes a method used that takes its start from GNSS, and nothing else."""
    return 1 if start.georeferenced and mission.initial.p_n is None else 0


def dead_reckon(
    mission: Mission,
    start: Alignment,
    config: Config,
    restarts_s: Array | None = None,
    restarted: tuple[int, ...] = (),
) -> DeadReckoned:
    """Run the filter over a mission.

    Parameters
    ----------
    mission : Mission
    start : Alignment
    config : Config
    restarts_s : ndarray, shape (m,), optional
        Times inside the mission at which the covariance of some entries starts from zero.
    restarted : tuple of int
        Those entries.

    Raises
    ------
    DataError
        Where nothing measures the velocity.
    EstimationError
        Where the filter diverges to values that are not finite.
    """
    measurements, left_out = collect_measurements(mission, config.motion)
    gate = np.array([chi2_limit(config.dr.gate_probability, size) for size in range(1, 5)])
    if not mission.of_type("dvl"):
        # wheels have no echoes to mistake: a sudden change is the vehicle's
        gate[VELOCITY_SIZES] = np.inf
    t = record_times(start.t, mission.span_s[1], config.motion.rate_hz)
    restarts = None
    if restarts_s is not None:
        t = _with_times(t, restarts_s)
        restarts = Restarts(np.isin(t, restarts_s), np.array(restarted, dtype=np.int64))
    filtered = run(
        measurements,
        _start(mission, start),
        t,
        np.append(0.0, gate),
        _accel_variance(config.motion),
        restarts,
    )
    if not np.all(np.isfinite(filtered.x)):
        raise EstimationError("dead reckoning diverged: the state is not finite")
    filtered = with_water_motion(
        filtered, _since(t, restarts), mission, config.motion.water_lock_after_s
    )
    rejections = (*left_out, *_gated(measurements, filtered))
    return DeadReckoned(measurements, filtered, rejections)


def _since(t: Array, restarts: Restarts | None) -> Array:
    """When the covariance of each record last started from zero, or the filter itself."""
    if restarts is None:
        return np.full(len(t), t[0])
    begins = t[restarts.after]
    return np.append(t[0], begins)[np.searchsorted(begins, t)]


def _start(mission: Mission, start: Alignment) -> Start:
    """The alignment; the compass that the filter will follow may differ from it by its bias."""
    x = np.array([*start.p_n, start.rpy[2], 0.0, 0.0, 0.0, 0.0])
    x[DEPTH] -= sag_m(start.p_n, mission.origin)
    compass = mission.first("heading")
    sigma_yaw = start.sigma_rpy[2]
    if compass is not None:
        noise = HeadingNoise.model_validate(compass.noise)
        bias = np.radians([noise.bias_sigma_deg, noise.disturbance_sigma_deg])
        sigma_yaw = float(np.linalg.norm([sigma_yaw, *bias]))
    return Start(start.t, x, np.diag([*start.sigma_p, sigma_yaw, *START_SIGMA]) ** 2)


def _accel_variance(settings: MotionSettings) -> Array:
    level, vertical = settings.sigma_accel_m_s2, settings.sigma_vertical_accel_m_s2
    return np.array([level, level, vertical, settings.sigma_yaw_accel_rad_s2]) ** 2


def _with_times(grid: Array, t: Array) -> Array:
    """Grid and further times in order; the grid gives way to what is all but the same time."""
    nearest = np.searchsorted(t, grid)
    after = t[np.minimum(nearest, len(t) - 1)]
    before = t[np.maximum(nearest - 1, 0)]
    apart = np.minimum(np.abs(after - grid), np.abs(grid - before)) > SAME_TIME_S
    return np.sort(np.concatenate([grid[apart], t]))


def _gated(z: Measurements, filtered: Filtered) -> Iterator[Rejection]:
    for k in np.flatnonzero(~filtered.used).tolist():
        yield Rejection(
            t=float(z.t[k]),
            sensor=z.names[z.sensor[k]],
            index=int(z.row[k]),
            reason="innovation gate",
            normalised_residual=float(np.sqrt(filtered.nis[k])),
        )


def filtered_trajectory(filtered: Filtered, mission: Mission) -> Trajectory:
    """The filtered states with the tilt that the mission measured.

    They went along the level surface, which falls away from the plane of the mission's NED.
    """
    t, x, P = filtered.t, filtered.x, filtered.P
    p_n = x[:, :3] + sag_m(x[:, :3], mission.origin)[:, None] * [0.0, 0.0, 1.0]
    tilt, sigma_tilt = tilt_at(mission, t)
    cov = np.zeros((len(t), 6, 6))
    planar = np.array([0, 1, 2, 5])
    cov[:, planar[:, None], planar] = P[:, :4, :4]
    cov[:, 3, 3] = cov[:, 4, 4] = sigma_tilt**2
    c, s, o = np.cos(x[:, YAW]), np.sin(x[:, YAW]), np.zeros(len(t))
    R_level = np.stack(
        [np.stack([c, -s, o], -1), np.stack([s, c, o], -1), np.stack([o, o, o + 1], -1)], 1
    )
    cov_v = R_level @ P[:, VELOCITY, VELOCITY] @ np.swapaxes(R_level, 1, 2)
    return Trajectory(
        t=t,
        p_n=p_n,
        q_nb_wxyz=quaternion_from_rpy(np.column_stack([tilt, x[:, YAW]])),
        v_n=np.einsum("nij,nj->ni", R_level, x[:, VELOCITY]),
        cov_pose_n=cov,
        sigma_v_n=np.sqrt(np.diagonal(cov_v, axis1=1, axis2=2)),
    )
