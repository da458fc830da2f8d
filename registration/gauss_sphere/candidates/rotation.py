"""Rotation candidates: pairs of directions on the two Gauss spheres that subtend the same angle."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from registration.gauss_sphere.params import RotationParams
from registration.gauss_sphere.planes.patches import Patches
from registration.kernels import compiled
from registration.scan import FloatArray, IntArray

BLOCK = 256  # rotations that are looked at together


class GaussSphere(NamedTuple):
    """Directions of the patches, those that the threshold cannot tell apart merged into one.

    direction: (k, 3) unit; weight: (k,) summed area in mm^2, largest first; member: (m,) direction
    of each patch.
    """

    direction: FloatArray
    weight: FloatArray
    member: IntArray


@compiled
def gauss_sphere(patches: Patches, close_rad: float) -> GaussSphere:
    """Merge patches of like orientation wherever they lie (section 5.5), largest area first."""
    n = patches.n_points.size
    direction, weight = np.zeros((n, 3)), np.zeros(n)
    member = np.full(n, -1)
    merged = np.empty(3)
    k = 0
    for i in np.argsort(-patches.area_mm2, kind="mergesort"):
        area, normal = patches.area_mm2[i], patches.normal[i]
        nearest, distance2 = -1, close_rad * close_rad
        for j in range(k):
            away2 = 0.0
            for u in range(3):
                away2 += (direction[j, u] - normal[u]) ** 2
            if away2 < distance2:
                nearest, distance2 = j, away2
        if nearest < 0:
            direction[k], weight[k], member[i] = normal, area, k
            k += 1
            continue
        member[i] = nearest
        size = 0.0
        for u in range(3):
            merged[u] = weight[nearest] * direction[nearest, u] + area * normal[u]
            size += merged[u] * merged[u]
        direction[nearest] = merged / np.sqrt(size)
        weight[nearest] += area
    order = np.argsort(-weight[:k], kind="mergesort")
    renumber = np.empty(k, np.int64)
    renumber[order] = np.arange(k)
    return GaussSphere(direction[order], weight[order], renumber[member])


def rotation_candidates(
    target: GaussSphere, source: GaussSphere, params: RotationParams
) -> tuple[FloatArray, FloatArray]:
    """Rotations that lay pairs of the source's directions on pairs of the target's.

    Returns (c, 3, 3) rotations R with n_target = R n_source, and (c,) the area in mm^2 whose
    directions then agree, best first; candidates closer together than params.distinct_rad are one.
    """
    return _best_rotations(
        target,
        source,
        params.directions,
        params.least_angle_rad,
        params.angle_tolerance_rad,
        params.capacity,
        math.cos(params.overlap_tolerance_rad),
        2.0 * math.cos(params.distinct_rad) + 1.0,
        params.kept,
    )


def rotations_between(target: Patches, source: Patches, params: RotationParams) -> FloatArray:
    """(c, 3, 3) rotations that lay normals of the source on those of the target, best first."""
    spheres = gauss_sphere(target, params.close_rad), gauss_sphere(source, params.close_rad)
    return rotation_candidates(*spheres, params)[0]


@compiled
def _best_rotations(
    target: GaussSphere,
    source: GaussSphere,
    few: int,
    least_angle: float,
    tolerance: float,
    capacity: int,
    cos_overlap: float,
    least_trace: float,
    most: int,
) -> tuple[FloatArray, FloatArray]:
    a, b = target.direction[:few], source.direction[:few]
    rotations, kept = np.empty((capacity, 3, 3)), np.empty(most, np.int64)
    n = _candidates(a, b, least_angle, tolerance, rotations)
    scores = _overlaps(a, target.weight[:few], b, source.weight[:few], rotations[:n], cos_overlap)
    best_first = np.argsort(-scores, kind="mergesort")
    kept = kept[: _distinct(rotations, best_first, least_trace, kept)]
    return rotations[kept], scores[kept]


@compiled
def _candidates(
    a: FloatArray, b: FloatArray, least: float, tolerance: float, rotations: FloatArray
) -> int:
    """Rotations (n or more, 3, 3), out, and how many they are."""
    n = 0
    frame_a, frame_b = np.empty((3, 3)), np.empty((b.shape[0], b.shape[0], 3, 3))
    angle_b = np.empty((b.shape[0], b.shape[0]))
    for k in range(b.shape[0]):
        for m in range(b.shape[0]):
            angle_b[k, m] = _angle(b[k], b[m])
            _frame(b[k], b[m], frame_b[k, m])
    for i in range(a.shape[0]):
        for j in range(i + 1, a.shape[0]):
            angle = _angle(a[i], a[j])
            if angle < least or angle > np.pi - least:
                continue
            _frame(a[i], a[j], frame_a)
            for k in range(b.shape[0]):
                for m in range(b.shape[0]):
                    if k == m or abs(angle_b[k, m] - angle) > tolerance:
                        continue
                    if n == rotations.shape[0]:
                        return n
                    f, r = frame_b[k, m], rotations[n]
                    for u in range(3):
                        for v in range(3):
                            r[u, v] = (
                                frame_a[0, u] * f[0, v]
                                + frame_a[1, u] * f[1, v]
                                + frame_a[2, u] * f[2, v]
                            )
                    n += 1
    return n


@compiled
def _angle(a: FloatArray, b: FloatArray) -> float:
    x = a[1] * b[2] - a[2] * b[1]
    y = a[2] * b[0] - a[0] * b[2]
    z = a[0] * b[1] - a[1] * b[0]
    return math.atan2(math.sqrt(x * x + y * y + z * z), a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


@compiled
def _frame(a: FloatArray, b: FloatArray, frame: FloatArray) -> None:
    """Orthonormal rows: the bisector of a and b, across it in their plane, and their normal."""
    for t in range(3):
        frame[0, t] = a[t] + b[t]
        frame[1, t] = a[t] - b[t]
    for r in range(2):
        size = np.sqrt(frame[r, 0] ** 2 + frame[r, 1] ** 2 + frame[r, 2] ** 2)
        for t in range(3):
            frame[r, t] /= size
    frame[2, 0] = frame[0, 1] * frame[1, 2] - frame[0, 2] * frame[1, 1]
    frame[2, 1] = frame[0, 2] * frame[1, 0] - frame[0, 0] * frame[1, 2]
    frame[2, 2] = frame[0, 0] * frame[1, 1] - frame[0, 1] * frame[1, 0]


@compiled
def _overlaps(
    a: FloatArray,
    weight_a: FloatArray,
    b: FloatArray,
    weight_b: FloatArray,
    rotations: FloatArray,
    cos_overlap: float,
) -> FloatArray:
    """(n,) area of directions that agree after each rotation.

    weight_a: falling. Each source direction is served once, by the heaviest that it meets.
    """
    total, turned = np.zeros(rotations.shape[0]), np.empty((3, 3, BLOCK))
    met, area = np.empty((3, BLOCK)), np.empty(BLOCK)
    for first in range(0, total.size, BLOCK):
        n = min(BLOCK, total.size - first)
        for c in range(n):
            turned[:, :, c] = rotations[first + c]
        for k in range(b.shape[0]):
            for u in range(3):
                of_x, of_y, of_z = turned[u, 0], turned[u, 1], turned[u, 2]
                for c in range(n):
                    met[u, c] = of_x[c] * b[k, 0] + of_y[c] * b[k, 1] + of_z[c] * b[k, 2]
            area[:] = 0.0
            # The heaviest comes last: this runs on vectors of rotations.
            for i in range(a.shape[0] - 1, -1, -1):
                x, y, z, shared = a[i, 0], a[i, 1], a[i, 2], min(weight_a[i], weight_b[k])
                for c in range(n):
                    meets = met[0, c] * x + met[1, c] * y + met[2, c] * z > cos_overlap
                    area[c] = shared if meets else area[c]
            for c in range(n):
                total[first + c] += area[c]
    return total


@compiled
def _distinct(rotations: FloatArray, order: IntArray, least_trace: float, kept: IntArray) -> int:
    n = 0
    for o in order:
        r = rotations[o]
        new = True
        for j in range(n):
            q = rotations[kept[j]]
            trace = 0.0
            for u in range(3):
                for v in range(3):
                    trace += r[u, v] * q[u, v]
            if trace > least_trace:
                new = False
                break
        if new:
            kept[n] = o
            n += 1
            if n == kept.size:
                break
    return n
