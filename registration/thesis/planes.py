"""Least-squares planes (section 5.4)."""

from __future__ import annotations

import numpy as np

from registration.scan import FloatArray, IntArray
from registration.thesis.view_params import PlaneFit


def fit_planes(
    points_mm: FloatArray, point_plane: IntArray, n_planes: int, fit: PlaneFit
) -> tuple[FloatArray, FloatArray]:
    """Fit a plane to each group of points.

    points_mm, point_plane: (q, 3), (q,) the points and the plane each belongs to.
    fit: "uncentred" takes the unit eigenvector of the smallest eigenvalue of the 4 x 4 matrix of
        (5-2), (5-3), whose normal is biased under noise; "centred" that of the 3 x 3 scatter about
        the mean (corrected). Around the origin the former can miss every direction, (0, 0, 0, 1);
        the latter takes its place there.
    Returns normals (m, 3), unit, of arbitrary sign, and means (m, 3).
    """
    count = np.bincount(point_plane, minlength=n_planes).astype(np.float64)
    mean = np.zeros((n_planes, 3))
    np.add.at(mean, point_plane, points_mm)
    mean /= np.maximum(count, 1.0)[:, None]
    if fit == "centred":
        rows = points_mm - mean[point_plane]
    else:
        rows = np.column_stack([points_mm, np.ones(len(points_mm))])
    scatter = np.zeros((n_planes, rows.shape[1], rows.shape[1]))
    np.add.at(scatter, point_plane, rows[:, :, None] * rows[:, None, :])
    smallest = np.linalg.eigh(scatter)[1][:, :, 0]
    normal = smallest[:, :3]
    length = np.linalg.norm(normal, axis=1)
    lost = length < 1e-9
    if lost.any():
        normal = np.where(
            lost[:, None], fit_planes(points_mm, point_plane, n_planes, "centred")[0], normal
        )
        length[lost] = 1.0
    return normal / length[:, None], mean
