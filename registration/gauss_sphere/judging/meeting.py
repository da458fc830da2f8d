"""Which patches of two views may meet where a pose is turned about a plane, or moved along it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from registration.gauss_sphere.planes.patches import Patches
from registration.gauss_sphere.refinement.verification import Comparison
from registration.kernels import compiled
from registration.scan import FloatArray, IntArray

REACH = 2.0  # of most of a face from its centre, in standard deviations of its points


@compiled
def pairs_in_planes(
    a: Patches,
    b: Patches,
    most: int,
    cos_alike: float,
    apart_mm: float,
    r: FloatArray,
    t: FloatArray,
    agreeing: IntArray,
) -> IntArray:
    """(n, 3) pairs of patches that lie in one plane under a pose, and a patch of its direction.

    Those that agree, (m, 2), and others, as the tops of two boxes: under a turned pose one may lie
    on the other. These are the largest, so many as most. In the order of directions.
    cos_alike, apart_mm: how far apart in direction and along it they may be.
    """
    m = agreeing.shape[0]
    about = np.empty(m, np.int64)
    pairs = np.empty((m + most * most, 3), np.int64)
    for c in range(m):
        about[c] = agreeing[c, 0]
        for k in range(c):
            if dot(a.normal[agreeing[c, 0]], a.normal[about[k]]) > cos_alike:
                about[c] = about[k]
                break
        pairs[c, 0], pairs[c, 1], pairs[c, 2] = agreeing[c, 0], agreeing[c, 1], about[c]
    area = np.full(m + most * most, np.inf)
    n, normal, centre = m, np.empty(3), np.empty(3)
    for j in range(min(b.n_points.size, most)):
        for u in range(3):
            normal[u], centre[u] = dot(r[u], b.normal[j]), dot(r[u], b.centroid_mm[j]) + t[u]
        for i in range(min(a.n_points.size, most)):
            for c in range(m):
                n_about = a.normal[about[c]]
                away_mm = abs(dot(n_about, a.centroid_mm[i]) - dot(n_about, centre))
                if (
                    dot(n_about, a.normal[i]) > cos_alike
                    and dot(n_about, normal) > cos_alike
                    and away_mm < apart_mm
                ):
                    area[n] = min(a.area_mm2[i], b.area_mm2[j])
                    pairs[n, 0], pairs[n, 1], pairs[n, 2] = i, j, about[c]
                    n += not ((agreeing[:, 0] == i) & (agreeing[:, 1] == j)).any()
                    break
    largest = np.argsort(-area[:n], kind="mergesort")[: m + most]
    return pairs[largest[np.argsort(pairs[largest, 2], kind="mergesort")]]


@compiled
def find_level(
    a: Patches,
    b: Patches,
    r: FloatArray,
    t: FloatArray,
    along: FloatArray,
    apart_mm: float,
    level: NDArray[np.bool_],
) -> None:
    """Which patches, (m, n) out, may meet under a pose when they are moved across a direction.

    apart_mm: how far apart along it they may be.
    """
    tilted, height, shift = np.empty(3), np.empty((2, b.n_points.size)), dot(along, t)
    for u in range(3):  # the direction as the source has it
        tilted[u] = r[0, u] * along[0] + r[1, u] * along[1] + r[2, u] * along[2]
    for j in range(b.n_points.size):
        height[0, j], height[1, j] = dot(tilted, b.centroid_mm[j]) + shift, _reach(b, j, tilted)
    for i in range(a.n_points.size):
        at, reach = dot(along, a.centroid_mm[i]), _reach(a, i, along) + apart_mm
        for j in range(b.n_points.size):
            level[i, j] = abs(at - height[0, j]) < reach + height[1, j]


@compiled
def most_support(
    a: Patches, b: Patches, how: Comparison, r: FloatArray, level: NDArray[np.bool_]
) -> float:
    """Surface in mm^2 that a rotation may lay on the other's, by the directions of patches.

    level: (m, n) which of them may meet at all.
    """
    on_a, on_b, normal = np.zeros(a.n_points.size), np.zeros(b.n_points.size), np.empty(3)
    for j in range(b.n_points.size):
        for u in range(3):
            normal[u] = dot(r[u], b.normal[j])
        for i in range(a.n_points.size):
            if level[i, j] and dot(normal, a.normal[i]) > how.cos_tolerance:
                on_a[i] += b.area_mm2[j]
                on_b[j] += a.area_mm2[i]
    for i in range(on_a.size):
        on_a[i] = min(on_a[i], a.area_mm2[i])
    for j in range(on_b.size):
        on_b[j] = min(on_b[j], b.area_mm2[j])
    return float(0.5 * (on_a.sum() + on_b.sum()))


@compiled
def _reach(patches: Patches, i: int, along: FloatArray) -> float:
    """How far a patch reaches from its centre along a direction, in mm."""
    basis, spread = patches.basis[i], patches.spread_mm[i]
    across, up = spread[0] * dot(basis[0], along), spread[1] * dot(basis[1], along)
    return float(REACH * np.sqrt(across * across + up * up))


@compiled
def dot(a: FloatArray, b: FloatArray) -> float:
    """Scalar product of two vectors (3,)."""
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])
