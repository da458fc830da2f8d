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

from registration.gauss_sphere.beams import Fan
from registration.gauss_sphere.params import VerificationParams
from registration.gauss_sphere.patches import Patches
from registration.kernels import compiled
from registration.scan import FloatArray, IntArray

SUPPORT, CONTRADICTION, HIDDEN, OUTSIDE = range(4)
GOLDEN_RATIO = 0.6180339887498949


class View(NamedTuple):
    """A scan ready to be compared: its image of patches and a sample of its points.

    pixel_of: (cells,) pixel of each cell of slope; slope_low, cells_per_slope: where they lie.
    nearest_mm: (profiles, pixels) smallest depth in the 3 x 3 neighbourhood, NaN where one of it
        is missing.
    sample_mm: (n, 3) points on the patches, in random order; sample_patch: (n,) theirs;
    sample_area: (n,) mm^2 that each stands for.
    """

    fan: Fan
    patches: Patches
    pixel_of: IntArray
    slope_low: float
    cells_per_slope: float
    nearest_mm: FloatArray
    sample_mm: FloatArray
    sample_patch: IntArray
    sample_area: FloatArray


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


def view_of(fan: Fan, patches: Patches, params: VerificationParams) -> View:
    """Prepare a scan for verification."""
    pixel_of, slope_low, cells_per_slope = _slope_table(fan.column_slope)
    nearest = np.empty_like(fan.depth_mm)
    _nearest(fan.depth_mm, nearest)
    profile, pixel = np.nonzero(patches.label >= 0)
    n = min(params.samples, profile.size)
    chosen = np.arange(n) * profile.size // max(n, 1)
    # In an order whose every stride is spread over the scan, so that a part of them will do.
    chosen = chosen[np.argsort(np.arange(n) * GOLDEN_RATIO % 1.0, kind="stable")]
    profile, pixel = profile[chosen], pixel[chosen]
    patch = patches.label[profile, pixel]
    points = _feet(fan, patches, profile, pixel, patch)
    sampled = np.bincount(patch, minlength=patches.n_points.size)
    area = patches.area_mm2[patch] / np.maximum(sampled, 1)[patch]
    return View(
        fan, patches, pixel_of, slope_low, cells_per_slope, nearest, points, patch, area
    )  # fmt: skip


def _feet(
    fan: Fan, patches: Patches, profile: IntArray, pixel: IntArray, patch: IntArray
) -> FloatArray:
    """Where the beams meet their patches: one point's noise would only blur the comparison."""
    slope = fan.slope[profile, pixel]
    normal = patches.normal[patch]
    origin = np.tile(fan.apex_mm, (slope.size, 1))
    origin[:, 0] = fan.x_mm[profile]
    origin[:, 1:] += fan.x_mm[profile][:, None] * fan.lean
    along = normal[:, 1] * slope + normal[:, 2]
    depth = (patches.offset_mm[patch] - np.einsum("ij,ij->i", normal, origin)) / along
    points: FloatArray = origin + np.stack([np.zeros_like(depth), slope * depth, depth], axis=1)
    return points


def _slope_table(column_slope: FloatArray) -> tuple[IntArray, float, float]:
    known = np.flatnonzero(np.isfinite(column_slope))
    order = known[np.argsort(column_slope[known], kind="stable")]
    slopes = column_slope[order]
    if known.size < 2 or slopes[-1] == slopes[0]:
        return np.full(1, -1, dtype=np.int64), 0.0, 0.0
    gap = (slopes[-1] - slopes[0]) / (known.size - 1)
    low, high = slopes[0] - 0.5 * gap, slopes[-1] + 0.5 * gap
    cells = 8 * column_slope.size
    centre = low + (np.arange(cells) + 0.5) * (high - low) / cells
    upper = np.clip(np.searchsorted(slopes, centre), 1, slopes.size - 1)
    nearer = np.where(centre - slopes[upper - 1] < slopes[upper] - centre, upper - 1, upper)
    return order[nearer], float(low), float(cells / (high - low))


