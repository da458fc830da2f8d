"""Information that is owed to the noise of the normals, and not to the planes."""

from __future__ import annotations

import numpy as np

from registration.gauss_sphere.planes.patches import Patches
from registration.gauss_sphere.refinement.plane_pairs import (
    compare,
    no_difference,
    squared_distance,
)
from registration.gauss_sphere.refinement.refine import Likelihood
from registration.kernels import compiled
from registration.scan import FloatArray, IntArray

# Times the expectation: of few small planes, chance makes more than that.
CAUTION = 2.0


@compiled
def take_chance(
    target: Patches,
    source: Patches,
    pairs: IntArray,
    likely: Likelihood,
    floor_mm: float,
    r: FloatArray,
    t: FloatArray,
    information: FloatArray,
) -> None:
    """Take from the information (6, 6), in place, what noisy normals seem to add to it.

    The offset of a plane fixes the shift along its normal. A normal that noise turns towards a
    direction in which no plane looks seems to fix that one, too: by the square of the noise, over
    as many planes as there are. The normal that both views know together has the least noise, so
    the information is changed to it first. What is left may be negative; such a direction is open.

    floor_mm: the systematic error under which the information was found: under a smaller one chance
    would weigh more than all that it is taken from.
    """
    tilt_floor = floor_mm / likely.lever_mm
    difference = no_difference()
    weight, jacobian, residual = difference.weight, difference.jacobian, difference.residual
    known, tilt, g = np.empty((2, 2)), np.empty(2), np.empty((2, 6))
    moved, pull, normal = np.empty(6), np.empty(6), np.empty(3)
    for m in range(pairs.shape[0]):
        i, k = pairs[m, 0], pairs[m, 1]
        compare(target, i, source, k, r, t, tilt_floor, floor_mm, difference)
        robust = 1.0 / (1.0 + squared_distance(difference) / likely.tail)
        _by_both(target.covariance[i], tilt_floor, difference.spread, residual, known, tilt)
        a, basis = target.centroid_mm[i], target.basis[i]
        for u in range(3):
            normal[u] = target.normal[i, u] + tilt[0] * basis[0, u] + tilt[1] * basis[1, u]
        size = np.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
        for u in range(3):
            moved[3 + u] = normal[u] / size
        _about(moved, a)
        for u in range(6):
            moved[u] -= jacobian[2, u]
            pull[u] = 0.0
            for v in range(3):
                pull[u] += robust * weight[2, v] * jacobian[v, u]
        for v in range(2):
            # How the offset's derivative by the pose turns with the normal: towards its tangents.
            for u in range(3):
                g[v, 3 + u] = basis[v, u]
            _about(g[v], a)
        certain = robust * weight[2, 2]
        for u in range(6):
            for w in range(6):
                change = pull[u] * moved[w] + moved[u] * pull[w] + certain * moved[u] * moved[w]
                for v in range(2):
                    along = known[v, 0] * g[0, w] + known[v, 1] * g[1, w]
                    change -= CAUTION * certain * g[v, u] * along
                information[u, w] += change


@compiled
def _by_both(
    covariance: FloatArray,
    tilt_floor: float,
    spread: FloatArray,
    residual: FloatArray,
    known: FloatArray,
    tilt: FloatArray,
) -> None:
    """How well both views know the tilts of a plane (2, 2), and what they are, off the target's."""
    half = 0.5 * tilt_floor * tilt_floor
    a, b, c = covariance[0, 0] + half, covariance[0, 1], covariance[1, 1] + half
    determinant = spread[0, 0] * spread[1, 1] - spread[0, 1] * spread[0, 1]
    p, q, s = spread[1, 1] / determinant, -spread[0, 1] / determinant, spread[0, 0] / determinant
    g00, g01, g10, g11 = a * p + b * q, a * q + b * s, b * p + c * q, b * q + c * s
    tilt[0] = g00 * residual[0] + g01 * residual[1]
    tilt[1] = g10 * residual[0] + g11 * residual[1]
    known[0, 0] = a - g00 * a - g01 * b
    known[0, 1] = known[1, 0] = b - g00 * b - g01 * c
    known[1, 1] = c - g10 * b - g11 * c


@compiled
def _about(row: FloatArray, a: FloatArray) -> None:
    """Fill the first half of the derivative of an offset at a from its second, the normal."""
    row[0] = a[1] * row[5] - a[2] * row[4]
    row[1] = a[2] * row[3] - a[0] * row[5]
    row[2] = a[0] * row[4] - a[1] * row[3]
