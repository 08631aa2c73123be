"""Registration of 3-D clouds without any idea of their pose, by Open3D: features and RANSAC.

Rusu, Blodow and Beetz, *Fast point feature histograms (FPFH) for 3D registration* (ICRA 2009);
Fischler and Bolles, *Random sample consensus* (1981). It gives a start for ICP, no more.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.registration.open3d_icp import thinned
from gtsam_nav.registration.packages import one_thread, open3d
from gtsam_nav.registration.settings import Open3dSettings

COARSE_VOXELS = 3.0
"""Features are those of clouds that are thinned so much more."""
FEATURE_RADIUS_VOXELS, FEATURE_NEIGHBOURS = 5.0, 100
GATE_VOXELS = 1.5
EDGE_SIMILARITY = 0.9
"""Edges between three pairs agree in length by this factor, else the triple is not tried."""
RANSAC_ITERATIONS, RANSAC_CONFIDENCE = 50_000, 0.999
SEED = 0


def global_start(reference: Array, new: Array, settings: Open3dSettings) -> Array | None:
    """Rough pose of a new cloud (m, 3) in a reference (n, 3) as one matrix; None without any.

    The same clouds give the same pose: the draws begin from a fixed seed.
    """
    o3d = open3d("loops between clouds")
    registration = o3d.pipelines.registration
    voxel_m = COARSE_VOXELS * settings.voxel_m
    gate_m = GATE_VOXELS * voxel_m
    with one_thread():
        o3d.utility.random.seed(SEED)
        clouds = [thinned(points, voxel_m) for points in (new, reference)]
        found = registration.registration_ransac_based_on_feature_matching(
            *clouds,
            *(_features(registration, o3d, cloud, voxel_m) for cloud in clouds),
            mutual_filter=True,
            max_correspondence_distance=gate_m,
            estimation_method=registration.TransformationEstimationPointToPoint(),
            ransac_n=3,
            checkers=[
                registration.CorrespondenceCheckerBasedOnEdgeLength(EDGE_SIMILARITY),
                registration.CorrespondenceCheckerBasedOnDistance(gate_m),
            ],
            criteria=registration.RANSACConvergenceCriteria(RANSAC_ITERATIONS, RANSAC_CONFIDENCE),
        )
    if found.fitness <= 0.0:
        return None
    return np.array(found.transformation)


def _features(registration: Any, o3d: Any, cloud: Any, voxel_m: float) -> Any:
    search = o3d.geometry.KDTreeSearchParamHybrid(
        radius=FEATURE_RADIUS_VOXELS * voxel_m, max_nn=FEATURE_NEIGHBOURS
    )
    return registration.compute_fpfh_feature(cloud, search)
