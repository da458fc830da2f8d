"""Translation candidates for a rotation: shifts that many pairs of planes agree on."""

from __future__ import annotations

import math

import numpy as np

from registration.gauss_sphere.candidates.shift_search import Search, combine
from registration.gauss_sphere.params import TranslationParams
from registration.gauss_sphere.planes.patches import Patches
from registration.gauss_sphere.small_matrices import invert_symmetric3
from registration.kernels import compiled
from registration.scan import FloatArray


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
    return _best_shifts(target, source, rotations, search_of(params, kept))


@compiled
def _best_shifts(
    target: Patches, source: Patches, rotations: FloatArray, search: Search
) -> tuple[FloatArray, FloatArray, FloatArray]:
    capacity = rotations.shape[0] * search.kept_per_rotation
    out_r, out_t = np.empty((capacity, 3, 3)), np.empty((capacity, 3))
    out_score = np.empty(capacity)
    found = _shifts(target, source, rotations, search, out_r, out_t, out_score)
    best_first = np.argsort(-out_score[:found], kind="mergesort")
    return out_r[best_first], out_t[best_first], out_score[best_first]


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
    kept_t, kept_score = np.empty((kept_per_rotation, 3)), np.empty(kept_per_rotation)
    served = np.empty(nb.shape[0])
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
        n_kept = combine(
            normal, shift, inverse, delta, gate, weight, mate_a, mate_b, order, search, kept_t,
            kept_score, served,
        )  # fmt: skip
        for j in range(n_kept):
            out_r[found] = r
            out_t[found] = kept_t[j]
            out_score[found] = kept_score[j]
            found += 1
    return found


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
