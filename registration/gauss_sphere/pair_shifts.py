"""What pairs of patches say of the shift between two views, once one is turned like the other.

A pair of like orientation fixes the shift along its normal, by the distances of the planes, and
bounds it across, by the patches' outlines (sections 5.7 and 6.6: distances in place of centroids).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from registration.gauss_sphere.patches import Patches
from registration.gauss_sphere.small_matrices import invert_symmetric3
from registration.kernels import compiled
from registration.scan import FloatArray, IntArray


class PairShifts(NamedTuple):
    """Pairs of patches that may be one plane under a rotation, (m, ...) each.

    target, source: their patches.  normal: (m, 3) the target's.  delta_mm: the shift along it.
    shift_mm: (m, 3) between the centroids.  inverse: (m, 3, 3) of the ellipsoid of shifts, in mm,
    under which distances and outlines agree.  gate_mm: its half axis along the normal.
    weight: the smaller area of the two, mm^2.
    """

    target: IntArray
    source: IntArray
    normal: FloatArray
    delta_mm: FloatArray
    shift_mm: FloatArray
    inverse: FloatArray
    gate_mm: FloatArray
    weight: FloatArray


@compiled
def room_for(capacity: int) -> PairShifts:
    """Room for so many pairs."""
    return PairShifts(
        np.empty(capacity, np.int64),
        np.empty(capacity, np.int64),
        np.empty((capacity, 3)),
        np.empty(capacity),
        np.empty((capacity, 3)),
        np.empty((capacity, 3, 3)),
        np.empty(capacity),
        np.empty(capacity),
    )


@compiled
def pair_up(
    target: Patches,
    source: Patches,
    n_target: int,
    n_source: int,
    r: FloatArray,
    cos_tolerance: float,
    distance_tolerance_mm: float,
    tilt_tolerance_rad: float,
    reach: float,
    out: PairShifts,
) -> int:
    """Pair the first patches of both views whose normals agree after the turn r; their number."""
    na, ca, ea, sa = target.normal, target.centroid_mm, target.basis, target.spread_mm
    nb, cb, eb, sb = source.normal, source.centroid_mm, source.basis, source.spread_mm
    n, c, e = np.empty(3), np.empty(3), np.empty((2, 3))
    m = 0
    for k in range(n_source):
        for u in range(3):
            n[u] = r[u, 0] * nb[k, 0] + r[u, 1] * nb[k, 1] + r[u, 2] * nb[k, 2]
            c[u] = r[u, 0] * cb[k, 0] + r[u, 1] * cb[k, 1] + r[u, 2] * cb[k, 2]
            for w in range(2):
                e[w, u] = r[u, 0] * eb[k, w, 0] + r[u, 1] * eb[k, w, 1] + r[u, 2] * eb[k, w, 2]
        for i in range(n_target):
            if n[0] * na[i, 0] + n[1] * na[i, 1] + n[2] * na[i, 2] < cos_tolerance:
                continue
            out.target[m], out.source[m] = i, k
            out.weight[m] = min(target.area_mm2[i], source.area_mm2[k])
            out.delta_mm[m] = 0.0
            for u in range(3):
                out.normal[m, u] = na[i, u]
                out.shift_mm[m, u] = ca[i, u] - c[u]
                out.delta_mm[m] += na[i, u] * out.shift_mm[m, u]
            gate = distance_tolerance_mm + tilt_tolerance_rad * np.sqrt(
                sa[i, 0] ** 2 + sa[i, 1] ** 2 + sb[k, 0] ** 2 + sb[k, 1] ** 2
            )
            out.gate_mm[m] = gate
            # Across the normal the patches must overlap: an ellipse of both outlines.
            for u in range(3):
                for v in range(3):
                    spread = 0.0
                    for w in range(2):
                        spread += ea[i, w, u] * ea[i, w, v] * sa[i, w] ** 2
                        spread += e[w, u] * e[w, v] * sb[k, w] ** 2
                    out.inverse[m, u, v] = (
                        spread * reach * reach + na[i, u] * na[i, v] * gate * gate
                    )
            invert_symmetric3(out.inverse[m], out.inverse[m])
            m += 1
    return m


@compiled
def agrees(pairs: PairShifts, p: int, t: FloatArray) -> bool:
    """Whether pair p agrees with the shift t."""
    shift, a = pairs.shift_mm, pairs.inverse[p]
    d0, d1, d2 = t[0] - shift[p, 0], t[1] - shift[p, 1], t[2] - shift[p, 2]
    return bool(
        d0 * (a[0, 0] * d0 + 2.0 * (a[0, 1] * d1 + a[0, 2] * d2))
        + d1 * (a[1, 1] * d1 + 2.0 * a[1, 2] * d2)
        + a[2, 2] * d2 * d2
        < 1.0
    )


@compiled
def fuse(pairs: PairShifts, p: int, q: int, t: FloatArray) -> None:
    """The shift t that pairs p and q make most likely."""
    shift, inverse = pairs.shift_mm, pairs.inverse
    total = inverse[p] + inverse[q]
    invert_symmetric3(total, total)
    rhs = np.empty(3)
    for u in range(3):
        rhs[u] = 0.0
        for v in range(3):
            rhs[u] += inverse[p, u, v] * shift[p, v] + inverse[q, u, v] * shift[q, v]
    for u in range(3):
        t[u] = total[u, 0] * rhs[0] + total[u, 1] * rhs[1] + total[u, 2] * rhs[2]


@compiled
def refit(pairs: PairShifts, order: IntArray, t: FloatArray, served: FloatArray) -> float:
    """Least squares of the distances of all pairs that agree with t; returns their area.

    order: the pairs that are looked at.  served: (patches of the source,) to work in.
    """
    served[:] = 0.0
    a00, a01, a02, a11, a12, a22 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    b0, b1, b2 = 0.0, 0.0, 0.0
    for o in order:
        if not agrees(pairs, o, t):
            continue
        k = pairs.source[o]
        served[k] = max(served[k], pairs.weight[o])
        w = pairs.weight[o] / (pairs.gate_mm[o] * pairs.gate_mm[o])
        n0, n1, n2 = pairs.normal[o]
        a00 += w * n0 * n0
        a01 += w * n0 * n1
        a02 += w * n0 * n2
        a11 += w * n1 * n1
        a12 += w * n1 * n2
        a22 += w * n2 * n2
        d = w * (pairs.delta_mm[o] - (n0 * t[0] + n1 * t[1] + n2 * t[2]))
        b0 += d * n0
        b1 += d * n1
        b2 += d * n2
    # A direction that no plane fixes stays where the outlines put it.
    ridge = 1e-3 * (a00 + a11 + a22) + 1e-12
    a = np.empty((3, 3))
    a[0, 0], a[0, 1], a[0, 2] = a00 + ridge, a01, a02
    a[1, 0], a[1, 1], a[1, 2] = a01, a11 + ridge, a12
    a[2, 0], a[2, 1], a[2, 2] = a02, a12, a22 + ridge
    invert_symmetric3(a, a)
    for u in range(3):
        t[u] += a[u, 0] * b0 + a[u, 1] * b1 + a[u, 2] * b2
    return float(served.sum())
