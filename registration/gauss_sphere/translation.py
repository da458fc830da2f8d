"""Translation candidates for a rotation: shifts that many pairs of planes agree on."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from registration.gauss_sphere.params import TranslationParams
from registration.gauss_sphere.patches import Patches
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


def pose_candidates(
    target: Patches, source: Patches, rotations: FloatArray, params: TranslationParams
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Find for every rotation the shifts with most agreement in 3D.

    A pair of patches of like orientation fixes the shift along its normal, by the distances of the
    planes, and bounds it across, by the patches' outlines (sections 5.7 and 6.6: distances in place
    of centroids, density in 3D). Two such pairs start a shift, all that agree refine it.

    Returns (c, 3, 3) rotations, (c, 3) shifts in mm, (c,) agreeing area in mm^2, best first.
    """
    # Few rotations, as of scenes along three axes, leave the more shifts to tell apart.
    kept = max(params.kept_per_rotation, params.kept // max(rotations.shape[0], 1))
    capacity = rotations.shape[0] * kept
    out_r, out_t = np.empty((capacity, 3, 3)), np.empty((capacity, 3))
    out_score = np.empty(capacity)
    search = search_of(params, kept)
    found = _shifts(target, source, rotations, search, out_r, out_t, out_score)
    order = np.argsort(-out_score[:found], kind="stable")
    return out_r[order], out_t[order], out_score[order]


@compiled
def shifts_at(target: Patches, source: Patches, r: FloatArray, search: Search) -> FloatArray:
    """(k, 3) shifts in mm of one rotation (3, 3), as pose_candidates finds them."""
    kept = search.kept_per_rotation
    rotations, shifts = r.copy().reshape(1, 3, 3), np.empty((kept, 3))
    found = _shifts(
        target, source, rotations, search, np.empty((kept, 3, 3)), shifts, np.empty(kept)
    )
    return shifts[:found]


def search_of(params: TranslationParams, kept_per_rotation: int) -> Search:
    """The parameters as the compiled loops take them, to keep so many shifts of a rotation."""
    return Search(
        params.patches,
        math.cos(params.angle_tolerance_rad),
        params.pairs,
        params.tries,
        params.starts,
        params.distance_tolerance_mm,
        params.tilt_tolerance_rad,
        params.reach,
        params.distinct_mm,
        kept_per_rotation,
    )


@compiled
def _shifts(
    target: Patches,
    source: Patches,
    rotations: FloatArray,
    search: Search,
    out_r: FloatArray,
    out_t: FloatArray,
    out_score: FloatArray,
) -> int:
    n_a = min(target.n_points.size, search.patches)
    n_b = min(source.n_points.size, search.patches)
    na, ca, sa = target.normal[:n_a], target.centroid_mm[:n_a], target.spread_mm[:n_a]
    ea, wa = target.basis[:n_a], target.area_mm2[:n_a]
    nb, cb, sb = source.normal[:n_b], source.centroid_mm[:n_b], source.spread_mm[:n_b]
    eb, wb = source.basis[:n_b], source.area_mm2[:n_b]
    extent_a, extent_b = np.empty((n_a, 3, 3)), np.empty((n_b, 3, 3))
    unturned = np.eye(3)
    for i in range(n_a):
        _extent(unturned, ea[i], sa[i], search.reach, extent_a[i])
    kept_per_rotation = search.kept_per_rotation
    capacity = na.shape[0] * nb.shape[0]
    normal, delta = np.empty((capacity, 3)), np.empty(capacity)
    shift, inverse = np.empty((capacity, 3)), np.empty((capacity, 3, 3))
    weight, gate = np.empty(capacity), np.empty(capacity)
    mate_a, mate_b = np.empty(capacity, np.int64), np.empty(capacity, np.int64)
    t, work = np.empty(3), np.empty((3, 3))
    kept_t, kept_score = np.empty((kept_per_rotation, 3)), np.empty(kept_per_rotation)
    served = np.empty(max(na.shape[0], nb.shape[0]))
    found = 0
    for c in range(rotations.shape[0]):
        r = rotations[c]
        m = 0
        for k in range(nb.shape[0]):
            n0 = r[0, 0] * nb[k, 0] + r[0, 1] * nb[k, 1] + r[0, 2] * nb[k, 2]
            n1 = r[1, 0] * nb[k, 0] + r[1, 1] * nb[k, 1] + r[1, 2] * nb[k, 2]
            n2 = r[2, 0] * nb[k, 0] + r[2, 1] * nb[k, 1] + r[2, 2] * nb[k, 2]
            c0 = r[0, 0] * cb[k, 0] + r[0, 1] * cb[k, 1] + r[0, 2] * cb[k, 2]
            c1 = r[1, 0] * cb[k, 0] + r[1, 1] * cb[k, 1] + r[1, 2] * cb[k, 2]
            c2 = r[2, 0] * cb[k, 0] + r[2, 1] * cb[k, 1] + r[2, 2] * cb[k, 2]
            _extent(r, eb[k], sb[k], search.reach, extent_b[k])
            for i in range(na.shape[0]):
                if n0 * na[i, 0] + n1 * na[i, 1] + n2 * na[i, 2] < search.cos_tolerance:
                    continue
                d0, d1, d2 = ca[i, 0] - c0, ca[i, 1] - c1, ca[i, 2] - c2
                normal[m] = na[i]
                shift[m, 0], shift[m, 1], shift[m, 2] = d0, d1, d2
                delta[m] = na[i, 0] * d0 + na[i, 1] * d1 + na[i, 2] * d2
                weight[m] = min(wa[i], wb[k])
                mate_a[m], mate_b[m] = i, k
                # Across the normal the patches must overlap: an ellipse of both outlines.
                for u in range(3):
                    for v in range(3):
                        inverse[m, u, v] = extent_a[i, u, v] + extent_b[k, u, v]
                gate[m] = search.distance_tolerance_mm + search.tilt_tolerance_rad * np.sqrt(
                    sa[i, 0] ** 2 + sa[i, 1] ** 2 + sb[k, 0] ** 2 + sb[k, 1] ** 2
                )
                for u in range(3):
                    for v in range(3):
                        inverse[m, u, v] += na[i, u] * na[i, v] * gate[m] ** 2
                invert_symmetric3(inverse[m], inverse[m])
                m += 1
        if m == 0:
            continue
        order = np.argsort(-weight[:m], kind="mergesort")[: search.pairs]
        if order.size == 0:
            continue
        group, first = _by_direction(normal, order)
        most = np.diff(first).max()
        n_kept, n_starts, n_tries = 0, 0, 0
        # Two pairs of unlike directions at a time, by the sum of their ranks among their like.
        for total in range(2 * most - 1):
            for g in range(first.size - 1):
                for h in range(g):
                    last = min(total, first[g + 1] - first[g] - 1)
                    for one in range(max(0, total - (first[h + 1] - first[h] - 1)), last + 1):
                        p, q = group[first[g] + one], group[first[h] + total - one]
                        cos = (
                            normal[p, 0] * normal[q, 0]
                            + normal[p, 1] * normal[q, 1]
                            + normal[p, 2] * normal[q, 2]
                        )
                        if (
                            n_starts >= search.starts
                            or n_tries >= search.tries
                            or abs(cos) > PARALLEL
                            or mate_a[p] == mate_a[q]
                            or mate_b[p] == mate_b[q]
                        ):
                            continue
                        n_tries += 1
                        _fuse(shift, inverse, p, q, work, t)
                        if not (_agrees(shift, inverse, p, t) and _agrees(shift, inverse, q, t)):
                            continue
                        n_starts += 1
                        score = 0.0
                        for _ in range(2):
                            score = _refit(
                                shift, inverse, normal, delta, gate, weight, mate_b, order, t,
                                served, work,
                            )  # fmt: skip
                        n_kept = _keep(t, score, search.distinct_mm, kept_t, kept_score, n_kept)
            if n_starts >= search.starts or n_tries >= search.tries:
                break
        for j in range(n_kept):
            out_r[found] = r
            out_t[found] = kept_t[j]
            out_score[found] = kept_score[j]
            found += 1
    return found


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
def _extent(
    r: FloatArray, basis: FloatArray, spread: FloatArray, reach: float, out: FloatArray
) -> None:
    """Scatter (3, 3) in mm^2 of a patch's outline, turned."""
    out[:] = 0.0
    for w in range(2):
        size = spread[w] * reach
        x = size * (r[0, 0] * basis[w, 0] + r[0, 1] * basis[w, 1] + r[0, 2] * basis[w, 2])
        y = size * (r[1, 0] * basis[w, 0] + r[1, 1] * basis[w, 1] + r[1, 2] * basis[w, 2])
        z = size * (r[2, 0] * basis[w, 0] + r[2, 1] * basis[w, 1] + r[2, 2] * basis[w, 2])
        out[0, 0] += x * x
        out[0, 1] += x * y
        out[0, 2] += x * z
        out[1, 1] += y * y
        out[1, 2] += y * z
        out[2, 2] += z * z
    out[1, 0], out[2, 0], out[2, 1] = out[0, 1], out[0, 2], out[1, 2]


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
