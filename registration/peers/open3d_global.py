"""Global registration by Open3D, set up as in its tutorial on global registration."""

from __future__ import annotations

from time import perf_counter
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from registration.peers.entries import measured_mm, require
from registration.peers.params import FgrParams, RansacParams
from registration.scan import Scan

NORMAL_CELLS, NORMAL_NEIGHBOURS = 2.0, 30
FEATURE_CELLS, FEATURE_NEIGHBOURS = 5.0, 100
RANSAC_CELLS, FGR_CELLS = 1.5, 0.5

Found = tuple[RigidTransform | None, str, dict[str, float]]


def ransac(target: Scan, source: Scan, params: RansacParams) -> Found:
    """The pose with the most feature matches as inliers, or None and why; times by stage."""
    o3d = _open3d(params.threads, params.seed)
    started = perf_counter()
    (target_cloud, target_feature), (source_cloud, source_feature) = (
        _featured(o3d, scan, params.voxel_mm) for scan in (target, source)
    )
    described = perf_counter()
    registration = o3d.pipelines.registration
    reach_mm = RANSAC_CELLS * params.voxel_mm
    result = registration.registration_ransac_based_on_feature_matching(
        source_cloud,
        target_cloud,
        source_feature,
        target_feature,
        True,
        reach_mm,
        registration.TransformationEstimationPointToPoint(False),
        3,
        [
            registration.CorrespondenceCheckerBasedOnEdgeLength(params.edge_similarity),
            registration.CorrespondenceCheckerBasedOnDistance(reach_mm),
        ],
        registration.RANSACConvergenceCriteria(params.max_iterations, params.confidence),
    )
    return _answer(result, started, described, "RANSAC")


def fast_global(target: Scan, source: Scan, params: FgrParams) -> Found:
    """The pose that graduated non-convexity finds, or None and why; times by stage."""
    o3d = _open3d(params.threads, params.seed)
    started = perf_counter()
    (target_cloud, target_feature), (source_cloud, source_feature) = (
        _featured(o3d, scan, params.voxel_mm) for scan in (target, source)
    )
    described = perf_counter()
    registration = o3d.pipelines.registration
    result = registration.registration_fgr_based_on_feature_matching(
        source_cloud,
        target_cloud,
        source_feature,
        target_feature,
        registration.FastGlobalRegistrationOption(
            maximum_correspondence_distance=FGR_CELLS * params.voxel_mm
        ),
    )
    return _answer(result, started, described, "fast global registration")


def _open3d(threads: int, seed: int) -> Any:
    o3d = require("open3d")
    o3d.utility.set_verbosity_level(o3d.utility.VerbosityLevel.Error)
    o3d.utility.set_max_threads(threads)
    o3d.utility.random.seed(seed)
    return o3d


def _featured(o3d: Any, scan: Scan, voxel_mm: float) -> tuple[Any, Any]:
    """A thinned cloud with normals towards the sensor, and its features."""
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(measured_mm(scan)))
    cloud = cloud.voxel_down_sample(voxel_mm)
    hybrid = o3d.geometry.KDTreeSearchParamHybrid
    cloud.estimate_normals(hybrid(NORMAL_CELLS * voxel_mm, NORMAL_NEIGHBOURS))
    sensor_mm = np.zeros(3) if scan.apex_mm is None else scan.apex_mm.copy()
    sensor_mm += 0.5 * scan.origins_mm[-1]  # half-way along
    cloud.orient_normals_towards_camera_location(sensor_mm)
    feature = o3d.pipelines.registration.compute_fpfh_feature(
        cloud, hybrid(FEATURE_CELLS * voxel_mm, FEATURE_NEIGHBOURS)
    )
    return cloud, feature


def _answer(result: Any, started: float, described: float, name: str) -> Found:
    stage_ms = {
        "features": 1e3 * (described - started),
        "matching": 1e3 * (perf_counter() - described),
    }
    matrix = np.asarray(result.transformation, dtype=np.float64)
    if result.fitness <= 0.0 or not np.isfinite(matrix).all():
        return None, f"{name} found no pose that lays a point of one scan on the other", stage_ms
    return RigidTransform.from_matrix(matrix), "", stage_ms
