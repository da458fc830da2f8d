"""Kernels of the rotation search: equal triplets of normals, and the overlap of two spheres."""

from __future__ import annotations

import numpy as np

from registration.kernels import compiled
from registration.scan import BoolArray, FloatArray, IntArray


@compiled
def angle_table(direction: FloatArray) -> FloatArray:
    """(k, k) angles in rad between unit normals, by atan2, which keeps small angles."""
    k = len(direction)
    table = np.zeros((k, k))
    for i in range(k):
        for j in range(i):
            a, b = direction[i], direction[j]
            cross = np.cross(a, b)
            table[i, j] = np.arctan2(np.sqrt((cross**2).sum()), (a * b).sum())
            table[j, i] = table[i, j]
    return table


@compiled
def degenerate(a: float, b: float, c: float, tolerance: float) -> bool:
    """Tell whether three normals with these angles lie in one plane.

    The check of section 5.6 (one angle is the sum of the others), and its counterpart for normals
    all around a circle, whose angles add up to a full turn.
    """
    largest = max(a, b, c)
    total = a + b + c
    return total - 2.0 * largest <= tolerance or 2.0 * np.pi - total <= tolerance


@compiled
def count_triplets(table: FloatArray, tolerance: float) -> int:
    """Number of non-degenerate triplets of normals."""
    n = 0
    for i in range(len(table)):
        for j in range(i):
            for k in range(j):
                if not degenerate(table[i, j], table[i, k], table[j, k], tolerance):
                    n += 1
    return n


@compiled
def _handedness(d: FloatArray, i: int, j: int, k: int) -> float:
    return float((np.cross(d[i], d[j]) * d[k]).sum())


@compiled
def _ratio(a: float, b: float) -> float:
    return min(a, b) / max(a, b)


@compiled
def equal_distances(
    target_mm: FloatArray,
    target_member: IntArray,
    source_mm: FloatArray,
    source_member: IntArray,
    left: FloatArray,
    right: FloatArray,
    angle_tolerance: float,
    distance_tolerance: float,
) -> BoolArray:
    """(k, k, l, l) whether patches of two target and of two source normals can be as far apart.

    target_mm, source_mm: centroids; target_member, source_member: the normal of each. left, right:
    the angle tables, as only normals at equal angles are looked at.
    """
    like = np.zeros((len(left), len(left), len(right), len(right)), dtype=np.bool_)
    between = np.empty((len(source_mm), len(source_mm)))
    for c in range(len(source_mm)):
        for d in range(len(source_mm)):
            between[c, d] = np.sqrt(((source_mm[c] - source_mm[d]) ** 2).sum())
    for a in range(len(target_mm)):
        i = target_member[a]
        for b in range(len(target_mm)):
            j = target_member[b]
            if i <= j or i >= len(left):
                continue
            distance = np.sqrt(((target_mm[a] - target_mm[b]) ** 2).sum())
            for c in range(len(source_mm)):
                p = source_member[c]
                for d in range(len(source_mm)):
                    q = source_member[d]
                    if (
                        p != q
                        and p < len(right)
                        and q < len(right)
                        and abs(between[c, d] - distance) <= distance_tolerance
                        and abs(right[p, q] - left[i, j]) <= angle_tolerance
                    ):
                        like[i, j, p, q] = True
    return like


