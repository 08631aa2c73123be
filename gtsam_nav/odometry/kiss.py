"""KISS-ICP odometry: the motion between clouds, with a covariance, and the clouds deskewed.

Vizzo, Guadagnino, Mersch, Wiesmann, Behley and Stachniss, *KISS-ICP: in defense of point-to-point
ICP* (RA-L 2023): a sweep is deskewed at the velocity of the one before, to the time of its last
point, and registered to a local map. Two things are added. Between the rings of few beams
point-to-point pairs hold a pose back, so it is then moved onto the planes of that map
(`registration.surfaces`), which also tell how well it is known. And in waves the velocity of the
sweep before is the wrong one, so the sweep is deskewed once more with the motion just found.
The first sweep knows of no motion: it is registered with the second until their motion is known.
Clouds need not come at a constant rate: a motion is one over time (`steady_motion.Wake`). In a gap
it goes on for a while only, and what does not fit onto the map begins another.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain, pairwise

import numpy as np

from gtsam_nav.errors import EstimationError
from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission, Rejection
from gtsam_nav.odometry.cloud_track import CloudTrack, KeyCloud
from gtsam_nav.odometry.settings import KissSettings
from gtsam_nav.odometry.steady_motion import AT_REST, SteadyMotion, Wake
from gtsam_nav.odometry.sweeps import Sweep, usable_sweeps
from gtsam_nav.registration.open3d_icp import homogeneous
from gtsam_nav.registration.packages import kiss_icp
from gtsam_nav.registration.result import RelativePose
from gtsam_nav.registration.surfaces import Alignment, Surfaces, match_covariance
from gtsam_nav.sensors.twins import said_of_twin
from gtsam_nav.solution import Progress

MAX_ITERATIONS, CONVERGED = 20, 1e-3
"""Of the point-to-point registration, which need not settle; the latter in m and rad."""
LEAST_POINTS = 50
"""Of a cloud, in range."""
LEAST_VOXELS = 6
"""Of a cloud as it is registered: fewer points cannot fix a pose."""
GAP_INTERVALS = 3.0
"""Clouds so many times further apart than usual have a gap between them."""
LONGEST_COAST_S = 5.0
"""A motion over one interval, and its noise, may go on so long through a gap."""
WIDEST_SPREAD_M = 4.0
"""How far a pose may lie off the expected one, one standard deviation, however long ago it was."""
LEAST_FITNESS, SURE_FITNESS = 0.5, 0.8
"""A match of a smaller share of the points is false; after a gap it may be."""
FIRST_ROUNDS = 3
"""Registrations of the first two clouds from which the odometry sets out."""
UNSTEADY = np.array([0.05] * 3 + [0.5] * 3)
"""How fast the rates of a motion may change: rad/s^2 and m/s^2."""
UNKNOWN_SIGMA = np.array([0.1] * 3 + [1.0] * 3)
"""Of a pose whose points met no plane: rad and m."""


class KissOdometry:
    """Places one cloud after the other.

    Parameters
    ----------
    settings : KissSettings

    Attributes
    ----------
    map : int
        Number of the local map, from zero: what cannot be matched begins another.
    n_gaps : int
        How many of these began after a gap.
    """

    def __init__(self, settings: KissSettings) -> None:
        purpose = "cloud odometry"
        config = kiss_icp(purpose, "config").KISSConfig()
        config.data.min_range, config.data.max_range = settings.min_range_m, settings.max_range_m
        config.mapping.voxel_size = settings.voxel_m
        config.registration.max_num_iterations = MAX_ITERATIONS
        config.registration.convergence_criterion = CONVERGED
        config.registration.max_num_threads = 1  # sums are then the same every time
        self.map = self.n_gaps = 0
        self._voxel_m = settings.voxel_m
        floor = np.r_[[np.radians(settings.floor_deg)] * 3, [settings.floor_m] * 3]
        self._floor = np.diag(floor**2)
        self._kiss = kiss_icp(purpose, "kiss_icp").KissICP(config)
        self._motion, self._wake = AT_REST, Wake()
        self._t, self._T_ob = -np.inf, np.eye(4)

    def has_enough(self, points_b: Array) -> bool:
        """Whether a cloud (k, 3) keeps enough points in range, not all in one place."""
        in_range = self._kiss.preprocessor.preprocess(points_b, np.empty(0), np.eye(4))
        if len(in_range) < LEAST_POINTS:
            return False
        coarse, _ = self._kiss.voxelize(in_range)
        return len(coarse) >= LEAST_VOXELS

    def place(self, sweep: Sweep, following: Sweep | None) -> tuple[RelativePose, Array]:
        """Place the next cloud, which `has_enough`.

        Parameters
        ----------
        sweep : Sweep
        following : Sweep or None
            The one that will be placed next: it tells how the vehicle moves as a map begins.

        Returns
        -------
        RelativePose
            Of the body at the time of the last point, in the odometry's frame; the covariance is
            that of the cloud in its local map.
        ndarray, shape (m, 3)
            The cloud, deskewed and thinned.
        """
        if self._t == -np.inf:
            return self._begin(sweep, following, self._T_ob)
        since_s = sweep.t - self._t
        is_gap = since_s > GAP_INTERVALS * self._wake.pace_s
        expected = self._expected(sweep.t, is_gap)
        # within a gap the vehicle may have stopped
        starts = [expected, self._T_ob] if is_gap else [expected]
        matches = [self._match(sweep, start) for start in starts]
        T_ob, thinned, found = max(matches, key=lambda match: match[2].fitness)
        if found.fitness < (SURE_FITNESS if is_gap else LEAST_FITNESS):
            self.map += 1
            self.n_gaps += is_gap
            return self._begin(sweep, following, expected)
        if not is_gap:
            deviation = np.linalg.inv(expected) @ T_ob
            self._kiss.adaptive_threshold.update_model_deviation(deviation)
        self._motion = self._wake.motion_to(sweep.t, T_ob, sweep.span_s)
        self._wake.add(sweep.t, T_ob)
        self._t, self._T_ob = sweep.t, T_ob
        self._kiss.local_map.update(thinned, T_ob)
        cov = match_covariance(found, self._voxel_m)
        cov = np.diag(UNKNOWN_SIGMA**2) if cov is None else cov + self._floor
        cov = cov + _bend(sweep, since_s)
        return RelativePose(T_ob[:3, :3], T_ob[:3, 3], cov), thinned

    def _begin(
        self, sweep: Sweep, following: Sweep | None, T_ob: Array
    ) -> tuple[RelativePose, Array]:
        """Make a map of one cloud, which defines its frame: a vehicle need not begin at rest.

        It cannot be deskewed before the motion to the one that follows is known, and bends what is
        found of it: the pair is registered again with each motion found.
        """
        self._t, self._T_ob = sweep.t, T_ob
        self._wake.break_off(sweep.t, T_ob)
        thinned = self._lay(sweep)
        longest_s = GAP_INTERVALS * self._wake.pace_s
        if following is not None and following.t - sweep.t <= longest_s:
            for _ in range(FIRST_ROUNDS):
                there, _, _ = self._match(following, self._expected(following.t, False))
                self._motion = self._wake.motion_to(following.t, there, following.span_s)
                thinned = self._lay(sweep)
        return RelativePose(T_ob[:3, :3], T_ob[:3, 3], self._floor), thinned

    def _expected(self, t: float, is_gap: bool) -> Array:
        """Where the vehicle is at a time, shape (4, 4), if it goes on as it did for a while."""
        from scipy.spatial.transform import Rotation

        # the first stamps may jitter: their motion is not believed for long
        longest_s = LONGEST_COAST_S if is_gap else GAP_INTERVALS * self._motion.span_s
        there = self._T_ob @ self._motion.over(min(t - self._t, longest_s))
        # KISS-ICP ends the process where a rotation is none by rounding
        R_ob = Rotation.from_matrix(there[:3, :3]).as_matrix()
        return homogeneous(R_ob, there[:3, 3])

    def _lay(self, sweep: Sweep) -> Array:
        """Make the map of one cloud alone, which it returns as it lies there."""
        _, thinned = self._deskewed(sweep, self._motion)
        self._kiss.local_map.clear()
        self._kiss.local_map.update(thinned, self._T_ob)
        return thinned

    def _match(self, sweep: Sweep, expected: Array) -> tuple[Array, Array, Alignment]:
        """Register a cloud to the map: its pose, its points for the map, how they lie on it."""
        kiss = self._kiss
        planes = Surfaces(np.asarray(kiss.local_map.point_cloud()))
        coarse, thinned = self._deskewed(sweep, self._motion)
        # the longer ago, the less is known of where it is now
        longer = max((sweep.t - self._t) / self._wake.pace_s, 1.0)
        spread = min(kiss.adaptive_threshold.get_threshold() * longer, WIDEST_SPREAD_M)
        T_ob = kiss.registration.align_points_to_map(
            coarse, kiss.local_map, expected, 3 * spread, spread
        )
        R_ob, p_o, found = planes.refine(coarse, T_ob[:3, :3], T_ob[:3, 3], self._voxel_m)
        if sweep.span_s:
            motion = self._wake.motion_to(sweep.t, homogeneous(R_ob, p_o), sweep.span_s)
            coarse, thinned = self._deskewed(sweep, motion)
            R_ob, p_o, found = planes.refine(coarse, R_ob, p_o, self._voxel_m)
        return homogeneous(R_ob, p_o), thinned, found

    def _deskewed(self, sweep: Sweep, motion: SteadyMotion) -> tuple[Array, Array]:
        """Points to register, and those for the map, as if all taken at the last one's time."""
        # KISS-ICP divides by their span
        offset_s = sweep.offset_s if sweep.offset_s is not None and sweep.span_s else np.empty(0)
        points = self._kiss.preprocessor.preprocess(
            sweep.points_b, offset_s, motion.over(sweep.span_s)
        )
        coarse, thinned = self._kiss.voxelize(points)
        return np.asarray(coarse), np.asarray(thinned)


