"""Where the beams of a scan meet, behind the sensor's front, from its points alone."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from registration.kernels import compiled
from registration.scan import BoolArray, FloatArray

# Stands for beams that do not meet. Farther off, the rounding of inverse depths, in which planes
# are found, comes to more than a noise of 0.02 mm.
PARALLEL_APEX_MM = 3e4
PARALLEL = 1e-6  # of the largest singular value of the lines' equations, their least
APEX_PROFILES = 40  # of a longer scan, for the apex
CLEAR_MM = 5.0  # of relief: of less a pixel's line is mostly rounding
LEAST_PIXELS = 8  # with a clear line


@compiled
def find_apex(
    points: FloatArray, usable: BoolArray, lean: FloatArray, if_flat: FloatArray
) -> FloatArray:
    """Find where the beams meet from points whose noise lies along their beam.

    A pixel's points satisfy y = apex_y + s (z - apex_z) in all profiles; the intercepts of these
    lines over their slopes give the apex. Scans too flat to tell have if_flat (3,), or where that
    is NaN nearly parallel beams.
    """
    stride = max(points.shape[0] // APEX_PROFILES, 1)
    pixels = _pixel_lines(points, usable, lean, stride)
    parallel = np.array([0.0, 0.0, -PARALLEL_APEX_MM])
    n = pixels.n.size
    slope, intercept, weight = np.empty(n), np.empty(n), np.zeros(n)
    used = 0
    for u in range(n):
        spread, shared = pixels.spread[u], pixels.shared[u]
        clear = spread > CLEAR_MM**2 * pixels.n[u]
        if pixels.n[u] >= 3 and clear and np.isfinite(spread + shared):  # absurd marks overflow
            slope[used] = shared / spread
            intercept[used] = pixels.mean_y[u] - slope[used] * pixels.mean_z[u]
            weight[used] = spread
            used += 1
    if used < LEAST_PIXELS:
        return parallel if np.isnan(if_flat).any() else if_flat
    slope, intercept, weight = slope[:used], intercept[:used], weight[:used]
    total = weight.sum()
    mean_slope = (weight * slope).sum() / total
    mean_intercept = (weight * intercept).sum() / total
    slope -= mean_slope
    spread, shared = (weight * slope * slope).sum(), (weight * slope * intercept).sum()
    squares = total * (1.0 + mean_slope * mean_slope) + spread
    if total * spread <= (PARALLEL * squares) ** 2:
        return parallel
    z = -shared / spread
    return parallel if z >= pixels.least_z else np.array([0.0, mean_intercept + mean_slope * z, z])


class _PixelLines(NamedTuple):
    """Sums over some profiles of what each pixel measured, (pixels,), in mm.

    n: number of points; mean_y, mean_z: their means; spread, shared: sums of dz^2 and dy dz about
    them.  least_z: the least depth of these points.
    """

    n: FloatArray
    mean_y: FloatArray
    mean_z: FloatArray
    spread: FloatArray
    shared: FloatArray
    least_z: float


@compiled
def _pixel_lines(
    points: FloatArray, usable: BoolArray, lean: FloatArray, stride: int
) -> _PixelLines:
    """The lines of all pixels, from every stride-th profile."""
    n_pixels = points.shape[1]
    n, first_y, first_z = np.zeros(n_pixels), np.zeros(n_pixels), np.zeros(n_pixels)
    sum_y, sum_z, sum_zz, sum_yz = np.zeros((4, n_pixels))
    least_z = np.inf
    for p in range(0, points.shape[0], stride):
        for u in range(n_pixels):
            if not usable[p, u]:
                continue
            x, y, z = points[p, u]
            y, z = y - lean[0] * x, z - lean[1] * x
            least_z = min(least_z, z)
            if n[u] == 0.0:
                first_y[u], first_z[u] = y, z
            # About the first of a pixel's points, so that small spreads keep their digits.
            dy, dz = y - first_y[u], z - first_z[u]
            n[u] += 1.0
            sum_y[u] += dy
            sum_z[u] += dz
            sum_zz[u] += dz * dz
            sum_yz[u] += dy * dz
    mean_y, mean_z = np.empty(n_pixels), np.empty(n_pixels)
    for u in range(n_pixels):
        dy, dz = sum_y[u] / max(n[u], 1.0), sum_z[u] / max(n[u], 1.0)
        mean_y[u], mean_z[u] = first_y[u] + dy, first_z[u] + dz
        sum_zz[u] -= dz * sum_z[u]
        sum_yz[u] -= dy * sum_z[u]
    return _PixelLines(n, mean_y, mean_z, sum_zz, sum_yz, least_z)
