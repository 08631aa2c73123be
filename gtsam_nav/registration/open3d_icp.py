"""Registration of 3-D clouds by Open3D: point-to-plane ICP and generalised ICP, coarse to fine.

Chen and Medioni, *Object modelling by registration of multiple range images* (1992); Segal, Haehnel
and Thrun, *Generalized-ICP* (RSS 2009); Zhou, Park and Koltun, *Open3D* (2018). The covariance is
`surfaces`'. One thread: Open3D's sums depend on how its threads share them.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.registration.packages import one_thread, open3d
from gtsam_nav.registration.result import CloudMatch, RelativePose
from gtsam_nav.registration.settings import Open3dSettings
from gtsam_nav.registration.surfaces import Surfaces, match_covariance

COARSE_TO_FINE = (4.0, 2.0, 1.0)
"""Voxels of one registration after the other, in sizes of the finest."""
GATE_VOXELS = 2.0
"""Partners lie within so many voxels."""
NORMAL_RADIUS_VOXELS, NORMAL_NEIGHBOURS = 3.0, 30
PLANE_EPSILON = 1e-3
"""Of generalised ICP: variance across a surface over that along it."""
MAX_ITERATIONS = 60
CONVERGED = 1e-7


def register_icp(
    reference: Array, new: Array, prior: RelativePose, settings: Open3dSettings
) -> CloudMatch:
    """Register by point-to-plane ICP; see `register`."""
    estimation = open3d("open3d-icp").pipelines.registration
    return register(
        reference, new, prior, settings, estimation.TransformationEstimationPointToPlane()
    )


def register_gicp(
    reference: Array, new: Array, prior: RelativePose, settings: Open3dSettings
) -> CloudMatch:
    """Register by generalised ICP; see `register`."""
    estimation = open3d("open3d-gicp").pipelines.registration
    generalised = estimation.TransformationEstimationForGeneralizedICP(PLANE_EPSILON)
    return register(reference, new, prior, settings, generalised)


def register(
    reference: Array, new: Array, prior: RelativePose, settings: Open3dSettings, estimation: Any
) -> CloudMatch:
    """Register a new cloud to a reference cloud.

    Parameters
    ----------
    reference, new : ndarray, shapes (n, 3) and (m, 3)
        Points without their sensor's motion, m.
    prior : RelativePose
        Expected pose of the new cloud in the reference: where the search begins.
    settings : Open3dSettings
    estimation : open3d.pipelines.registration.TransformationEstimation*
        The cost.

    Returns
    -------
    CloudMatch
        With a `failure` where points or overlap were too few.
    """
    if min(len(reference), len(new)) < settings.min_points:
        return CloudMatch(prior, 0.0, f"fewer than {settings.min_points} points")
    T_ab = homogeneous(prior.R_ab, prior.p_a)
    with one_thread():
        for scale in COARSE_TO_FINE:
            voxel_m = scale * settings.voxel_m
            thin_reference, thin_new = thinned(reference, voxel_m), thinned(new, voxel_m)
            T_ab = _solve(thin_new, thin_reference, T_ab, GATE_VOXELS * voxel_m, estimation)
    return judge(
        np.asarray(thin_reference.points), np.asarray(thin_new.points), T_ab, prior, settings
    )


def judge(
    reference: Array, new: Array, T_ab: Array, prior: RelativePose, settings: Open3dSettings
) -> CloudMatch:
    """A pose with its covariance and fitness, or the reason why it is none."""
    if not np.all(np.isfinite(T_ab)):
        return CloudMatch(prior, 0.0, "diverged")
    R_ab, p_a = T_ab[:3, :3], T_ab[:3, 3]
    found = Surfaces(reference).align(new, R_ab, p_a, GATE_VOXELS * settings.voxel_m)
    cov = match_covariance(found, settings.voxel_m)
    failure = ""
    if found.fitness < settings.min_fitness:
        failure = f"fitness {found.fitness:.2f} below {settings.min_fitness:.2f}"
    elif cov is None:
        failure = "too few points on surfaces"
    pose = RelativePose(R_ab, p_a, prior.cov if cov is None else cov + floor(settings))
    return CloudMatch(pose, found.fitness, failure)


def floor(settings: Open3dSettings) -> Array:
    """Least covariance (6, 6) of a match."""
    sigma = np.r_[[np.radians(settings.floor_deg)] * 3, [settings.floor_m] * 3]
    return np.diag(sigma**2)


def homogeneous(R_ab: Array, p_a: Array) -> Array:
    """Rotation and origin as one matrix, shape (4, 4)."""
    T_ab = np.eye(4)
    T_ab[:3, :3], T_ab[:3, 3] = R_ab, p_a
    return T_ab


def thinned(points: Array, voxel_m: float) -> Any:
    """An Open3D cloud with normals, one point a voxel."""
    o3d = open3d("registration of clouds")
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(np.asarray(points, dtype=float)))
    cloud = cloud.voxel_down_sample(voxel_m)
    search = o3d.geometry.KDTreeSearchParamHybrid(
        radius=NORMAL_RADIUS_VOXELS * voxel_m, max_nn=NORMAL_NEIGHBOURS
    )
    cloud.estimate_normals(search)
    return cloud


def _solve(new: Any, reference: Any, T_ab: Array, gate_m: float, estimation: Any) -> Array:
    registration = open3d("registration of clouds").pipelines.registration
    criteria = registration.ICPConvergenceCriteria(CONVERGED, CONVERGED, MAX_ITERATIONS)
    generalised = registration.TransformationEstimationForGeneralizedICP
    solve = (
        registration.registration_generalized_icp
        if isinstance(estimation, generalised)
        else registration.registration_icp
    )
    found = solve(new, reference, gate_m, T_ab, estimation, criteria)
    return np.array(found.transformation)
