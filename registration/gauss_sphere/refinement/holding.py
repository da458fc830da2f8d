"""What keeps a pose where it is along directions that no plane fixes: a soft hold on one point."""

from __future__ import annotations

import numpy as np

from registration.gauss_sphere.planes.patches import Patches
from registration.kernels import compiled
from registration.scan import FloatArray, IntArray


@compiled
def middle_of_pairs(target: Patches, pairs: IntArray) -> FloatArray:
    """(3,) middle of the target's matched planes, in mm."""
    middle, total = np.zeros(3), 0.0
    for m in range(pairs.shape[0]):
        area = target.area_mm2[pairs[m, 0]]
        total += area
        for u in range(3):
            middle[u] += area * target.centroid_mm[pairs[m, 0], u]
    return middle / max(total, 1e-12)


@compiled
def hold(
    held: FloatArray,
    held_source: FloatArray,
    held_mm: float,
    r: FloatArray,
    t: FloatArray,
    hessian: FloatArray,
    gradient: FloatArray,
) -> float:
    """Add to gradient and Hessian what holds a point of the source in its place; its cost.

    held, held_source: (3,) where the point was in the target, and in the source's coordinates.
    """
    weight, cost, far2 = 1.0 / (held_mm * held_mm), 0.0, 0.0
    place, away = np.empty(3), np.empty(3)
    for u in range(3):
        place[u] = t[u]
        for v in range(3):
            place[u] += r[u, v] * held_source[v]
        away[u] = place[u] - held[u]
        cost += weight * away[u] * away[u]
        far2 += place[u] * place[u]
    # A perturbation (w, v) on the left moves the place by w x place + v.
    for u in range(3):
        v, w = (u + 1) % 3, (u + 2) % 3
        gradient[u] += weight * (place[v] * away[w] - place[w] * away[v])
        gradient[3 + u] += weight * away[u]
        for i in range(3):
            hessian[u, i] += weight * ((far2 if i == u else 0.0) - place[u] * place[i])
        hessian[3 + u, 3 + u] += weight
        for i, k, lever in ((u, 3 + v, -place[w]), (u, 3 + w, place[v])):
            hessian[i, k] += weight * lever
            hessian[k, i] += weight * lever
    return cost