@compiled
def equal_triplets(
    target: FloatArray,
    target_weight: FloatArray,
    source: FloatArray,
    source_weight: FloatArray,
    tolerance: float,
    keep: int,
    min_ratio: float,
    like: BoolArray,
) -> IntArray:
    """Find the triplets of two spheres with the same three angles and the same handedness.

    Returns (h, 6): three target normals and the corresponding three source normals, the heaviest
    `keep` of them (sum of the smaller weight of each pair), heaviest first. Mirrored triplets have
    the same angles too: their rotation would have determinant -1, so they are left out here.
    min_ratio: paired normals weigh at least this share of each other. like: as of equal_distances,
        or of no size for any.
    """
    any_distance = like.size == 0
    left = angle_table(target)
    right = angle_table(source)
    rows = np.empty((2 * keep, 6), dtype=np.int64)
    heft = np.empty(2 * keep)
    n = 0
    for i in range(len(left)):
        for j in range(i):
            for k in range(j):
                if degenerate(left[i, j], left[i, k], left[j, k], tolerance):
                    continue
                hand = _handedness(target, i, j, k)
                for p in range(len(right)):
                    if _ratio(target_weight[i], source_weight[p]) < min_ratio:
                        continue
                    for q in range(len(right)):
                        if (
                            q == p
                            or abs(right[p, q] - left[i, j]) > tolerance
                            or _ratio(target_weight[j], source_weight[q]) < min_ratio
                            or not (any_distance or like[i, j, p, q])
                        ):
                            continue
                        for r in range(len(right)):
                            if (
                                r in (p, q)
                                or abs(right[p, r] - left[i, k]) > tolerance
                                or abs(right[q, r] - left[j, k]) > tolerance
                                or _ratio(target_weight[k], source_weight[r]) < min_ratio
                                or not (any_distance or (like[i, k, p, r] and like[j, k, q, r]))
                                or _handedness(source, p, q, r) * hand <= 0.0
                                or degenerate(right[p, q], right[p, r], right[q, r], tolerance)
                            ):
                                continue
                            rows[n] = np.array([i, j, k, p, q, r])
                            heft[n] = (
                                min(target_weight[i], source_weight[p])
                                + min(target_weight[j], source_weight[q])
                                + min(target_weight[k], source_weight[r])
                            )
                            n += 1
                            if n == 2 * keep:
                                order = np.argsort(-heft, kind="mergesort")[:keep]
                                rows[:keep] = rows[order]
                                heft[:keep] = heft[order]
                                n = keep
    order = np.argsort(-heft[:n], kind="mergesort")[:keep]
    return rows[:n][order]


@compiled
def matched_normals(
    target: FloatArray, source: FloatArray, R: FloatArray, tolerance: float
) -> IntArray:
    """(len(target),) the source normal that each target normal overlaps, or -1.

    They overlap when R source is within the tolerance and each is the other's nearest, so no
    normal counts twice and exchanging the spheres changes nothing.
    """
    turned = np.empty_like(source)
    for j in range(len(source)):
        for c in range(3):
            turned[j, c] = R[c, 0] * source[j, 0] + R[c, 1] * source[j, 1] + R[c, 2] * source[j, 2]
    limit = 2.0 * np.sin(0.5 * tolerance)
    forward = np.full(len(target), -1, dtype=np.int64)
    backward = np.full(len(source), -1, dtype=np.int64)
    near_target = np.full(len(target), limit * limit)
    near_source = np.full(len(source), limit * limit)
    for i in range(len(target)):
        for j in range(len(source)):
            d = (
                (target[i, 0] - turned[j, 0]) ** 2
                + (target[i, 1] - turned[j, 1]) ** 2
                + (target[i, 2] - turned[j, 2]) ** 2
            )
            if d <= near_target[i]:
                near_target[i] = d
                forward[i] = j
            if d <= near_source[j]:
                near_source[j] = d
                backward[j] = i
    for i in range(len(target)):
        if forward[i] >= 0 and backward[forward[i]] != i:
            forward[i] = -1
    return forward


@compiled
def overlaps(
    target: FloatArray,
    target_weight: FloatArray,
    source: FloatArray,
    source_weight: FloatArray,
    R: FloatArray,
    tolerance: float,
) -> FloatArray:
    """(h, 2) for each rotation: overlap of the normals (4-5), and their mean squared chord.

    R: (h, 3, 3). The overlap is in units of the weights.
    """
    scores = np.zeros((len(R), 2))
    for h in range(len(R)):
        match = matched_normals(target, source, R[h], tolerance)
        for i in range(len(target)):
            if match[i] >= 0:
                w = min(target_weight[i], source_weight[match[i]])
                chord = 0.0
                for c in range(3):
                    turned = 0.0
                    for e in range(3):
                        turned += R[h, c, e] * source[match[i], e]
                    chord += (target[i, c] - turned) ** 2
                scores[h, 0] += w
                scores[h, 1] += w * chord
        if scores[h, 0] > 0.0:
            scores[h, 1] /= scores[h, 0]
    return scores
