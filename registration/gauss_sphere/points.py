"""The points of a scan gathered by label, so that each plane's lie side by side in memory."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from registration.gauss_sphere.beams import Fan
from registration.gauss_sphere.calibrated import DEPTH, MEASURED, SIGMA, SLOPE, X
from registration.kernels import compiled
from registration.scan import FloatArray, IndexArray, IntArray


class Labelled(NamedTuple):
    """Where the labelled points (n,) of a scan are, label by label.

    start: (labels + 1,) the first point of each label.  profile: (n,) of each point; place: (n,)
    its index in the scan, profile by profile.
    """

    start: IntArray
    profile: IndexArray
    place: IndexArray


@compiled
def labelled(label: IndexArray, n_labels: int) -> Labelled:
    """Gather the points of each label of a scan (profiles, pixels)."""
    start = np.zeros(n_labels + 1, np.int64)
    of_point, n_pixels = label.reshape(-1), label.shape[1]
    for own in of_point:
        if own >= 0:
            start[own + 1] += 1
    for i in range(n_labels):
        start[i + 1] += start[i]
    filled = start[:-1].copy()
    profile, place = np.empty(start[-1], np.int32), np.empty(start[-1], np.int32)
    for p in range(label.shape[0]):
        for j in range(p * n_pixels, (p + 1) * n_pixels):
            own = of_point[j]
            if own >= 0:
                profile[filled[own]], place[filled[own]] = p, j
                filled[own] += 1
    return Labelled(start, profile, place)


@compiled
def beams_of(fan: Fan, measured: FloatArray, points: Labelled, i: int) -> FloatArray:
    """(5, n) position, slope, depth, standard deviation and measured depth of a label's points."""
    first, beams = points.start[i], np.empty((5, points.start[i + 1] - points.start[i]))
    slope, depth, sigma = fan.slope.reshape(-1), fan.depth_mm.reshape(-1), fan.sigma_mm.reshape(-1)
    all_measured = measured.reshape(-1)
    for j in range(beams.shape[1]):
        k = points.place[first + j]
        beams[X, j], beams[SLOPE, j] = fan.x_mm[points.profile[first + j]], slope[k]
        beams[DEPTH, j], beams[SIGMA, j], beams[MEASURED, j] = depth[k], sigma[k], all_measured[k]
    return beams
