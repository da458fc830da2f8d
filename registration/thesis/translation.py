"""Translation by the densest shifts between centroids (sections 4.3.2, 5.7 and 6.6)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from registration.scan import BoolArray, FloatArray, IntArray
from registration.thesis.gauss_sphere import GaussSphere
from registration.thesis.params import TranslationParams
from registration.thesis.patches import Patches

# Root mean square component of the normals below which planes are taken to say nothing.
TURNED_AWAY = 0.05


@dataclass(frozen=True)
class Shifts:
    """All shifts that would lay a source centroid on a target centroid of like orientation.

    values_mm: (m, 3) cp - R cp' (4-25); weights: (m,) used in the average.
    patch_pairs: (m, 2) target and source patch.
    chosen: (m,) True in the region of maximum occurrence; box_mm: (2, 3) its lower and upper
        corner (for a ball, of the box around it).
    """

    values_mm: FloatArray
    weights: FloatArray
    patch_pairs: IntArray
    chosen: BoolArray
    box_mm: FloatArray

    @property
    def agreeing(self) -> int:
        """Number of different patches, in the view that has fewer, behind the chosen shifts."""
        pairs = self.patch_pairs[self.chosen]
        return min(len(np.unique(pairs[:, 0])), len(np.unique(pairs[:, 1])))


def oriented_pairs(target: GaussSphere, source: GaussSphere, normal_matches: IntArray) -> IntArray:
    """(m, 2) every target patch with every source patch whose normals correspond."""
    pairs = [
        np.stack(np.meshgrid(*members, indexing="ij"), axis=-1).reshape(-1, 2)
        for members in (
            (np.flatnonzero(target.member == i), np.flatnonzero(source.member == j))
            for i, j in normal_matches
        )
    ]
    return np.concatenate(pairs) if pairs else np.zeros((0, 2), dtype=np.int64)


def estimate_translation(
    target: Patches,
    source: Patches,
    patch_pairs: IntArray,
    R_target_source: FloatArray,
    params: TranslationParams,
) -> tuple[FloatArray | None, Shifts]:
    """Average the shifts in the region of maximum occurrence, for a given rotation.

    patch_pairs: (m, 2) as of oriented_pairs. Returns (3,) mm, or None when there are no shifts, or
    when the three densest intervals of "per_axis" have none in common. Sections 5.7 and 6.6;
    weights by (4-27), where (4-28) is a ratio of areas.
    """
    i, j = patch_pairs[:, 0], patch_pairs[:, 1]
    values = target.centroid_mm[i] - source.centroid_mm[j] @ R_target_source.T
    if params.area_ratio_weights:
        a, b = target.area_mm2[i], source.area_mm2[j]
        weights = np.minimum(a, b) / np.maximum(a, b)
    else:
        weights = np.ones(len(values))
    if params.density == "per_axis":
        chosen, box = densest_box(values, weights, params.window_mm)
    elif params.density == "3d":
        chosen, box = densest_ball(values, weights, params.window_mm)
    else:
        chosen, box = densest_nested(values, weights, params.window_mm, params.levels)
    shifts = Shifts(values, weights, patch_pairs, chosen, box)
    if not chosen.any():
        return None, shifts
    mean = np.average(values[chosen], axis=0, weights=weights[chosen])
    if params.estimate == "plane_distances":
        normal = target.normal[i[chosen]] + source.normal[j[chosen]] @ R_target_source.T
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        mean = shift_between_planes(normal, values[chosen], weights[chosen], mean)
    return mean, shifts


def shift_between_planes(
    normal: FloatArray, values_mm: FloatArray, weights: FloatArray, start_mm: FloatArray
) -> FloatArray:
    """Find the shift that lays planes on each other, nearest to a given one where they leave it.

    normal: (m, 3) unit, common to both planes of a pair. values_mm: (m, 3) from any point of the
        source's plane, turned, to any of the target's. weights: (m,). start_mm: (3,).
    Least squares of n . (value - t), section 6.6. The distances are taken between the centroids,
    not from the origin: a metre away, an error of the rotation would move the planes. Along a
    direction that all planes share, or nearly so (TURNED_AWAY), start_mm stays.
    """
    root = np.sqrt(weights)[:, None]
    gaps = np.einsum("mj,mj->m", normal, values_mm - start_mm)
    U, spread, Vt = np.linalg.svd(root * normal, full_matrices=False)
    told = spread > TURNED_AWAY * np.sqrt(weights.sum())
    along = (U.T @ (root[:, 0] * gaps))[told] / spread[told]
    shift: FloatArray = start_mm + along @ Vt[told]
    return shift


def densest_box(
    values_mm: FloatArray, weights: FloatArray, window_mm: float
) -> tuple[BoolArray, FloatArray]:
    """Unite the densest interval of each axis, each found on its own, into a box.

    Returns (m,) which shifts lie within, possibly none, and the (2, 3) corners. Ties go to the
    larger weight, then to the narrower interval, which the thesis leaves open.
    """
    if len(values_mm) == 0:
        return np.zeros(0, dtype=bool), np.full((2, 3), np.nan)
    box = np.empty((2, 3))
    for axis in range(3):
        order = np.argsort(values_mm[:, axis], kind="stable")
        sorted_mm = values_mm[order, axis]
        heft = np.concatenate([[0.0], np.cumsum(weights[order])])
        first = np.arange(len(order))
        stop = np.searchsorted(sorted_mm, sorted_mm + window_mm, side="right")
        width = sorted_mm[stop - 1] - sorted_mm
        best = np.lexsort((width, -np.round(heft[stop] - heft[first], 9), first - stop))[0]
        box[:, axis] = sorted_mm[best], sorted_mm[stop[best] - 1]
    return ((values_mm >= box[0]) & (values_mm <= box[1])).all(axis=1), box


def densest_ball(
    values_mm: FloatArray, weights: FloatArray, window_mm: float
) -> tuple[BoolArray, FloatArray]:
    """Find the shift with the most others within half the window in 3D (section 6.6).

    Returns (m,) which shifts lie in that ball, and the (2, 3) corners of the box around it. Ties
    go to the larger weight within the ball.
    """
    if len(values_mm) == 0:
        return np.zeros(0, dtype=bool), np.full((2, 3), np.nan)
    tree = cKDTree(values_mm)
    # A hair more than half the window, so that rounding cannot decide about a shift on the rim.
    radius = 0.5 * window_mm * (1.0 + 1e-9)
    counts = tree.query_ball_point(values_mm, radius, return_length=True)
    fullest = np.flatnonzero(counts == counts.max())
    neighbours = tree.query_ball_point(values_mm[fullest], radius)
    heft = [round(float(weights[inside].sum()), 9) for inside in neighbours]
    best = int(np.argmax(heft))
    chosen = np.zeros(len(values_mm), dtype=bool)
    chosen[neighbours[best]] = True
    centre = values_mm[fullest[best]]
    return chosen, np.stack([centre - 0.5 * window_mm, centre + 0.5 * window_mm])


def densest_nested(
    values_mm: FloatArray, weights: FloatArray, window_mm: float, levels: int
) -> tuple[BoolArray, FloatArray]:
    """Find the densest ball of 2^levels windows, in it the densest half as wide, and so on.

    Ends at the window; returns (m,) and (2, 3) as densest_ball. Chapter 7's hierarchical location:
    a wide ball counts the shifts that a small one would miss as the noise scatters them.
    """
    inside = np.arange(len(values_mm))
    box = np.full((2, 3), np.nan)
    for level in range(levels, -1, -1):
        within, box = densest_ball(values_mm[inside], weights[inside], window_mm * 2.0**level)
        inside = inside[within]
    chosen = np.zeros(len(values_mm), dtype=bool)
    chosen[inside] = True
    return chosen, box
