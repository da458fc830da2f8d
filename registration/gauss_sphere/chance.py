"""Information that is owed to the noise of the normals, and not to the planes."""

from __future__ import annotations

import numpy as np

from registration.gauss_sphere.patches import Patches
from registration.gauss_sphere.plane_pairs import compare, no_difference, squared_distance
from registration.gauss_sphere.refine import Likelihood
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
    as many planes as there are. What is left may be negative; such a direction is open.
    """
    difference = no_difference()
    g = np.empty((2, 6))
    for m in range(pairs.shape[0]):
        i, k = pairs[m, 0], pairs[m, 1]
        compare(target, i, source, k, r, t, floor_mm / likely.lever_mm, floor_mm, difference)
        robust = 1.0 / (1.0 + squared_distance(difference) / likely.tail)
        certain = CAUTION * robust * difference.weight[2, 2]
        a = target.centroid_mm[i]
        for v in range(2):
            # How the offset's derivative by the pose turns with the normal: towards its tangents.
            f = difference.basis[v]
            g[v, 0] = a[1] * f[2] - a[2] * f[1]
            g[v, 1] = a[2] * f[0] - a[0] * f[2]
            g[v, 2] = a[0] * f[1] - a[1] * f[0]
            for u in range(3):
                g[v, 3 + u] = f[u]
        tilt = source.covariance[k]
        for u in range(6):
            for w in range(6):
                for v in range(2):
                    along = tilt[v, 0] * g[0, w] + tilt[v, 1] * g[1, w]
                    information[u, w] -= certain * g[v, u] * along
