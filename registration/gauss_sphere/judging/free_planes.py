"""Planes of one view that a pose puts, whole, where the other view saw free space.

A pose that is a period off, or slid along a few planes, may share much surface and put little of it
in free space, and yet a whole plane: the side of a thing that stands elsewhere. Of a right pose no
plane does: what both views see of it lies on the other's, and the rest hidden or beside its fan.
"""

from __future__ import annotations

import numpy as np

from registration.gauss_sphere.judging.decision import Verdict, judge
from registration.gauss_sphere.params import GaussSphereParams
from registration.gauss_sphere.refinement.matching import Settled
from registration.gauss_sphere.refinement.verification import Comparison, comparison, move
from registration.gauss_sphere.view import NEAREST, PATCH, Seen, View, beams_at
from registration.kernels import compiled
from registration.scan import FloatArray, IntArray

# Samples of a plane that say it, and their share; the share of those on surface, at most. Of
# 1,315 true poses, of pairs that are measured nowhere else, none had such a plane.
LEAST_SAMPLES, LEAST_FREE, MOST_ON = 6, 0.7, 0.1
ON, FREE = range(2)


def judged_by_free_planes(
    settled: list[Settled],
    target: View,
    source: View,
    params: GaussSphereParams,
    appeal: bool = False,
) -> tuple[list[Settled], Verdict]:
    """Judge poses; if several could be, only those that put no plane where nothing was seen."""
    verdict = judge(settled, target, source, params.decision, appeal)
    if verdict.status != "ambiguous":
        return settled, verdict
    best, *others = settled
    left = [best, *without_free_planes(others, best, target, source, params)]
    return left, judge(left, target, source, params.decision, appeal)


def without_free_planes(
    poses: list[Settled], best: Settled, target: View, source: View, params: GaussSphereParams
) -> list[Settled]:
    """The poses that put no plane where nothing was seen.

    All of them if the best does: then a thing was moved between the scans, and says nothing.
    """
    if has_free_plane(best, target, source, params):
        return poses
    return [pose for pose in poses if not has_free_plane(pose, target, source, params)]


def has_free_plane(pose: Settled, target: View, source: View, params: GaussSphereParams) -> bool:
    """Whether a pose puts a plane of either view where the other saw that there is nothing."""
    how, tolerance_mm = comparison(params.verification), params.match.tolerances_mm[-1]
    return bool(
        _has_free_plane(target.seen, source.seen, how, pose.rotation, pose.shift_mm, tolerance_mm)
    )


@compiled
def _has_free_plane(
    target: Seen, source: Seen, how: Comparison, r: FloatArray, t: FloatArray, tolerance_mm: float
) -> bool:
    back_r, back_t = r.T.copy(), np.zeros(3)
    for u in range(3):
        for v in range(3):
            back_t[u] -= back_r[u, v] * t[v]
    of_source = _what_lies_where(target, source, how, r, t, tolerance_mm)
    of_target = _what_lies_where(source, target, how, back_r, back_t, tolerance_mm)
    return _any_free(source, of_source) or _any_free(target, of_target)


@compiled
def _any_free(points_of: Seen, counts: IntArray) -> bool:
    every = np.bincount(points_of.sample_patch, minlength=counts.shape[0])
    for k in range(counts.shape[0]):
        free, on = counts[k, FREE], counts[k, ON]
        if free >= max(LEAST_SAMPLES, LEAST_FREE * every[k]) and on <= MOST_ON * every[k]:
            return True
    return False


@compiled
def _what_lies_where(
    seen_by: Seen, points_of: Seen, how: Comparison, r: FloatArray, t: FloatArray, tolerance: float
) -> IntArray:
    """(m, 2) samples of each plane of points_of that lie on the other view's, and in its space.

    Both as in the comparison of poses: see verification.py.
    """
    n, turned = points_of.sample_patch.size, np.empty_like(points_of.normal)
    for k in range(turned.shape[0]):
        for u in range(3):
            turned[k, u] = 0.0
            for v in range(3):
                turned[k, u] += r[u, v] * points_of.normal[k, v]
    moved, beam = np.empty((6, n)), np.empty(n, np.int64)
    move(points_of.sample_mm, r, t, moved)
    beams_at(seen_by, moved, beam)
    counts = np.zeros((turned.shape[0], 2), np.int64)
    for j in range(n):
        if beam[j] < 0:
            continue
        i, k = int(seen_by.image[beam[j], PATCH]), points_of.sample_patch[j]
        if i >= 0:
            away, cos = -seen_by.offset_mm[i], 0.0
            for u in range(3):
                away += seen_by.normal[i, u] * moved[u, j]
                cos += seen_by.normal[i, u] * turned[k, u]
            if abs(away) < tolerance and cos > how.cos_tolerance:
                counts[k, ON] += 1
                continue
        if moved[3, j] + how.free_space_mm + tolerance < seen_by.image[beam[j], NEAREST]:
            counts[k, FREE] += 1
    return counts
