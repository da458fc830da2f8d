"""Rotation candidates: pairs of directions on the two Gauss spheres that subtend the same angle."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from registration.gauss_sphere.params import RotationParams
from registration.gauss_sphere.patches import Patches
from registration.kernels import compiled
from registration.scan import FloatArray, IntArray


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
    a, b = target.direction[: params.directions], source.direction[: params.directions]
    rotations = np.empty((params.capacity, 3, 3))
    scores = np.empty(params.capacity)
    n = _candidates(
        a,
        target.weight[: params.directions],
        b,
        source.weight[: params.directions],
        params.least_angle_rad,
        params.angle_tolerance_rad,
        params.overlap_tolerance_rad,
        rotations,
        scores,
    )
    order = np.argsort(-scores[:n], kind="stable")
    kept = np.empty(params.kept, dtype=np.int64)
    k = _distinct(rotations, order, 2.0 * np.cos(params.distinct_rad) + 1.0, kept)
    return rotations[kept[:k]], scores[kept[:k]]


@compiled
def _candidates(
    a: FloatArray,
    weight_a: FloatArray,
    b: FloatArray,
    weight_b: FloatArray,
    least: float,
    tolerance: float,
    overlap: float,
    rotations: FloatArray,
    scores: FloatArray,
) -> int:
    n = 0
    frame_a, frame_b = np.empty((3, 3)), np.empty((3, 3))
    cos_overlap = np.cos(overlap)
    angle_b = np.empty((b.shape[0], b.shape[0]))
    for k in range(b.shape[0]):
        for m in range(b.shape[0]):
            angle_b[k, m] = _angle(b[k], b[m])
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
                    _frame(b[k], b[m], frame_b)
                    r = rotations[n]
                    for u in range(3):
                        for v in range(3):
                            r[u, v] = (
                                frame_a[0, u] * frame_b[0, v]
                                + frame_a[1, u] * frame_b[1, v]
                                + frame_a[2, u] * frame_b[2, v]
                            )
                    scores[n] = _overlap(a, weight_a, b, weight_b, r, cos_overlap)
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
def _overlap(
    a: FloatArray,
    weight_a: FloatArray,
    b: FloatArray,
    weight_b: FloatArray,
    r: FloatArray,
    cos_overlap: float,
) -> float:
    """Area of directions that agree after the rotation, each target direction served once."""
    total = 0.0
    for k in range(b.shape[0]):
        x = r[0, 0] * b[k, 0] + r[0, 1] * b[k, 1] + r[0, 2] * b[k, 2]
        y = r[1, 0] * b[k, 0] + r[1, 1] * b[k, 1] + r[1, 2] * b[k, 2]
        z = r[2, 0] * b[k, 0] + r[2, 1] * b[k, 1] + r[2, 2] * b[k, 2]
        best = 0.0
        for i in range(a.shape[0]):
            if x * a[i, 0] + y * a[i, 1] + z * a[i, 2] > cos_overlap:
                best = max(best, min(weight_a[i], weight_b[k]))
        total += best
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
