"""How far two planes, each known with its own covariance, are from being one."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from registration.gauss_sphere.planes.patches import Patches
from registration.gauss_sphere.small_matrices import invert_symmetric3
from registration.kernels import compiled, inlined
from registration.scan import FloatArray


class Difference(NamedTuple):
    """Plane k of the source, under a pose, less plane i of the target, in the latter's coordinates.

    residual: (3,) two tilts and the offset at the centroid of i; spread: (3, 3) the sum of both
    covariances; weight: (3, 3) its inverse; pull: (3,) weight @ residual.
    jacobian: (3, 6) of the residual, by a perturbation (rad, mm) on the left of the pose.
    normal, centre, apart (3,), basis (2, 3), map and mapped (3, 3): to work in.
    """

    residual: FloatArray
    spread: FloatArray
    weight: FloatArray
    pull: FloatArray
    jacobian: FloatArray
    normal: FloatArray
    centre: FloatArray
    apart: FloatArray
    basis: FloatArray
    map: FloatArray
    mapped: FloatArray


@compiled
def no_difference() -> Difference:
    """Room for one comparison after the other."""
    return Difference(
        np.zeros(3),
        np.zeros((3, 3)),
        np.zeros((3, 3)),
        np.zeros(3),
        np.zeros((3, 6)),
        np.zeros(3),
        np.zeros(3),
        np.zeros(3),
        np.zeros((2, 3)),
        np.zeros((3, 3)),
        np.zeros((3, 3)),
    )


@inlined
def compare(
    target: Patches,
    i: int,
    source: Patches,
    k: int,
    r: FloatArray,
    t: FloatArray,
    tilt_floor: float,
    offset_floor: float,
    out: Difference,
) -> float:
    """Fill all of out but weight and pull; returns the cosine between the normals.

    tilt_floor (rad), offset_floor (mm): systematic errors added to the spread.
    """
    ca, ea, cov_a = target.centroid_mm, target.basis, target.covariance
    nb, cb, eb, cov_b = source.normal, source.centroid_mm, source.basis, source.covariance
    residual, spread, jacobian = out.residual, out.spread, out.jacobian
    n, c, d, f = out.normal, out.centre, out.apart, out.basis
    map_b, mapped = out.map, out.mapped
    for u in range(3):
        n[u] = r[u, 0] * nb[k, 0] + r[u, 1] * nb[k, 1] + r[u, 2] * nb[k, 2]
        c[u] = t[u] + r[u, 0] * cb[k, 0] + r[u, 1] * cb[k, 1] + r[u, 2] * cb[k, 2]
        for v in range(2):
            f[v, u] = r[u, 0] * eb[k, v, 0] + r[u, 1] * eb[k, v, 1] + r[u, 2] * eb[k, v, 2]
    for u in range(3):
        d[u] = c[u] - ca[i, u]
    residual[2] = n[0] * d[0] + n[1] * d[1] + n[2] * d[2]
    for v in range(2):
        e0, e1, e2 = ea[i, v, 0], ea[i, v, 1], ea[i, v, 2]
        residual[v] = e0 * n[0] + e1 * n[1] + e2 * n[2]
        for w in range(2):
            map_b[v, w] = e0 * f[w, 0] + e1 * f[w, 1] + e2 * f[w, 2]
        map_b[v, 2] = 0.0
        map_b[2, v] = f[v, 0] * d[0] + f[v, 1] * d[1] + f[v, 2] * d[2]
    map_b[2, 2] = 1.0
    # Covariance of the difference: cov_a + map_b cov_b map_b^T, map_b = [[m, 0], [l, 1]].
    for u in range(3):
        for v in range(3):
            mapped[u, v] = map_b[u, 0] * cov_b[k, 0, v] + map_b[u, 1] * cov_b[k, 1, v]
    for v in range(3):
        mapped[2, v] += cov_b[k, 2, v]
    for u in range(3):
        for v in range(u + 1):
            total = mapped[u, 0] * map_b[v, 0] + mapped[u, 1] * map_b[v, 1]
            if v == 2:
                total += mapped[u, 2]
            spread[u, v] = cov_a[i, u, v] + total
            spread[v, u] = spread[u, v]
    spread[0, 0] += tilt_floor * tilt_floor
    spread[1, 1] += tilt_floor * tilt_floor
    spread[2, 2] += offset_floor * offset_floor
    for v in range(2):
        e0, e1, e2 = ea[i, v, 0], ea[i, v, 1], ea[i, v, 2]
        jacobian[v, 0] = n[1] * e2 - n[2] * e1
        jacobian[v, 1] = n[2] * e0 - n[0] * e2
        jacobian[v, 2] = n[0] * e1 - n[1] * e0
    # offset = n . (c - ca): n turns, c moves with the pose about the origin.
    jacobian[2, 0] = -(n[1] * ca[i, 2] - n[2] * ca[i, 1])
    jacobian[2, 1] = -(n[2] * ca[i, 0] - n[0] * ca[i, 2])
    jacobian[2, 2] = -(n[0] * ca[i, 1] - n[1] * ca[i, 0])
    for u in range(3):
        jacobian[2, 3 + u] = n[u]
    normal = target.normal[i]
    cosine: float = n[0] * normal[0] + n[1] * normal[1] + n[2] * normal[2]
    return cosine


@inlined
def squared_distance(difference: Difference) -> float:
    """The squared Mahalanobis distance of the residual in its spread; fills weight and pull."""
    residual, weight, pull = difference.residual, difference.weight, difference.pull
    invert_symmetric3(difference.spread, weight)
    total = 0.0
    for u in range(3):
        pull[u] = 0.0
        for v in range(3):
            pull[u] += weight[u, v] * residual[v]
        total += residual[u] * pull[u]
    return total
