"""The points of a scan gathered by label, so that each plane's lie side by side in memory."""

from __future__ import annotations

import numpy as np

from registration.gauss_sphere.beams import Fan
from registration.gauss_sphere.calibrated import DEPTH, MEASURED, SIGMA, SLOPE, X
from registration.kernels import compiled
from registration.scan import FloatArray, IntArray


@compiled
def points_by_label(label: IntArray, n_patches: int) -> tuple[IntArray, IntArray, IntArray]:
    """Profile and pixel of all labelled points, label by label, and where each label starts."""
    starts = np.zeros(n_patches + 1, np.int64)
    for p in range(label.shape[0]):
        for u in range(label.shape[1]):
            if label[p, u] >= 0:
                starts[label[p, u] + 1] += 1
    for i in range(n_patches):
        starts[i + 1] += starts[i]
    filled = starts[:-1].copy()
    rows, pixels = np.empty(starts[-1], np.int64), np.empty(starts[-1], np.int64)
    for p in range(label.shape[0]):
        for u in range(label.shape[1]):
            i = label[p, u]
            if i >= 0:
                rows[filled[i]], pixels[filled[i]] = p, u
                filled[i] += 1
    return rows, pixels, starts


@compiled
def beams_of(fan: Fan, measured: FloatArray, rows: IntArray, pixels: IntArray) -> FloatArray:
    """(5, n) position, slope, depth, standard deviation and measured depth of points."""
    beams, columns = np.empty((5, rows.size)), fan.depth_mm.shape[1]
    slope, depth, sigma = fan.slope.reshape(-1), fan.depth_mm.reshape(-1), fan.sigma_mm.reshape(-1)
    all_measured = measured.reshape(-1)
    for j in range(rows.size):
        i = rows[j] * columns + pixels[j]
        beams[X, j], beams[SLOPE, j] = fan.x_mm[rows[j]], slope[i]
        beams[DEPTH, j], beams[SIGMA, j], beams[MEASURED, j] = depth[i], sigma[i], all_measured[i]
    return beams
