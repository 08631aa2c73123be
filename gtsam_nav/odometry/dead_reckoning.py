"""The method ``kiss``: cloud odometry alone, from the start that the other sensors tell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gtsam_nav.config import Config
from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array, quaternion_from_rotation
from gtsam_nav.mission import Mission
from gtsam_nav.odometry.cloud_map import map_or_reason
from gtsam_nav.odometry.cloud_track import CloudTrack, adjoint
from gtsam_nav.odometry.kiss import cloud_odometry
from gtsam_nav.preprocess.alignment import PUNCTUAL_S, UNKNOWN_SPEED_M_S, Alignment, align
from gtsam_nav.sensors.noise import HeadingNoise
from gtsam_nav.solution import Progress, Solution, StageClock
from gtsam_nav.trajectory import Trajectory, record_times

UNKNOWN_TURN_RAD_S = 0.1
"""How fast the vehicle may have turned before the first cloud."""


def estimate(mission: Mission, config: Config, progress: Progress) -> Solution:
    """Dead-reckon a mission by its 3-D clouds.

    Parameters
    ----------
    mission : Mission
        With clouds; the first pose comes from `align`, nothing corrects the later ones.
    config : Config
    progress : Progress

    Raises
    ------
    DataError
        Where the mission has no clouds.
    EstimationError
        Where hardly any cloud holds points.
    """
    clock = StageClock()
    settings = config.kiss.model_copy(update={"use": True})
    with clock.stage("cloud odometry"):
        track = cloud_odometry(mission, settings, progress)
    if track is None:
        raise DataError(f"mission '{mission.name}' has no 3-D clouds")
    start, start_warnings = start_at(mission, float(track.t[0]))
    trajectory = placed(track, start, config.motion.rate_hz)
    points, map_warnings = map_or_reason(track, trajectory, config.open3d.voxel_m)
    return Solution(
        method="kiss",
        trajectory=trajectory,
        mission=mission,
        georeferenced=start.georeferenced and start.heading_known,
        rejections=(*mission.rejections, *track.rejections),
        warnings=(*mission.warnings, *start_warnings, *track.warnings, *map_warnings),
        sonar_map=points,
        n_keyframes=len(track.key),
        stage_s=clock.seconds,
    )


def start_at(mission: Mission, t: float) -> tuple[Alignment, tuple[str, ...]]:
    """Alignment at the first cloud, and what is said of it: other sensors may have begun long ago.

    Position and heading are each what is measured from then on, or that of the mission's start,
    less certain by the time since: whichever is more certain.
    """
    start = with_compass_errors(align(mission), mission)
    if t - start.t <= PUNCTUAL_S:
        return start, ()
    later = mission.crop(t)
    there, old = with_compass_errors(align(later), later), _carried(start, t)
    taken = []
    if old.georeferenced and not (there.georeferenced and there.sigma_p[0] <= old.sigma_p[0]):
        of_start = [True, True, later.first("depth") is None]
        p_n = np.where(of_start, old.p_n, there.p_n)
        sigma_p = np.where(of_start, old.sigma_p, there.sigma_p)
        there = replace(there, p_n=p_n, sigma_p=sigma_p, georeferenced=True)
        taken.append("position")
    if old.heading_known and not (there.heading_known and there.sigma_rpy[2] <= old.sigma_rpy[2]):
        rpy = np.array([*there.rpy[:2], old.rpy[2]])
        sigma_rpy = np.array([*there.sigma_rpy[:2], old.sigma_rpy[2]])
        there = replace(there, rpy=rpy, sigma_rpy=sigma_rpy, heading_known=True)
        taken.append("heading")
    if not taken:
        return there, ()
    return there, (
        f"the clouds begin {t - start.t:.0f} s after the other sensors, and nothing measures the"
        f" {' and the '.join(taken)} so well there: taken from the start of the mission",
    )


def _carried(start: Alignment, t: float) -> Alignment:
    """An earlier start at a later time: who knows how far the vehicle moved and turned since."""
    since_s = max(t - start.t - PUNCTUAL_S, 0.0)  # none at first: a start a little later is no jump
    sigma_p = np.hypot(start.sigma_p, UNKNOWN_SPEED_M_S * since_s)
    sigma_yaw = min(np.hypot(start.sigma_rpy[2], UNKNOWN_TURN_RAD_S * since_s), np.pi)
    sigma_rpy = np.array([*start.sigma_rpy[:2], sigma_yaw])
    return replace(start, t=t, sigma_p=sigma_p, sigma_rpy=sigma_rpy)


def with_compass_errors(start: Alignment, mission: Mission) -> Alignment:
    """A start whose heading is as wrong as its compass: nothing later will tell."""
    compass = mission.first("heading")
    if compass is None or mission.initial.heading is not None:
        return start
    noise = HeadingNoise.model_validate(compass.noise)
    slow = np.radians([noise.bias_sigma_deg, noise.disturbance_sigma_deg])
    sigma_yaw = np.linalg.norm([start.sigma_rpy[2], *slow])
    return replace(start, sigma_rpy=np.array([*start.sigma_rpy[:2], sigma_yaw]))


def placed(track: CloudTrack, start: Alignment, rate_hz: float) -> Trajectory:
    """An odometry as a trajectory that begins in a given pose, at a rate.

    Its covariance is what the start and the increments between kept clouds add up to.
    """
    R_nb = start.R_nb @ track.R_ob[0].T @ track.R_ob
    p_n = start.p_n + (track.p_o - track.p_o[0]) @ (start.R_nb @ track.R_ob[0].T).T
    t_key, cov = _covariances(track, start)
    columns = [np.interp(track.t, t_key, column) for column in cov.reshape(len(t_key), 36).T]
    cov_b = np.stack(columns, axis=1).reshape(-1, 6, 6)
    # a trajectory has position first, both parts along n
    to_n = np.zeros((len(track.t), 6, 6))
    to_n[:, :3, 3:] = to_n[:, 3:, :3] = R_nb
    own = Trajectory(
        t=track.t,
        p_n=p_n,
        q_nb_wxyz=quaternion_from_rotation(R_nb),
        cov_pose_n=to_n @ cov_b @ np.swapaxes(to_n, 1, 2),
    )
    t = record_times(float(track.t[0]), float(track.t[-1]), rate_hz)
    return own.interpolate(t, max_gap_s=np.inf)


def _covariances(track: CloudTrack, start: Alignment) -> tuple[Array, Array]:
    """Times of the kept clouds and the covariances of turn and shift there, shape (k, 6, 6)."""
    cov = np.zeros((len(track.key), 6, 6))
    cov[0, :3, :3] = np.diag(start.sigma_rpy**2)
    cov[0, 3:, 3:] = start.R_nb.T @ np.diag(start.sigma_p**2) @ start.R_nb
    for j in range(1, len(track.key)):
        step = track.increment(j - 1, j)
        carried = adjoint(step.R_ab.T, -step.R_ab.T @ step.p_a)
        cov[j] = carried @ cov[j - 1] @ carried.T + step.cov
    return np.array([cloud.t for cloud in track.key]), cov
