"""KISS-ICP odometry: the motion between clouds, with a covariance, and the clouds deskewed.

Vizzo, Guadagnino, Mersch, Wiesmann, Behley and Stachniss, *KISS-ICP: in defense of point-to-point
ICP* (RA-L 2023): a sweep is deskewed at the velocity of the one before, to the time of its last
point, and registered to a local map. Two things are added. Between the rings of few beams
point-to-point pairs hold a pose back, so it is then moved onto the planes of that map
(`registration.surfaces`), which also tell how well it is known. And in waves the velocity of the
sweep before is the wrong one, so the sweep is deskewed once more with the motion just found.
The first sweep knows of no motion: it is registered with the second until their motion is known.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gtsam_nav.errors import EstimationError
from gtsam_nav.frames import Array, skew
from gtsam_nav.mission import Mission, Rejection, Sensor
from gtsam_nav.odometry.settings import KissSettings
from gtsam_nav.readers.clouds import load
from gtsam_nav.registration.open3d_icp import homogeneous
from gtsam_nav.registration.packages import kiss_icp
from gtsam_nav.registration.result import RelativePose
from gtsam_nav.registration.surfaces import Surfaces, match_covariance
from gtsam_nav.series import Cloud, CloudSeries
from gtsam_nav.solution import Progress

log = logging.getLogger(__name__)

MAX_ITERATIONS, CONVERGED = 20, 1e-3
"""Of the point-to-point registration, which need not settle; the latter in m and rad."""
LEAST_POINTS = 50
FIRST_ROUNDS = 3
"""Registrations of the first two clouds from which the odometry sets out."""
SUBMAP_REACH = 2
"""Kept clouds on either side of one that make a submap with it."""
UNKNOWN_SIGMA = np.array([0.1] * 3 + [1.0] * 3)
"""Of a pose whose points met no plane: rad and m."""


@dataclass(frozen=True)
class KeyCloud:
    """A cloud that the odometry placed, and that it keeps.

    Attributes
    ----------
    t : float
        When its last point was taken, s: the time of its pose.
    pose : RelativePose
        Of the body in the odometry's frame, the covariance being that of its match to the map.
    points_b : ndarray, shape (k, 3)
        Deskewed and thinned, in body axes at that time, m.
    index : int
        Of the cloud in its series.
    """

    t: float
    pose: RelativePose
    points_b: Array
    index: int


@dataclass(frozen=True)
class CloudTrack:
    """The odometry of a mission.

    Attributes
    ----------
    sensor : str
    t, R_ob, p_o : ndarray, shapes (n,), (n, 3, 3) and (n, 3)
        Poses of the body in the odometry's frame, one a cloud.
    key : list of KeyCloud
    rejections : tuple of Rejection
        Clouds that were too small.
    warnings : tuple of str
        What else there is to say of the clouds.
    """

    sensor: str
    t: Array
    R_ob: Array
    p_o: Array
    key: list[KeyCloud]
    rejections: tuple[Rejection, ...]
    warnings: tuple[str, ...] = ()

    def increment(self, i: int, j: int) -> RelativePose:
        """Pose of kept cloud j in kept cloud i.

        Both are placed in a map that changes little in between: each has its own error.
        """
        a, b = self.key[i].pose, self.key[j].pose
        R_ab, p_a = a.R_ab.T @ b.R_ab, a.R_ab.T @ (b.p_a - a.p_a)
        from_a = adjoint(R_ab.T, -R_ab.T @ p_a)
        return RelativePose(R_ab, p_a, from_a @ a.cov @ from_a.T + b.cov)

    def submap(self, j: int) -> Array:
        """Points of kept cloud j and its neighbours, as the odometry has them, around j; (k, 3)."""
        here = self.key[j].pose
        around = self.key[max(j - SUBMAP_REACH, 0) : j + SUBMAP_REACH + 1]
        placed = [cloud.points_b @ cloud.pose.R_ab.T + cloud.pose.p_a for cloud in around]
        return np.asarray((np.concatenate(placed) - here.p_a) @ here.R_ab)


class KissOdometry:
    """Places one cloud after the other.

    Parameters
    ----------
    settings : KissSettings
    """

    def __init__(self, settings: KissSettings) -> None:
        purpose = "cloud odometry"
        config = kiss_icp(purpose, "config").KISSConfig()
        config.data.min_range, config.data.max_range = settings.min_range_m, settings.max_range_m
        config.mapping.voxel_size = settings.voxel_m
        config.registration.max_num_iterations = MAX_ITERATIONS
        config.registration.convergence_criterion = CONVERGED
        config.registration.max_num_threads = 1  # sums are then the same every time
        self.settings = settings
        floor = np.r_[[np.radians(settings.floor_deg)] * 3, [settings.floor_m] * 3]
        self._floor = np.diag(floor**2)
        self._kiss = kiss_icp(purpose, "kiss_icp").KissICP(config)

    def expect(self, motion: Array) -> None:
        """Say how the vehicle moves from one cloud to the next, shape (4, 4), before the first."""
        self._kiss.last_delta = motion

    def place(self, points_b: Array, offset_s: ArrayLike | None) -> tuple[RelativePose, Array]:
        """Place the next cloud.

        Parameters
        ----------
        points_b : ndarray, shape (k, 3)
            In body axes at their own times, m.
        offset_s : ndarray, shape (k,), or None
            Their times; None, or all the same, is a cloud that needs no deskewing.

        Returns
        -------
        RelativePose
            Of the body at the time of the last point, in the odometry's frame; the covariance is
            that of the cloud in its local map.
        ndarray, shape (m, 3)
            The cloud, deskewed and thinned.

        Raises
        ------
        ValueError
            Where a point or a time is not finite.
        """
        kiss, voxel_m = self._kiss, self.settings.voxel_m
        offsets = np.empty(0) if offset_s is None else np.asarray(offset_s, dtype=float)
        if not (np.all(np.isfinite(points_b)) and np.all(np.isfinite(offsets))):
            raise ValueError("a point or its time is not finite: KISS-ICP would end the process")
        if _is_one_time(offsets):  # KISS-ICP divides by their span
            offsets = np.empty(0)
        coarse, thinned = self._deskewed(points_b, offsets, kiss.last_delta)
        local_map = np.asarray(kiss.local_map.point_cloud())
        if len(local_map) < LEAST_POINTS:  # the first cloud defines the frame
            kiss.local_map.update(thinned, kiss.last_pose)
            return RelativePose(np.eye(3), np.zeros(3), self._floor), thinned
        expected = kiss.last_pose @ kiss.last_delta
        spread = kiss.adaptive_threshold.get_threshold()
        T_ob = kiss.registration.align_points_to_map(
            coarse, kiss.local_map, expected, 3 * spread, spread
        )
        planes = Surfaces(local_map)
        R_ob, p_o, found = planes.refine(coarse, T_ob[:3, :3], T_ob[:3, 3], voxel_m)
        if len(offsets):
            moved = np.linalg.inv(kiss.last_pose) @ homogeneous(R_ob, p_o)
            coarse, thinned = self._deskewed(points_b, offsets, moved)
            R_ob, p_o, found = planes.refine(coarse, R_ob, p_o, voxel_m)
        T_ob = homogeneous(R_ob, p_o)
        kiss.adaptive_threshold.update_model_deviation(np.linalg.inv(expected) @ T_ob)
        kiss.local_map.update(thinned, T_ob)
        kiss.last_delta, kiss.last_pose = np.linalg.inv(kiss.last_pose) @ T_ob, T_ob
        cov = match_covariance(found, voxel_m)
        cov = np.diag(UNKNOWN_SIGMA**2) if cov is None else cov + self._floor
        return RelativePose(R_ob, p_o, cov), thinned

    def _deskewed(self, points_b: Array, offset_s: Array, motion: Array) -> tuple[Array, Array]:
        """Points to register, and those for the map, as if all were taken at the last one's time.

        ``motion``, shape (4, 4), is that since the cloud before.
        """
        points = np.asarray(points_b, dtype=float)
        coarse, thinned = self._kiss.voxelize(
            self._kiss.preprocessor.preprocess(points, offset_s, motion)
        )
        return np.asarray(coarse), np.asarray(thinned)


def cloud_odometry(
    mission: Mission, settings: KissSettings, progress: Progress
) -> CloudTrack | None:
    """Odometry of a mission's first cloud sensor; None without clouds.

    Raises
    ------
    PackageError
        Where KISS-ICP does not import.
    EstimationError
        Where hardly any cloud holds points.
    """
    sensor = mission.first("clouds")
    if sensor is None or not settings.use:
        return None
    series = sensor.series
    assert isinstance(series, CloudSeries)
    odometry = KissOdometry(settings)
    odometry.expect(_first_motion(sensor, settings))
    t: list[float] = []
    poses: list[RelativePose] = []
    key: list[KeyCloud] = []
    rejections: list[Rejection] = []
    n_timeless = 0
    for k, taken, cloud in _usable(sensor, rejections):
        n_timeless += cloud.offset_s is not None and _is_one_time(cloud.offset_s)
        keep = not key or taken - key[-1].t >= settings.keyframe_interval_s
        pose, thinned = odometry.place(_in_body(cloud, sensor), cloud.offset_s)
        t.append(taken)
        poses.append(pose)
        if keep:
            key.append(KeyCloud(taken, pose, thinned, k))
        progress("cloud odometry", (k + 1) / len(series))
    if len(key) < 2:
        raise EstimationError(f"sensor '{sensor.name}': fewer than two clouds hold points")
    return CloudTrack(
        sensor=sensor.name,
        t=np.array(t),
        R_ob=np.array([pose.R_ab for pose in poses]),
        p_o=np.array([pose.p_a for pose in poses]),
        key=key,
        rejections=tuple(rejections),
        warnings=_on_times(sensor.name, n_timeless),
    )


def _is_one_time(offset_s: NDArray[np.floating[Any]]) -> bool:
    return bool(len(offset_s)) and float(np.max(offset_s)) <= float(np.min(offset_s))


def _on_times(sensor_name: str, n_timeless: int) -> tuple[str, ...]:
    """What is said of clouds whose points all claim the same time."""
    if not n_timeless:
        return ()
    return (
        f"sensor '{sensor_name}': the times of the points tell nothing in {n_timeless} clouds (all"
        " the same): nothing takes the motion out of these",
    )


def _usable(sensor: Sensor, rejections: list[Rejection]) -> Iterator[tuple[int, float, Cloud]]:
    """Index, time of the last point and points of each cloud that is used; why others are not."""
    series = sensor.series
    assert isinstance(series, CloudSeries)
    last = -np.inf
    for k, source in enumerate(series.clouds):
        cloud = load(source)
        if len(cloud) < LEAST_POINTS:
            reason, taken = f"a cloud of fewer than {LEAST_POINTS} points", float(series.t[k])
        else:
            reason, taken = "", float(series.t[k]) + _last_offset(cloud)
            if taken <= last:
                reason = "a cloud that ends before the one before it"
        if reason:
            rejections.append(Rejection(taken, sensor.name, int(series.row[k]), reason))
            continue
        last = taken
        yield k, taken, cloud


def _first_motion(sensor: Sensor, settings: KissSettings) -> Array:
    """From the first cloud to the second, shape (4, 4): a vehicle need not begin at rest.

    The first cloud is not deskewed before the motion is known, and bends what is found of it: the
    pair is registered again with each motion found.
    """
    motion = np.eye(4)
    pair = [cloud for _, _, cloud in islice(_usable(sensor, []), 2)]
    for _ in range(FIRST_ROUNDS):
        odometry = KissOdometry(settings)
        odometry.expect(motion)
        for cloud in pair:
            pose, _ = odometry.place(_in_body(cloud, sensor), cloud.offset_s)
            motion = homogeneous(pose.R_ab, pose.p_a)
    return motion


def _last_offset(cloud: Cloud) -> float:
    return 0.0 if cloud.offset_s is None else float(np.max(cloud.offset_s))


def _in_body(cloud: Cloud, sensor: Sensor) -> Array:
    return np.asarray(cloud.points_s.astype(float) @ sensor.R_bs.T + sensor.xyz_b)


def adjoint(R_ab: Array, p_a: Array) -> Array:
    """Maps a small turn and shift along the axes of b to those along the axes of a, (6, 6)."""
    return np.block([[R_ab, np.zeros((3, 3))], [skew(p_a) @ R_ab, R_ab]])