def rank(
    target: View,
    source: View,
    rotations: FloatArray,
    shifts_mm: FloatArray,
    tolerance_mm: float,
    stride: int,
    params: VerificationParams,
) -> FloatArray:
    """(c, 4) mean area in mm^2, over both views, of support, contradiction, hidden and outside."""
    areas = np.zeros((rotations.shape[0], 4))
    _rank(
        target, source, comparison(params), rotations, shifts_mm, tolerance_mm, stride, areas
    )  # fmt: skip
    return areas


@compiled
def _rank(
    target: View,
    source: View,
    how: Comparison,
    rotations: FloatArray,
    shifts: FloatArray,
    tolerance: float,
    stride: int,
    areas: FloatArray,
) -> None:
    counts = np.zeros((target.patches.n_points.size, source.patches.n_points.size), np.int64)
    for c in range(rotations.shape[0]):
        compare_both(
            target, source, how, rotations[c], shifts[c], tolerance, stride, counts, areas[c]
        )


@compiled
def compare_both(
    target: View,
    source: View,
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
    for u in range(4):
        areas[u] *= 0.5 * stride


@compiled
def _compare(
    seen_by: View,
    points_of: View,
    how: Comparison,
    r: FloatArray,
    t: FloatArray,
    tolerance: float,
    stride: int,
    counts: IntArray,
    areas: FloatArray,
) -> None:
    x, apex, depth = seen_by.fan.x_mm, seen_by.fan.apex_mm, seen_by.fan.depth_mm
    lean_y, lean_z = seen_by.fan.lean
    label, nearest = seen_by.patches.label, seen_by.nearest_mm
    normal, offset = seen_by.patches.normal, seen_by.patches.offset_mm
    source_normal = points_of.patches.normal
    rows = x.size
    step = (x[rows - 1] - x[0]) / max(rows - 1, 1)
    turned = np.empty_like(source_normal)
    for k in range(source_normal.shape[0]):
        for u in range(3):
            turned[k, u] = (
                r[u, 0] * source_normal[k, 0]
                + r[u, 1] * source_normal[k, 1]
                + r[u, 2] * source_normal[k, 2]
            )
    for j in range(0, points_of.sample_area.size, stride):
        px, py, pz = points_of.sample_mm[j]
        area = points_of.sample_area[j]
        wx = r[0, 0] * px + r[0, 1] * py + r[0, 2] * pz + t[0]
        wy = r[1, 0] * px + r[1, 1] * py + r[1, 2] * pz + t[1]
        wz = r[2, 0] * px + r[2, 1] * py + r[2, 2] * pz + t[2]
        z = wz - lean_z * wx - apex[2]  # as the profile through the point sees it
        row, pixel = -1, -1
        if z > 1.0 and step != 0.0:
            row = int(np.floor((wx - x[0]) / step + 0.5))
            position = (
                (wy - lean_y * wx - apex[1]) / z - seen_by.slope_low
            ) * seen_by.cells_per_slope
            if 0.0 <= position < seen_by.pixel_of.size:
                pixel = seen_by.pixel_of[int(position)]
        if row < 0 or row >= rows or pixel < 0:
            areas[OUTSIDE] += area
            continue
        i, k = label[row, pixel], points_of.sample_patch[j]
        if i >= 0:
            n = normal[i]
            away = n[0] * wx + n[1] * wy + n[2] * wz - offset[i]
            cos = n[0] * turned[k, 0] + n[1] * turned[k, 1] + n[2] * turned[k, 2]
            if abs(away) < tolerance and cos > how.cos_tolerance:
                areas[SUPPORT] += area
                counts[i, k] += 1
                continue
        if z < nearest[row, pixel] - how.free_space_mm - tolerance:
            areas[CONTRADICTION] += area
        elif z > depth[row, pixel] + tolerance:
            areas[HIDDEN] += area
        else:
            areas[OUTSIDE] += area


@compiled
def _nearest(depth: FloatArray, nearest: FloatArray) -> None:
    rows, columns = depth.shape
    nearest[:] = np.nan
    for p in range(1, rows - 1):
        for u in range(1, columns - 1):
            smallest = depth[p, u]
            for dp in range(-1, 2):
                for du in range(-1, 2):
                    d = depth[p + dp, u + du]
                    # Not smaller also where d is missing: then nothing is known of free space.
                    if not d >= smallest:
                        smallest = d
            nearest[p, u] = smallest
