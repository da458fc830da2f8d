"""Local registration by small_gicp."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import RigidTransform

from registration.peers.entries import measured_mm, require
from registration.peers.params import RefineParams
from registration.scan import Scan

TYPES = {"gicp": "GICP", "point_to_plane": "PLANE_ICP"}
LEAST_INLIERS = 10


def refined(
    target: Scan, source: Scan, start: RigidTransform, params: RefineParams, threads: int
) -> tuple[RigidTransform | None, str]:
    """The pose that point-to-plane or generalised ICP ends at, or None and why.

    One that has not converged after max_iterations is given all the same.
    """
    small_gicp = require("small_gicp")
    (target_cloud, target_tree), (source_cloud, _) = (
        small_gicp.preprocess_points(measured_mm(scan), params.voxel_mm, params.neighbours, threads)
        for scan in (target, source)
    )
    result = small_gicp.align(
        target_cloud,
        source_cloud,
        target_tree,
        init_T_target_source=start.as_matrix(),
        registration_type=TYPES[params.kind],
        max_correspondence_distance=params.reach_mm,
        num_threads=threads,
        max_iterations=params.max_iterations,
    )
    matrix = np.asarray(result.T_target_source, dtype=np.float64)
    if result.num_inliers < LEAST_INLIERS or not np.isfinite(matrix).all():
        return None, (
            f"small_gicp found {result.num_inliers} points within {params.reach_mm:g} mm of the "
            f"other scan; {LEAST_INLIERS} are needed"
        )
    return RigidTransform.from_matrix(matrix), ""
