"""The points of a scan gathered by patch, so that each plane's lie side by side in memory."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from registration.gauss_sphere.beams import Fan
from registration.gauss_sphere.calibrated import DEPTH, MEASURED, SIGMA, SLOPE, X
from registration.gauss_sphere.segments import Segments
from registration.kernels import compiled
from registration.scan import FloatArray, IndexArray, IntArray


class Grouped(NamedTuple):
    """Where the points (n,) of the patches of a scan are, patch by patch.

    start: (patches + 1,) the first point of each patch, and where the last one ends.  profile: (n,)
    of each point; place: (n,) its index in the scan, profile by profile.
    """

    start: IntArray
    profile: IndexArray
    place: IndexArray


@compiled
def grouped(
    segments: Segments,
    owner: IntArray,
    n_patches: int,
    depth_mm: FloatArray,
    edge_pixels: int,
) -> Grouped:
    """Gather the measured points of each patch from its segments.

    owner: (n,) the patch of each segment, -1 for none.  edge_pixels: points at both ends of a
    segment that are left out.
    """
    first, last = segments.first + edge_pixels, segments.last - edge_pixels
    row, start = segments.profile, np.zeros(n_patches + 1, np.int64)
    for i in range(owner.size):
        if owner[i] >= 0:
            for u in range(first[i], last[i] + 1):
                start[owner[i] + 1] += np.isfinite(depth_mm[row[i], u])
    for i in range(n_patches):
        start[i + 1] += start[i]
    filled = start[:-1].copy()
    profile, place = np.empty(start[-1], np.int32), np.empty(start[-1], np.int32)
    for i in range(owner.size):
        if owner[i] < 0:
            continue
        p, n = row[i], filled[owner[i]]
        for u in range(first[i], last[i] + 1):
            if np.isfinite(depth_mm[p, u]):
                profile[n], place[n] = p, p * depth_mm.shape[1] + u
                n += 1
        filled[owner[i]] = n
    return Grouped(start, profile, place)


@compiled
def beams_of(fan: Fan, measured: FloatArray, points: Grouped, i: int) -> FloatArray:
    """(5, n) position, slope, depth, standard deviation and measured depth of a patch's points."""
    first, beams = points.start[i], np.empty((5, points.start[i + 1] - points.start[i]))
    slope, depth, sigma = fan.slope.reshape(-1), fan.depth_mm.reshape(-1), fan.sigma_mm.reshape(-1)
    all_measured = measured.reshape(-1)
    for j in range(beams.shape[1]):
        k = points.place[first + j]
        beams[X, j], beams[SLOPE, j] = fan.x_mm[points.profile[first + j]], slope[k]
        beams[DEPTH, j], beams[SIGMA, j], beams[MEASURED, j] = depth[k], sigma[k], all_measured[k]
    return beams