def _bend(sweep: Sweep, since_s: float) -> Array:
    """Covariance (6, 6) of a pose for the bend that its sweep keeps: the rates are not its own.

    They are the mean ones since the last sweep, half a pause earlier, and carry its points over
    half a sweep on average.
    """
    pause_s = max(since_s - sweep.span_s, 0.0)
    return np.diag((UNSTEADY * pause_s / 2 * sweep.span_s / 2) ** 2)


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
    odometry = KissOdometry(settings)
    t: list[float] = []
    poses: list[RelativePose] = []
    key: list[KeyCloud] = []
    rejections: list[Rejection] = []
    n_timeless = 0
    sweeps = usable_sweeps(sensor, odometry.has_enough, rejections)
    for sweep, following in pairwise(chain(sweeps, [None])):
        assert sweep is not None
        n_timeless += sweep.offset_s is not None and not sweep.span_s
        pose, thinned = odometry.place(sweep, following)
        t.append(sweep.t)
        poses.append(pose)
        if not key or sweep.t - key[-1].t >= settings.keyframe_interval_s:
            key.append(KeyCloud(sweep.t, pose, thinned, sweep.index, odometry.map))
        progress("cloud odometry", (sweep.index + 1) / len(sensor.series))
    if len(key) < 2:
        raise EstimationError(f"sensor '{sensor.name}': {_too_few(t, rejections, settings)}")
    return CloudTrack(
        sensor=sensor.name,
        t=np.array(t),
        R_ob=np.array([pose.R_ab for pose in poses]),
        p_o=np.array([pose.p_a for pose in poses]),
        key=key,
        rejections=tuple(rejections),
        warnings=(
            *_on_twins(mission),
            *_on_clouds(sensor.name, n_timeless, odometry),
        ),
    )


