"""What keeps a pose where it is along directions that no plane fixes: a soft hold."""

from __future__ import annotations

from typing import NamedTuple

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


class Held(NamedTuple):
    """A pose as it was, and how softly it is held there.

    middle_mm, of_source_mm: (3,) a point of the target where it was, and in the source's
        coordinates; rotation: (3, 3). mm, rad: standard deviations of the point's place and of the
        rotation.
    """

    middle_mm: FloatArray
    of_source_mm: FloatArray
    rotation: FloatArray
    mm: float
    rad: float


@compiled
def held_where_it_is(
    target: Patches, pairs: IntArray, r: FloatArray, t: FloatArray, mm: float, rad: float
) -> Held:
    """A pose held at the middle of its matched planes."""
    middle = middle_of_pairs(target, pairs)
    return Held(middle, r.T @ (middle - t), r.copy(), mm, rad)


@compiled
def hold(
    held: Held, r: FloatArray, t: FloatArray, hessian: FloatArray, gradient: FloatArray
) -> float:
    """Add to gradient and Hessian what holds a pose; its cost.

    A turn by an angle costs 2 (1 - cos), in squared deviations: the square where it is small.
    """
    weight, of_turn, cost, far2 = 1.0 / (held.mm * held.mm), 1.0 / (held.rad * held.rad), 0.0, 0.0
    place, away = np.empty(3), np.empty(3)
    for u in range(3):
        place[u] = t[u]
        for v in range(3):
            place[u] += r[u, v] * held.of_source_mm[v]
        away[u] = place[u] - held.middle_mm[u]
        cost += weight * away[u] * away[u]
        far2 += place[u] * place[u]
    # A perturbation (w, v) on the left moves the place by w x place + v.
    for u in range(3):
        v, w = (u + 1) % 3, (u + 2) % 3
        turn = 0.0  # from the rotation as it was: its sine, about axis u
        for k in range(3):
            turn += 0.5 * (r[w, k] * held.rotation[v, k] - r[v, k] * held.rotation[w, k])
            cost += of_turn * (1.0 / 3.0 - r[u, k] * held.rotation[u, k])
        gradient[u] += of_turn * turn
        hessian[u, u] += of_turn
        gradient[u] += weight * (place[v] * away[w] - place[w] * away[v])
        gradient[3 + u] += weight * away[u]
        for i in range(3):
            hessian[u, i] += weight * ((far2 if i == u else 0.0) - place[u] * place[i])
        hessian[3 + u, 3 + u] += weight
        for i, k, lever in ((u, 3 + v, -place[w]), (u, 3 + w, place[v])):
            hessian[i, k] += weight * lever
            hessian[k, i] += weight * lever
    return cost
