"""The points of a scan gathered by patch, so that each plane's lie side by side in memory."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from registration.gauss_sphere.fan.beams import Fan
from registration.gauss_sphere.fan.calibrated import DEPTH, MEASURED, SIGMA, SLOPE, X
from registration.gauss_sphere.planes.segments import Segments
from registration.kernels import compiled
from registration.scan import FloatArray, IndexArray, IntArray

GOLDEN_RATIO = 0.6180339887498949


class Grouped(NamedTuple):
    """Where the points (n,) of the patches of a scan are, patch by patch.

    start, end: (patches,) the first point of each patch, and that after its last.  profile: (n,)
    of each point; place: (n,) its index in the scan, profile by profile.
    """

    start: IntArray
    end: IntArray
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
    row, end = segments.profile, np.zeros(n_patches, np.int64)
    for i in range(owner.size):
        if owner[i] >= 0:
            end[owner[i]] += max(last[i] + 1 - first[i], 0)
    # There is room for a point of every pixel; those where nothing returned leave theirs.
    n = end.sum()
    end = np.cumsum(end) - end
    start = end.copy()
    profile, place = np.empty(n, np.int32), np.empty(n, np.int32)
    for i in range(owner.size):
        if owner[i] < 0:
            continue
        p, n = row[i], end[owner[i]]
        for u in range(first[i], last[i] + 1):
            if np.isfinite(depth_mm[p, u]):
                profile[n], place[n] = p, p * depth_mm.shape[1] + u
                n += 1
        end[owner[i]] = n
    return Grouped(start, end, profile, place)


@compiled
def beams_of(fan: Fan, measured: FloatArray, points: Grouped, i: int, most: int) -> FloatArray:
    """(5, n) position, slope, depth, standard deviation and measured depth of a patch's points.

    most: of a patch with more points, as many are taken, spread over it.
    """
    first, n = points.start[i], points.end[i] - points.start[i]
    beams = np.empty((5, min(n, most)))
    slope, depth, sigma = fan.slope.reshape(-1), fan.depth_mm.reshape(-1), fan.sigma_mm.reshape(-1)
    all_measured = measured.reshape(-1)
    place, profile = points.place[first : first + n], points.profile[first : first + n]
    for j in range(beams.shape[1]):
        at = j
        if n > most:
            # Multiples of the golden ratio fall everywhere; even steps could follow one column.
            share = (j + 0.5) * GOLDEN_RATIO
            at = int((share - np.floor(share)) * n)
        # With a sign, each index would be tested for it, as those below 0 count from the end.
        k, p = np.uint64(place[at]), np.uint64(profile[at])
        beams[X, j], beams[SLOPE, j] = fan.x_mm[p], slope[k]
        beams[DEPTH, j], beams[SIGMA, j], beams[MEASURED, j] = depth[k], sigma[k], all_measured[k]
    return beams
