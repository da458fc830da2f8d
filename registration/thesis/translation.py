"""Translation by the densest shifts between centroids (sections 4.3.2, 5.7 and 6.6)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from registration.scan import BoolArray, FloatArray, IntArray
from registration.thesis.gauss_sphere import GaussSphere
from registration.thesis.params import TranslationParams
from registration.thesis.patches import Patches


@dataclass(frozen=True)
class Shifts:
    """All shifts that would lay a source centroid on a target centroid of like orientation.

    values_mm: (m, 3) cp - R cp' (4-25); weights: (m,) used in the average.
    patch_pairs: (m, 2) target and source patch.
    chosen: (m,) True in the region of maximum occurrence; box_mm: (2, 3) its lower and upper
        corner (for "3d", of the box around the ball).
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
    densest = densest_box if params.density == "per_axis" else densest_ball
    chosen, box = densest(values, weights, params.window_mm)
    shifts = Shifts(values, weights, patch_pairs, chosen, box)
    if not chosen.any():
        return None, shifts
    return np.average(values[chosen], axis=0, weights=weights[chosen]), shifts


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
