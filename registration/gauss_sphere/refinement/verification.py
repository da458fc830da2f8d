"""What the scans themselves say of a pose: points on the other's surfaces, points in free space.

A point moved into the other view falls on one of its beams. Where that beam measured the same
plane, the point supports the pose; where the beam passed through the point and measured something
behind it, the point contradicts the pose: it would stand in space that was seen to be empty. A
point behind a measured surface is hidden and says nothing.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from registration.gauss_sphere.params import VerificationParams
from registration.gauss_sphere.view import NEAREST, PATCH, Seen, View, beams_at
from registration.kernels import compiled
from registration.scan import FloatArray, IntArray

SUPPORT, CONTRADICTION = range(2)


class Comparison(NamedTuple):
    """VerificationParams as the compiled loops take them."""

    cos_tolerance: float
    free_space_mm: float
    contradiction_weight: float


def comparison(params: VerificationParams) -> Comparison:
    """The parameters that decide what a point says."""
    return Comparison(
        math.cos(params.normal_tolerance_rad), params.free_space_mm, params.contradiction_weight
    )


def compared(
    target: View,
    source: View,
    r: FloatArray,
    t: FloatArray,
    tolerance_mm: float,
    params: VerificationParams,
) -> tuple[FloatArray, float]:
    """What two views say of a pose p_target = r p_source + t, by all their samples.

    Returns (2,) mean area in mm^2, over both views, of support and contradiction, and the pose's
    score.
    """
    areas, how = np.empty(2), comparison(params)
    counts = np.empty((target.patches.n_points.size, source.patches.n_points.size), np.int64)
    compare_both(target.seen, source.seen, how, r, t, tolerance_mm, 1, counts, areas)
    return areas, float(score_of(how, areas))


@compiled
def score_of(how: Comparison, areas: FloatArray) -> float:
    """Support less weighted contradiction, in mm^2."""
    return float(areas[SUPPORT] - how.contradiction_weight * areas[CONTRADICTION])


@compiled
def compare_both(
    target: Seen,
    source: Seen,
    how: Comparison,
    r: FloatArray,
    t: FloatArray,
    tolerance: float,
    stride: int,
    counts: IntArray,
    areas: FloatArray,
) -> None:
    """Compare each view's samples with the other: counts (target, source) patches, mean areas."""
    back_r, back_t = r.T.copy(), np.zeros(3)
    for u in range(3):
        back_t[u] = -(back_r[u, 0] * t[0] + back_r[u, 1] * t[1] + back_r[u, 2] * t[2])
    counts[:] = 0
    areas[:] = 0.0
    _compare(target, source, how, r, t, tolerance, stride, counts, areas)
    _compare(source, target, how, back_r, back_t, tolerance, stride, counts.T, areas)
    areas[SUPPORT] *= 0.5
    areas[CONTRADICTION] *= 0.5


@compiled
def _compare(
    seen_by: Seen,
    points_of: Seen,
    how: Comparison,
    r: FloatArray,
    t: FloatArray,
    tolerance: float,
    stride: int,
    counts: IntArray,
    areas: FloatArray,
) -> None:
    image, normal, offset = seen_by.image, seen_by.normal, seen_by.offset_mm
    sample_area, sample_patch = points_of.sample_area, points_of.sample_patch
    source_normal = points_of.normal
    turned = np.empty_like(source_normal)
    for k in range(source_normal.shape[0]):
        for u in range(3):
            turned[k, u] = (
                r[u, 0] * source_normal[k, 0]
                + r[u, 1] * source_normal[k, 1]
                + r[u, 2] * source_normal[k, 2]
            )
    n = (sample_area.size + stride - 1) // stride
    moved, beam = np.empty((6, n)), np.empty(n, np.int64)
    move(points_of.sample_mm, r, t, moved)
    beams_at(seen_by, moved, beam)
    supported, contradicted = 0.0, 0.0
    for j in range(n):
        b = beam[j]
        if b < 0:
            continue
        i, k = int(image[b, PATCH]), sample_patch[j]
        if i >= 0:
            nx, ny, nz = normal[i, 0], normal[i, 1], normal[i, 2]
            away = nx * moved[0, j] + ny * moved[1, j] + nz * moved[2, j] - offset[i]
            if abs(away) < tolerance:
                cos = nx * turned[k, 0] + ny * turned[k, 1] + nz * turned[k, 2]
                if cos > how.cos_tolerance:
                    supported += sample_area[j]
                    counts[i, k] += 1
                    continue
        if moved[3, j] + how.free_space_mm + tolerance < image[b, NEAREST]:
            contradicted += sample_area[j]
    # What was looked at stands for all, the last of a stride that is not whole, too.
    each_for = sample_area.size / max(n, 1)
    areas[SUPPORT] += each_for * supported
    areas[CONTRADICTION] += each_for * contradicted


@compiled
def move(samples: FloatArray, r: FloatArray, t: FloatArray, moved: FloatArray) -> None:
    """Move the first samples (3, m) into the other view: the first rows of moved, (6, n)."""
    for u in range(3):
        rx, ry, rz, shift, out = r[u, 0], r[u, 1], r[u, 2], t[u], moved[u]
        for j in range(out.size):
            out[j] = rx * samples[0, j] + ry * samples[1, j] + rz * samples[2, j] + shift
