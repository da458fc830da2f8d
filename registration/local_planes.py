"""How a surface lies around each measured point, before any plane is known."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from registration.kernels import compiled
from registration.scan import FloatArray

PROFILES, PIXELS = 5, 10  # neighbours on either side that may take part
RADIUS_MM = 25.0  # and how far away they may lie
STEEPEST = 4.0  # depth over distance beyond which a neighbour is on another surface
NOISE_MM = 6.0  # and what noise may add to that
CLOSE_MM = 4.0  # largest residual with which a neighbour stays in the second fit
FEWEST = 6


class LocalPlanes(NamedTuple):
    """Planes fitted around each point, arrays (profiles, pixels), NaN without a point.

    along, across: inclination dz/dx and dz/dy.
    middle_mm, spread_mm: mean and standard deviation of y - y of the point, of those that took
        part.
    """

    along: FloatArray
    across: FloatArray
    middle_mm: FloatArray
    spread_mm: FloatArray


def local_planes(points_mm: FloatArray) -> LocalPlanes:
    """Fit a plane around each point of a scan.

    points_mm: (profiles, pixels, 3), NaN where nothing was measured.
    By least squares over the points within 25 mm, 5 profiles and 10 pixels, twice, the second time
    without what lies off the plane. Where fewer than 6 points are near, the inclination is 0;
    along X it is 0 too where there is a single profile.
    """
    return LocalPlanes(*np.moveaxis(_local_planes(np.ascontiguousarray(points_mm)), 2, 0))


@compiled
def _local_planes(points_mm: FloatArray) -> FloatArray:
    profiles, pixels = points_mm.shape[:2]
    planes = np.full((profiles, pixels, 4), np.nan)
    for k in range(profiles):
        for i in range(pixels):
            x0, y0, z0 = points_mm[k, i]
            if np.isnan(z0):
                continue
            level, along, across, middle, spread = 0.0, 0.0, 0.0, 0.0, 0.0
            for attempt in range(2):
                n, sx, sy, sz = 0, 0.0, 0.0, 0.0
                sxx, sxy, syy, sxz, syz = 0.0, 0.0, 0.0, 0.0, 0.0
                for j in range(max(k - PROFILES, 0), min(k + PROFILES + 1, profiles)):
                    for m in range(max(i - PIXELS, 0), min(i + PIXELS + 1, pixels)):
                        z = points_mm[j, m, 2] - z0
                        if np.isnan(z):
                            continue
                        x, y = points_mm[j, m, 0] - x0, points_mm[j, m, 1] - y0
                        squared = x * x + y * y
                        if squared > RADIUS_MM * RADIUS_MM:
                            continue
                        if attempt == 0:
                            if abs(z) > NOISE_MM + STEEPEST * np.sqrt(squared):
                                continue
                        elif abs(z - level - along * x - across * y) > CLOSE_MM:
                            continue
                        n += 1
                        sx += x
                        sy += y
                        sz += z
                        sxx += x * x
                        sxy += x * y
                        syy += y * y
                        sxz += x * z
                        syz += y * z
                if n < FEWEST:
                    break
                vxx, vxy, vyy = sxx - sx * sx / n, sxy - sx * sy / n, syy - sy * sy / n
                vxz, vyz = sxz - sx * sz / n, syz - sy * sz / n
                # A hair of damping: 0 along a direction in which the points do not spread.
                vxx, vyy = vxx + 1e-6, vyy + 1e-6
                determinant = vxx * vyy - vxy * vxy
                along = (vyy * vxz - vxy * vyz) / determinant
                across = (vxx * vyz - vxy * vxz) / determinant
                level = (sz - along * sx - across * sy) / n
                middle, spread = sy / n, np.sqrt(max(syy / n - (sy / n) ** 2, 0.0))
            planes[k, i, 0], planes[k, i, 1] = along, across
            planes[k, i, 2], planes[k, i, 3] = middle, spread
    return planes
