"""The map of a mission's clouds: placed by a trajectory, one point a voxel, strays taken out."""

from __future__ import annotations

import numpy as np

from gtsam_nav.errors import PackageError
from gtsam_nav.odometry.cloud_track import CloudTrack
from gtsam_nav.registration.packages import one_thread, open3d
from gtsam_nav.solution import SonarMap
from gtsam_nav.trajectory import Trajectory

NEIGHBOURS, OUTLIER_SIGMAS = 16, 2.0
"""A point whose neighbours are further away, on average, than most points' are is a stray."""
STRENGTH = 255.0


def cloud_map(track: CloudTrack, trajectory: Trajectory, voxel_m: float) -> SonarMap | None:
    """Map of the kept clouds; None where the trajectory covers none of them.

    Parameters
    ----------
    track : CloudTrack
    trajectory : Trajectory
        Places the clouds, whatever the odometry made of them.
    voxel_m : float
        Side of the cubes that hold one point each, with the mean time of what fell into them.

    Raises
    ------
    PackageError
        Where Open3D does not import.
    """
    o3d = open3d("the map of clouds")
    t = np.array([cloud.t for cloud in track.key])
    covered = np.flatnonzero(trajectory.covers(t))
    if not len(covered):
        return None
    there = trajectory.interpolate(t[covered])
    placed = [
        track.key[j].points_b @ R_nb.T + p_n
        for j, R_nb, p_n in zip(covered.tolist(), there.R_nb, there.p_n, strict=True)
    ]
    times = np.repeat(t[covered], [len(points) for points in placed])
    cloud = o3d.t.geometry.PointCloud(o3d.core.Tensor(np.concatenate(placed)))
    cloud.point["t"] = o3d.core.Tensor(times[:, None])
    with one_thread():
        cloud = cloud.voxel_down_sample(voxel_m)
        cloud, _ = cloud.remove_statistical_outliers(NEIGHBOURS, OUTLIER_SIGMAS)
    points_n = cloud.point.positions.numpy().astype(float)
    taken = cloud.point["t"].numpy().astype(float)[:, 0]
    # the voxels come in no order of their own
    order = np.lexsort([*points_n.T, taken])
    return SonarMap(points_n[order], taken[order], np.full(len(order), STRENGTH))


def map_or_reason(
    track: CloudTrack, trajectory: Trajectory, voxel_m: float
) -> tuple[SonarMap | None, tuple[str, ...]]:
    """`cloud_map`, or why there is none: a map is no reason to lose a trajectory."""
    try:
        points = cloud_map(track, trajectory, voxel_m)
    except PackageError as error:
        return None, (f"no map of the clouds: {error}",)
    if points is None:
        return None, ("no map of the clouds: the trajectory covers none of them",)
    return points, ()
