"""The turn and the shift of all matching segments together (sections 4.2.2 and 4.3.2)."""

from __future__ import annotations

import numpy as np

from registration.planar.overlap import Matches, matches_under
from registration.planar.params import PlanarParams
from registration.scan import FloatArray

ITERATIONS = 30


def averaged(
    pose: FloatArray, matches: Matches, target_mm: FloatArray, source_mm: FloatArray
) -> FloatArray:
    """The pose (3,) with the mean shift of the matching centroids, weighted by their overlap.

    target_mm, source_mm: (n, 2) centroids. The two-dimensional (4-27), with lengths for areas.
    """
    cos, sin = np.cos(pose[0]), np.sin(pose[0])
    turned = source_mm[matches.pairs[:, 1]] @ np.array([[cos, -sin], [sin, cos]])
    shifts = target_mm[matches.pairs[:, 0]] - turned
    return np.array([pose[0], *np.average(shifts, axis=0, weights=matches.overlap_mm)])


def laid_on_lines(
    pose: FloatArray, target: FloatArray, source: FloatArray, params: PlanarParams
) -> FloatArray:
    """The pose (3,) that minimises the squared distances of the matching lines.

    Each match counts by its overlap, at both ends of it; Gauss-Newton, the matches found anew in
    every step. The pose that came in is returned when the steps do not settle, or when they lose
    what made it determined.
    """
    tolerances = (params.angle_tolerance_rad, params.offset_tolerance_mm)
    start = pose
    for _ in range(ITERATIONS):
        matches = matches_under(target, source, pose, *tolerances)
        if not is_determined(matches, params.parallel_rad):
            return start
        # About the middle of the overlaps, where turn and shift hang together least.
        points = 0.5 * (matches.target_mm + matches.source_mm)
        middle = np.average(points.mean(axis=1), axis=0, weights=matches.overlap_mm)
        arms = points - middle
        normal = matches.normal[:, None]
        residual = np.sum(normal * (matches.target_mm - matches.source_mm), axis=2).ravel()
        # By the matrix of C.1 a growing dphi turns (y, z) towards (z, -y).
        turning = normal[..., 0] * arms[..., 1] - normal[..., 1] * arms[..., 0]
        slope = np.column_stack([turning.ravel(), np.repeat(matches.normal, 2, axis=0)])
        root = np.sqrt(np.repeat(matches.overlap_mm, 2))
        step = np.linalg.lstsq(root[:, None] * slope, root * residual, rcond=None)[0]
        cos, sin = np.cos(step[0]), np.sin(step[0])
        shift = np.array([[cos, sin], [-sin, cos]]) @ (pose[1:] - middle) + middle + step[1:]
        pose = np.array([pose[0] + step[0], *shift])
        if abs(step[0]) < 1e-12 and np.abs(step[1:]).max() < 1e-9:
            return pose
    return start


def is_determined(matches: Matches, parallel_rad: float) -> bool:
    """Whether two of the matching lines meet at more than an angle."""
    y, z = matches.normal[:, 0], matches.normal[:, 1]
    return bool(np.any(np.abs(np.outer(y, z) - np.outer(z, y)) > np.sin(parallel_rad)))
