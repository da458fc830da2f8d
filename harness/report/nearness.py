"""How far the points of one scan lie from the surface that another scan measured."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from registration.scan import FloatArray

NEIGHBOURS = 9
REACH_MM = 15.0  # beyond it the other view measured nothing there


def surface_distance(points_mm: FloatArray, other_mm: FloatArray) -> FloatArray:
    """(n,) distance in mm of points (n, 3) to the other's (m, 3) surface; NaN where it has none.

    The surface at a point is the plane through its nearest measurements, so that the gaps between
    those, some mm wide, do not count as distance.
    """
    distance = np.full(len(points_mm), np.nan)
    if len(points_mm) == 0 or len(other_mm) < NEIGHBOURS:
        return distance
    found = cKDTree(other_mm).query(points_mm, k=NEIGHBOURS, distance_upper_bound=2.0 * REACH_MM)
    away, nearest = (np.asarray(part) for part in found)
    reached = np.isfinite(away).all(axis=1) & (away[:, 0] <= REACH_MM)
    patch = other_mm[nearest[reached]]
    centre = patch.mean(axis=1)
    offset = patch - centre[:, None]
    _, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", offset, offset))
    distance[reached] = np.abs(np.einsum("ni,ni->n", points_mm[reached] - centre, axes[:, :, 0]))
    return distance
