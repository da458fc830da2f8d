"""The points of a scan gathered by label, so that each plane's lie side by side in memory."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from registration.gauss_sphere.beams import Fan
from registration.gauss_sphere.calibrated import DEPTH, MEASURED, SIGMA, SLOPE, X
from registration.kernels import compiled
from registration.scan import FloatArray, IndexArray, IntArray


class Gathered(NamedTuple):
    """All labelled points (n,), label by label.

    start: (labels + 1,) the first point of each label.  place: (n,) where in the scan, profile by
    profile, a point lies.  beams: (5 n,) a block (5, points) a label, as beams_of gives it.
    """

    start: IntArray
    place: IndexArray
    beams: FloatArray


@compiled
def gathered(fan: Fan, measured: FloatArray, label: IndexArray, n_labels: int) -> Gathered:
    """Gather the labelled points of a scan; measured: (profiles, pixels) depths as measured."""
    start = np.zeros(n_labels + 1, np.int64)
    of_point = label.reshape(-1)
    for i in of_point:
        if i >= 0:
            start[i + 1] += 1
    for i in range(n_labels):
        start[i + 1] += start[i]
    filled, n_pixels = start[:-1].copy(), label.shape[1]
    place, beams = np.empty(start[-1], np.int32), np.empty(5 * start[-1])
    slope, depth, sigma = fan.slope.reshape(-1), fan.depth_mm.reshape(-1), fan.sigma_mm.reshape(-1)
    all_measured = measured.reshape(-1)
    for p in range(label.shape[0]):
        for j in range(p * n_pixels, (p + 1) * n_pixels):
            i = of_point[j]
            if i < 0:
                continue
            k, n = filled[i], start[i + 1] - start[i]
            at = 4 * start[i] + k
            beams[at + X * n], beams[at + SLOPE * n], beams[at + DEPTH * n] = (
                fan.x_mm[p], slope[j], depth[j],
            )  # fmt: skip
            beams[at + SIGMA * n], beams[at + MEASURED * n] = sigma[j], all_measured[j]
            place[k] = j
            filled[i] = k + 1
    return Gathered(start, place, beams)


@compiled
def beams_of(points: Gathered, i: int) -> FloatArray:
    """(5, n) position, slope, depth, standard deviation and measured depth of a label's points."""
    a, b = points.start[i], points.start[i + 1]
    return points.beams[5 * a : 5 * b].reshape(5, b - a)