def _too_few(t: list[float], rejections: list[Rejection], settings: KissSettings) -> str:
    """Why clouds placed at some times are no odometry."""
    if len(t) > 1:
        return (
            f"its {len(t)} clouds end within {t[-1] - t[0]:.3g} s: shorter than"
            f" kiss.keyframe_interval_s, {settings.keyframe_interval_s:g} s"
        )
    why = f": {rejections[0].reason}" if rejections else ""
    return f"fewer than two clouds can be used{why}"


def _on_clouds(sensor_name: str, n_timeless: int, odometry: KissOdometry) -> Iterator[str]:
    """What is said of clouds whose points all claim the same time, or that fit onto none before."""
    if n_timeless:
        yield (
            f"sensor '{sensor_name}': the times of the points tell nothing in {n_timeless} clouds"
            " (all the same): nothing takes the motion out of these"
        )
    if odometry.n_gaps:
        yield (
            f"sensor '{sensor_name}': after {odometry.n_gaps} of its gaps the clouds do not fit"
            " onto those before: the motion over these is a guess"
        )
    n_misfits = odometry.map - odometry.n_gaps
    if n_misfits:
        yield (
            f"sensor '{sensor_name}': no fit of {n_misfits} of its clouds onto those before,"
            " without a gap (they may be too far apart or too sparse): the motion to these is a"
            " guess"
        )


def _on_twins(mission: Mission) -> Iterator[str]:
    first, *others = mission.of_type("clouds")
    for sensor in others:
        yield said_of_twin(sensor, f"one is taken, '{first.name}'")
