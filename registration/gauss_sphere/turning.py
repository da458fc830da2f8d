"""A pose turned about the normals of its planes, and moved along them to where it fits better."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from registration.gauss_sphere.patches import Patches
from registration.gauss_sphere.poses import are_same
from registration.gauss_sphere.small_matrices import apply_step
from registration.gauss_sphere.verification import (
    CONTRADICTION,
    SUPPORT,
    Comparison,
    compare_both,
    score_of,
)
from registration.gauss_sphere.view import View
from registration.kernels import compiled
from registration.scan import FloatArray, IntArray

WIDEST_STEP_MM, LEAST_STEP_MM = 16.0, 2.0
FINE_MM = 4.0  # steps up to here are judged by more samples
MOST_STEPS = 24  # that a pose is moved by, of all widths together
FEW, WORTH_LOOKING = 3, 0.3  # support that a third of the samples must tell of, to ask more
WORTH_MOVING = 0.5  # of the score that a pose needs: with less it is not moved to a better fit
REPEATED_MM = 60.0  # that a pose which is not turned is moved by, at least: planes tell of less
OFFERED = 1.5  # times the score that a pose needs: what faces that may meet under it must offer
REACH = 2.0  # of a face from its centre, in standard deviations of its points
FAR_OFF = 0.5  # contradiction over support from which on it is not moved, either
NEARLY_FREE = 0.05  # with less it may be where it belongs, but for a few mm


class Turning(NamedTuple):
    """How a pose is turned, as the compiled loops take it.

    turns_rad: (k,) about each direction of planes.  patches: so many of each view, of the largest
    area, are tried on each other, and so many pairs of them.  cos_alike, apart_mm: how far apart in
    direction and along it they may be.
    tolerance_mm: distance within which a point lies on the other view's plane.  strides: (2,) of
    the samples that are looked at, to find the best starts and to move them.
    needed: score that a pose needs.  distinct_rad: poses that differ by less are turned alike;
    distinct_mm: and are one, if they are not turned at all.
    """

    turns_rad: FloatArray
    patches: int
    cos_alike: float
    apart_mm: float
    tolerance_mm: float
    strides: IntArray
    needed: float
    distinct_rad: float
    distinct_mm: float


class Turned(NamedTuple):
    """Turned poses, structure of arrays.

    rotation: (n, 3, 3); shift_mm: (n, 3); along: (n, 2, 3) the directions that each was moved
    along; areas: (n, 4) and score: (n,) of what the scans say of it, 0 where another one that is
    turned alike, and seemed to fit better, did well.
    """

    rotation: FloatArray
    shift_mm: FloatArray
    along: FloatArray
    areas: FloatArray
    score: FloatArray


@compiled
def turned_poses(
    target: View,
    source: View,
    how: Comparison,
    turning: Turning,
    r: FloatArray,
    t: FloatArray,
    agreeing: IntArray,
) -> Turned:
    """Turn a pose about its planes, and move what fits best, one of those that are turned alike.

    r (3, 3), t (3,): p_target = r p_source + t.  agreeing: (m, 2) patches of target and source, a
    pair a plane.
    """
    rotations, shifts, plane, start = _starts(target, source, how, turning, r, t, agreeing)
    areas, score, nowhere = np.zeros((start.size, 4)), np.zeros(start.size), np.zeros(3)
    seen, along = (target.seen, source.seen), target.patches.basis[plane]
    counts = np.empty((target.patches.n_points.size, source.patches.n_points.size), np.int64)
    for c in np.argsort(-start, kind="mergesort"):
        known, alike_rad = False, turning.distinct_rad
        unturned = are_same(rotations[c], nowhere, r, nowhere, nowhere, alike_rad, np.inf)
        alike_mm = turning.distinct_mm if unturned else np.inf
        for k in range(start.size):
            alike = are_same(
                rotations[c], shifts[c], rotations[k], shifts[k], nowhere, alike_rad, alike_mm
            )
            known = known or (alike and score[k] > turning.needed and is_nearly_free(areas[k]))
        if known:
            continue
        _move_to_fit(target, source, how, turning, rotations[c], shifts[c], along[c], counts)
        if unturned and _distance(shifts[c], t) < REPEATED_MM:
            continue
        compare_both(*seen, how, rotations[c], shifts[c], turning.tolerance_mm, 1, counts, areas[c])
        score[c] = score_of(how, areas[c])
    return Turned(rotations, shifts, along, areas, score)


@compiled
def is_nearly_free(areas: FloatArray) -> bool:
    """Whether a pose may be where it belongs, but for a few mm: areas (4,) as of compare_both."""
    return bool(areas[CONTRADICTION] <= NEARLY_FREE * areas[SUPPORT])


@compiled
def _starts(
    target: View,
    source: View,
    how: Comparison,
    turning: Turning,
    r: FloatArray,
    t: FloatArray,
    agreeing: IntArray,
) -> tuple[FloatArray, FloatArray, IntArray, FloatArray]:
    """Rotations (n, 3, 3) and shifts (n, 3) of a pose turned about its planes, worth moving.

    With them the patch (n,) about whose normal each is turned, and its score (n,) by some samples.
    """
    a, b, needed, strides = target.patches, source.patches, turning.needed, turning.strides
    seen, tolerance_mm = (target.seen, source.seen), turning.tolerance_mm
    pairs = _pairs_of_planes(a, b, turning, r, t, agreeing)
    room = pairs.shape[0] * turning.turns_rad.size
    rotations, shifts, plane = np.empty((room, 3, 3)), np.empty((room, 3)), np.empty(room, np.int64)
    counts = np.empty((a.n_points.size, b.n_points.size), np.int64)
    start, some, step, nowhere = np.empty(room), np.empty(4), np.zeros(6), np.zeros(3)
    level, turned, there, n = np.empty(counts.shape, np.bool_), np.empty((3, 3)), np.empty(3), 0
    first = 0
    while first < pairs.shape[0]:
        about, past = pairs[first, 2], first + 1
        while past < pairs.shape[0] and pairs[past, 2] == about:
            past += 1
        _find_level(a, b, r, t, a.normal[about], turning, level)
        for turn in turning.turns_rad:
            step[:3] = turn * a.normal[about]
            apply_step(step, r, nowhere, turned, there)
            if _most_support(a, b, how, turned, level) < OFFERED * needed:
                continue
            for i, j, _ in pairs[first:past]:
                for u in range(3):
                    there[u] = a.centroid_mm[i, u] - _dot(turned[u], b.centroid_mm[j])
                if turn == 0.0 and _distance(there, t) < REPEATED_MM:
                    continue
                compare_both(
                    *seen, how, turned, there, tolerance_mm, FEW * strides[0], counts, some
                )
                if some[SUPPORT] < max(WORTH_LOOKING * needed, some[CONTRADICTION]):
                    continue
                compare_both(*seen, how, turned, there, tolerance_mm, strides[0], counts, some)
                score, free = score_of(how, some), some[CONTRADICTION] <= FAR_OFF * some[SUPPORT]
                if free and score >= WORTH_MOVING * needed:
                    rotations[n], shifts[n], plane[n], start[n] = turned, there, about, score
                    n += 1
        first = past
    return rotations[:n], shifts[:n], plane[:n], start[:n]


@compiled
def _pairs_of_planes(
    a: Patches, b: Patches, turning: Turning, r: FloatArray, t: FloatArray, agreeing: IntArray
) -> IntArray:
    """(n, 3) pairs of patches that lie in one plane under a pose, and a patch of its direction.

    Those that agree, and others, as the tops of two boxes: about the turned pose one may lie on the
    other. These are the largest, so many as turning.patches. In the order of directions.
    """
    m, most = agreeing.shape[0], turning.patches
    about = np.empty(m, np.int64)
    pairs = np.empty((m + most * most, 3), np.int64)
    for c in range(m):
        about[c] = agreeing[c, 0]
        for k in range(c):
            if _dot(a.normal[agreeing[c, 0]], a.normal[about[k]]) > turning.cos_alike:
                about[c] = about[k]
                break
        pairs[c, 0], pairs[c, 1], pairs[c, 2] = agreeing[c, 0], agreeing[c, 1], about[c]
    area = np.full(m + most * most, np.inf)
    n, normal, centre = m, np.empty(3), np.empty(3)
    for j in range(min(b.n_points.size, most)):
        for u in range(3):
            normal[u], centre[u] = _dot(r[u], b.normal[j]), _dot(r[u], b.centroid_mm[j]) + t[u]
        for i in range(min(a.n_points.size, most)):
            for c in range(m):
                n_about = a.normal[about[c]]
                apart_mm = abs(_dot(n_about, a.centroid_mm[i]) - _dot(n_about, centre))
                if (
                    _dot(n_about, a.normal[i]) > turning.cos_alike
                    and _dot(n_about, normal) > turning.cos_alike
                    and apart_mm < turning.apart_mm
                ):
                    area[n] = min(a.area_mm2[i], b.area_mm2[j])
                    pairs[n, 0], pairs[n, 1], pairs[n, 2] = i, j, about[c]
                    n += not ((agreeing[:, 0] == i) & (agreeing[:, 1] == j)).any()
                    break
    largest = np.argsort(-area[:n], kind="mergesort")[: m + most]
    return pairs[largest[np.argsort(pairs[largest, 2], kind="mergesort")]]


@compiled
def _dot(a: FloatArray, b: FloatArray) -> float:
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


@compiled
def _find_level(
    a: Patches,
    b: Patches,
    r: FloatArray,
    t: FloatArray,
    along: FloatArray,
    turning: Turning,
    level: NDArray[np.bool_],
) -> None:
    """Which patches, (m, n) out, may meet under a pose when they are moved across a direction."""
    apart_mm, height = turning.apart_mm + turning.tolerance_mm, np.empty((2, b.n_points.size))
    tilted, shift = np.empty(3), _dot(along, t)
    for u in range(3):  # the direction as the source has it
        tilted[u] = r[0, u] * along[0] + r[1, u] * along[1] + r[2, u] * along[2]
    for j in range(b.n_points.size):
        height[0, j], height[1, j] = _dot(tilted, b.centroid_mm[j]) + shift, _reach(b, j, tilted)
    for i in range(a.n_points.size):
        at, reach = _dot(along, a.centroid_mm[i]), _reach(a, i, along) + apart_mm
        for j in range(b.n_points.size):
            level[i, j] = abs(at - height[0, j]) < reach + height[1, j]


@compiled
def _reach(patches: Patches, i: int, along: FloatArray) -> float:
    """How far a patch reaches from its centre along a direction, in mm."""
    basis, spread = patches.basis[i], patches.spread_mm[i]
    across, up = spread[0] * _dot(basis[0], along), spread[1] * _dot(basis[1], along)
    return float(REACH * np.sqrt(across * across + up * up))


@compiled
def _distance(a: FloatArray, b: FloatArray) -> float:
    return float(np.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2))


@compiled
def _most_support(
    a: Patches, b: Patches, how: Comparison, r: FloatArray, level: NDArray[np.bool_]
) -> float:
    """Surface in mm^2 that a rotation may lay on the other's, wherever it is, by the directions.

    level: (m, n) which patches may meet.
    """
    on_a, on_b, normal = np.zeros(a.n_points.size), np.zeros(b.n_points.size), np.empty(3)
    for j in range(b.n_points.size):
        for u in range(3):
            normal[u] = _dot(r[u], b.normal[j])
        for i in range(a.n_points.size):
            if level[i, j] and _dot(normal, a.normal[i]) > how.cos_tolerance:
                on_a[i] += b.area_mm2[j]
                on_b[j] += a.area_mm2[i]
    for i in range(on_a.size):
        on_a[i] = min(on_a[i], a.area_mm2[i])
    for j in range(on_b.size):
        on_b[j] = min(on_b[j], b.area_mm2[j])
    return float(0.5 * (on_a.sum() + on_b.sum()))


@compiled
def _move_to_fit(
    target: View,
    source: View,
    how: Comparison,
    turning: Turning,
    r: FloatArray,
    t: FloatArray,
    along: FloatArray,
    counts: IntArray,
) -> None:
    """Move a pose along two directions (2, 3) to a better score: t (3,) is changed in place."""
    seen, some, trial = (target.seen, source.seen), np.empty(4), np.empty(3)
    tolerance_mm, stride = turning.tolerance_mm, 0
    best, step_mm = 0.0, WIDEST_STEP_MM
    for _ in range(MOST_STEPS):
        if step_mm < LEAST_STEP_MM:
            break
        wanted = turning.strides[0] if step_mm > FINE_MM else turning.strides[1]
        if wanted != stride:
            stride = wanted
            compare_both(*seen, how, r, t, tolerance_mm, stride, counts, some)
            best = score_of(how, some)
        better = False
        for axis in range(2):
            for step in (-step_mm, step_mm):
                for u in range(3):
                    trial[u] = t[u] + step * along[axis, u]
                compare_both(*seen, how, r, trial, tolerance_mm, stride, counts, some)
                if score_of(how, some) > best:
                    best, better = score_of(how, some), True
                    t[:] = trial
        if not better:
            step_mm *= 0.5
