"""Pairs of planes, one of each view, combined into the shifts that many of them agree on."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from registration.gauss_sphere.small_matrices import invert_symmetric3
from registration.kernels import compiled
from registration.scan import FloatArray, IntArray

PARALLEL = 0.97  # cosine between normals that fix no two directions
ONE_DIRECTION = 0.9925  # of half that angle: what is not parallel is never of one direction


class Search(NamedTuple):
    """TranslationParams as the compiled loops take them."""

    patches: int
    cos_tolerance: float
    pairs: int
    tries: int
    starts: int
    distance_tolerance_mm: float
    tilt_tolerance_rad: float
    reach: float
    distinct_mm: float
    kept_per_rotation: int


@compiled
def combine(
    normal: FloatArray,
    shift: FloatArray,
    inverse: FloatArray,
    delta: FloatArray,
    gate: FloatArray,
    weight: FloatArray,
    mate_a: IntArray,
    mate_b: IntArray,
    order: IntArray,
    search: Search,
    kept_t: FloatArray,
    kept_score: FloatArray,
    served: FloatArray,
) -> int:
    """Try two pairs of unlike directions at a time, by the sum of their ranks among their like.

    normal, shift: (m, 3) of each pair; inverse: (m, 3, 3) of how far off a shift may be; delta,
    gate: (m,) its distance along the normal and how far off, in mm; weight: (m,) in mm^2;
    mate_a, mate_b: (m,) its patches.
    order: the pairs to combine, the largest first.
    Fills in kept_t (k, 3) and kept_score (k,), best first, and returns how many are found.
    """
    group, first = _by_direction(normal, order)
    size = np.diff(first)
    t, work = np.empty(3), np.empty((3, 3))
    n_kept, n_starts, n_tries = 0, 0, 0
    for total in range(2 * size.max() - 1):
        for g in range(size.size):
            for h in range(g):
                for one in range(max(0, total - size[h] + 1), min(total + 1, size[g])):
                    p, q = group[first[g] + one], group[first[h] + total - one]
                    cos = (
                        normal[p, 0] * normal[q, 0]
                        + normal[p, 1] * normal[q, 1]
                        + normal[p, 2] * normal[q, 2]
                    )
                    if abs(cos) > PARALLEL or mate_a[p] == mate_a[q] or mate_b[p] == mate_b[q]:
                        continue
                    if n_starts >= search.starts or n_tries >= search.tries:
                        return n_kept
                    n_tries += 1
                    _fuse(shift, inverse, p, q, work, t)
                    if not (_agrees(shift, inverse, p, t) and _agrees(shift, inverse, q, t)):
                        continue
                    n_starts += 1
                    score = 0.0
                    for _ in range(2):
                        score = _refit(
                            shift, inverse, normal, delta, gate, weight, mate_b, order, t, served,
                            work,
                        )  # fmt: skip
                    n_kept = _keep(t, score, search.distinct_mm, kept_t, kept_score, n_kept)
    return n_kept


@compiled
def _by_direction(normal: FloatArray, order: IntArray) -> tuple[IntArray, IntArray]:
    """The pairs of each direction one after the other, as they were, and where each starts."""
    direction = np.empty(order.size, np.int64)
    leader = np.empty(order.size, np.int64)
    n = 0
    for j in range(order.size):
        a, g = normal[order[j]], 0
        while g < n:
            b = normal[leader[g]]
            if abs(a[0] * b[0] + a[1] * b[1] + a[2] * b[2]) > ONE_DIRECTION:
                break
            g += 1
        if g == n:
            leader[g] = order[j]
            n += 1
        direction[j] = g
    first = np.zeros(n + 1, np.int64)
    for j in range(order.size):
        first[direction[j] + 1] += 1
    first = np.cumsum(first)
    return order[np.argsort(direction, kind="mergesort")], first


@compiled
def _fuse(
    shift: FloatArray, inverse: FloatArray, p: int, q: int, total: FloatArray, t: FloatArray
) -> None:
    """The shift t on which two pairs of planes agree best.  total: (3, 3) to work in."""
    r0, r1, r2 = 0.0, 0.0, 0.0
    for v in range(3):
        one, other = shift[p, v], shift[q, v]
        r0 += inverse[p, 0, v] * one + inverse[q, 0, v] * other
        r1 += inverse[p, 1, v] * one + inverse[q, 1, v] * other
        r2 += inverse[p, 2, v] * one + inverse[q, 2, v] * other
        for u in range(3):
            total[u, v] = inverse[p, u, v] + inverse[q, u, v]
    invert_symmetric3(total, total)
    for u in range(3):
        t[u] = total[u, 0] * r0 + total[u, 1] * r1 + total[u, 2] * r2


@compiled
def _agrees(shift: FloatArray, inverse: FloatArray, p: int, t: FloatArray) -> bool:
    d0, d1, d2 = t[0] - shift[p, 0], t[1] - shift[p, 1], t[2] - shift[p, 2]
    a = inverse[p]
    return bool(
        d0 * (a[0, 0] * d0 + 2.0 * (a[0, 1] * d1 + a[0, 2] * d2))
        + d1 * (a[1, 1] * d1 + 2.0 * a[1, 2] * d2)
        + a[2, 2] * d2 * d2
        < 1.0
    )


@compiled
def _refit(
    shift: FloatArray,
    inverse: FloatArray,
    normal: FloatArray,
    delta: FloatArray,
    gate: FloatArray,
    weight: FloatArray,
    mate_b: IntArray,
    order: IntArray,
    t: FloatArray,
    served: FloatArray,
    a: FloatArray,
) -> float:
    """Least squares of the distances of all pairs that agree with t; returns their area.

    a: (3, 3) to work in.
    """
    served[:] = 0.0
    a00, a01, a02, a11, a12, a22 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    b0, b1, b2 = 0.0, 0.0, 0.0
    for o in order:
        if not _agrees(shift, inverse, o, t):
            continue
        k = mate_b[o]
        served[k] = max(served[k], weight[o])
        w = weight[o] / (gate[o] * gate[o])
        n0, n1, n2 = normal[o]
        a00 += w * n0 * n0
        a01 += w * n0 * n1
        a02 += w * n0 * n2
        a11 += w * n1 * n1
        a12 += w * n1 * n2
        a22 += w * n2 * n2
        d = w * (delta[o] - (n0 * t[0] + n1 * t[1] + n2 * t[2]))
        b0 += d * n0
        b1 += d * n1
        b2 += d * n2
    # A direction that no plane fixes stays where the outlines put it.
    ridge = 1e-3 * (a00 + a11 + a22) + 1e-12
    a[0, 0], a[0, 1], a[0, 2] = a00 + ridge, a01, a02
    a[1, 0], a[1, 1], a[1, 2] = a01, a11 + ridge, a12
    a[2, 0], a[2, 1], a[2, 2] = a02, a12, a22 + ridge
    invert_symmetric3(a, a)
    for u in range(3):
        t[u] += a[u, 0] * b0 + a[u, 1] * b1 + a[u, 2] * b2
    return float(served.sum())


@compiled
def _keep(
    t: FloatArray,
    score: float,
    distinct: float,
    kept_t: FloatArray,
    kept_score: FloatArray,
    n: int,
) -> int:
    """Keep the best scores of distinct shifts, sorted by insertion."""
    j = n
    for i in range(n):
        d0, d1, d2 = kept_t[i, 0] - t[0], kept_t[i, 1] - t[1], kept_t[i, 2] - t[2]
        if d0 * d0 + d1 * d1 + d2 * d2 < distinct * distinct:
            j = i
            break
    if j == kept_score.size:
        j -= 1  # the worst may make room
    if j < n and score <= kept_score[j]:
        return n
    n = max(n, j + 1)
    while j > 0 and kept_score[j - 1] < score:
        kept_score[j] = kept_score[j - 1]
        kept_t[j] = kept_t[j - 1]
        j -= 1
    kept_score[j] = score
    kept_t[j] = t
    return n
