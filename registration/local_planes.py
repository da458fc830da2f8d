"""How a surface lies around each measured point, before any plane is known."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from registration.kernels import compiled
from registration.scan import FloatArray

# Three fits, each to points farther around: how many profiles and pixels to either side, and
# within which distance.
PROFILES, PIXELS, RADII_MM = (2, 3, 5), (5, 8, 10), (10.0, 16.0, 25.0)
STEEPEST = 4.0  # depth over distance beyond which a neighbour of the first is on another surface
NOISE_MM = 6.0  # and what noise may add to that
CLOSE_MM = 4.0  # largest distance from the last fit with which a neighbour takes part in the next
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
    By least squares over the points within 25 mm, 5 profiles and 10 pixels, grown from fewer:
    what lies off the plane of the nearer points takes no part. Where fewer than 6 points are near,
    the inclination is 0; along X it is 0 too where there is a single profile.
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
            fitted, level, along, across, middle, spread = False, 0.0, 0.0, 0.0, 0.0, 0.0
            for attempt in range(3):
                reach, width, radius_mm = PROFILES[attempt], PIXELS[attempt], RADII_MM[attempt]
                n, sx, sy, sz = 0, 0.0, 0.0, 0.0
                sxx, sxy, syy, sxz, syz = 0.0, 0.0, 0.0, 0.0, 0.0
                for j in range(max(k - reach, 0), min(k + reach + 1, profiles)):
                    for m in range(max(i - width, 0), min(i + width + 1, pixels)):
                        z = points_mm[j, m, 2] - z0
                        if np.isnan(z):
                            continue
                        x, y = points_mm[j, m, 0] - x0, points_mm[j, m, 1] - y0
                        squared = x * x + y * y
                        if squared > radius_mm * radius_mm:
                            continue
                        if not fitted:
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
                    continue  # farther around there may be enough
                fitted = True
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
