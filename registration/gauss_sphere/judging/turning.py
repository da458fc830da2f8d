"""A pose turned about the normals of its planes, and moved along them to where it fits better."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from registration.gauss_sphere.judging.meeting import dot, find_level, most_support, pairs_in_planes
from registration.gauss_sphere.refinement.poses import are_same
from registration.gauss_sphere.refinement.verification import (
    CONTRADICTION,
    SUPPORT,
    Comparison,
    compare_both,
    score_of,
)
from registration.gauss_sphere.small_matrices import apply_step
from registration.gauss_sphere.view import View
from registration.kernels import compiled
from registration.scan import FloatArray, IntArray

WIDEST_STEP_MM, LEAST_STEP_MM = 16.0, 2.0
FINE_MM = 4.0  # steps up to here are judged by more samples
MOST_ROUNDS = 24  # of steps that a pose is moved by, of all widths together
WORTH_LOOKING = 0.3  # of the score that a pose needs: support of few samples, to ask more
WORTH_MOVING = 0.5  # of the score that a pose needs: with less it is not moved to a better fit
# Times the score that a pose needs: what faces that may meet under it must offer. They do not meet
# in whole: for those that became rivals, in some 700 pairs, it was 1.8 and more.
OFFERED = 1.5
# That a pose which is not turned is moved by, at least. Nearer ones were the pose itself, slid
# along where little tells, as often as they were another.
REPEATED_MM = 60.0
# What wide steps must reach, for fine ones to be taken: of the score that a pose needs, and at most
# of contradiction over support. A pose is at most 4 mm off then, in each direction, which is within
# the tolerance of a comparison. Of 3,300 that fine steps made good, 4 had less, 2 of them hardly.
BEFORE_FINE_STEPS = 0.65, 0.15
# The same after fine steps of each width, by a fourth of the samples. Of 6,700 that by all samples
# then had 0.8 of the score and were nearly free, as symmetry.py asks for, 3 had less.
AFTER_FINE_STEPS = 0.75, 0.1
FAR_OFF = 0.5  # contradiction over support from which on it is not moved, either
NEARLY_FREE = 0.05  # with less it may be where it belongs, but for a few mm


class Turning(NamedTuple):
    """How a pose is turned, as the compiled loops take it.

    turns_rad: (k,) about each direction of planes.  patches: so many of each view, of the largest
    area, are tried on each other, and so many pairs of them.  cos_alike, apart_mm: how far apart in
    direction and along it they may be.
    tolerance_mm: distance within which a point lies on the other view's plane.  strides: (3,) of
    the samples that are looked at, to drop most starts, to find the best ones and take wide steps,
    and to take fine ones.
    needed: score that a pose needs.  distinct_rad: poses that differ by less are turned alike;
    distinct_mm: those that are not turned at all are one if they are closer.
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
    """Poses turned about planes, or only moved along them, structure of arrays.

    rotation: (n, 3, 3); shift_mm: (n, 3); unturned: (n,); along: (n, 2, 3) the directions that each
    was moved along; areas: (n, 2) and score: (n,) of what the scans say of it, 0 where another one
    that is turned alike (or, of those that are not turned, in the same place), and seemed to fit
    better, did well, where steps led to too little, and where one that is not turned came near
    the pose that it started from.
    """

    rotation: FloatArray
    shift_mm: FloatArray
    unturned: NDArray[np.bool_]
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
    """Turn a pose about its planes, or not, and move what fits best, one of those turned alike.

    r (3, 3), t (3,): p_target = r p_source + t.  agreeing: (m, 2) patches of target and source, a
    pair a plane.
    """
    rotations, shifts, turn, plane, start = _starts(target, source, how, turning, r, t, agreeing)
    areas, score, nowhere = np.zeros((start.size, 2)), np.zeros(start.size), np.zeros(3)
    seen, along, unturned = (target.seen, source.seen), target.patches.basis[plane], turn == 0.0
    counts = np.empty((target.patches.n_points.size, source.patches.n_points.size), np.int64)
    for c in np.argsort(-start, kind="mergesort"):
        known, alike_mm = False, turning.distinct_mm if unturned[c] else np.inf
        for k in range(start.size):
            if score[k] > turning.needed and is_nearly_free(areas[k]):
                known = known or are_same(
                    rotations[c], shifts[c], rotations[k], shifts[k], nowhere,
                    turning.distinct_rad, alike_mm,
                )  # fmt: skip
        if known:
            continue
        hopeful = _move_to_fit(
            target, source, how, turning, rotations[c], shifts[c], along[c], counts
        )
        if not hopeful or (unturned[c] and _distance(shifts[c], t) < REPEATED_MM):
            continue
        compare_both(*seen, how, rotations[c], shifts[c], turning.tolerance_mm, 1, counts, areas[c])
        score[c] = score_of(how, areas[c])
    return Turned(rotations, shifts, unturned, along, areas, score)


@compiled
def is_nearly_free(areas: FloatArray) -> bool:
    """Whether a pose may be where it belongs, but for a few mm: areas (2,) as of compare_both."""
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
) -> tuple[FloatArray, FloatArray, FloatArray, IntArray, FloatArray]:
    """Rotations (n, 3, 3) and shifts (n, 3) of a pose turned about its planes, or not, to be moved.

    With them the turn (n,) in rad, the patch (n,) about whose normal it is, and the pose's score
    (n,) by some samples.
    """
    a, b, turns = target.patches, source.patches, turning.turns_rad
    seen = (target.seen, source.seen)
    few, some, tolerance_mm = turning.strides[0], turning.strides[1], turning.tolerance_mm
    pairs = pairs_in_planes(
        a, b, turning.patches, turning.cos_alike, turning.apart_mm, r, t, agreeing
    )
    room = pairs.shape[0] * turns.size
    rotations, shifts, plane = np.empty((room, 3, 3)), np.empty((room, 3)), np.empty(room, np.int64)
    turn, start, step, nowhere = np.empty(room), np.empty(room), np.zeros(6), np.zeros(3)
    areas = np.empty(2)
    counts = np.empty((a.n_points.size, b.n_points.size), np.int64)
    level, turned, there = np.empty(counts.shape, np.bool_), np.empty((3, 3)), np.empty(3)
    n, first, apart_mm = 0, 0, turning.apart_mm + tolerance_mm
    while first < pairs.shape[0]:
        about, past = pairs[first, 2], first + 1
        while past < pairs.shape[0] and pairs[past, 2] == about:
            past += 1
        find_level(a, b, r, t, a.normal[about], apart_mm, level)
        for k in range(turns.size):
            step[:3] = turns[k] * a.normal[about]
            apply_step(step, r, nowhere, turned, there)
            if most_support(a, b, how, turned, level) < OFFERED * turning.needed:
                continue
            for i, j, _ in pairs[first:past]:
                for u in range(3):
                    there[u] = a.centroid_mm[i, u] - dot(turned[u], b.centroid_mm[j])
                if turns[k] == 0.0 and _distance(there, t) < REPEATED_MM:
                    continue
                # A few samples speak against most of them.
                compare_both(*seen, how, turned, there, tolerance_mm, few, counts, areas)
                if areas[SUPPORT] < max(WORTH_LOOKING * turning.needed, areas[CONTRADICTION]):
                    continue
                compare_both(*seen, how, turned, there, tolerance_mm, some, counts, areas)
                score = score_of(how, areas)
                free = areas[CONTRADICTION] <= FAR_OFF * areas[SUPPORT]
                if free and score >= WORTH_MOVING * turning.needed:
                    rotations[n], shifts[n], turn[n], plane[n] = turned, there, turns[k], about
                    start[n] = score
                    n += 1
        first = past
    return rotations[:n], shifts[:n], turn[:n], plane[:n], start[:n]


@compiled
def _distance(a: FloatArray, b: FloatArray) -> float:
    return float(np.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2))


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
) -> bool:
    """Move a pose along two directions (2, 3) to a better score: t (3,) is changed in place.

    Returns False where steps lead to so little that it is given up.
    """
    seen, some, there, trial = (target.seen, source.seen), np.empty(2), np.empty(2), np.empty(3)
    tolerance_mm, stride = turning.tolerance_mm, 0
    best, step_mm = 0.0, WIDEST_STEP_MM
    in_vain = np.empty((2, 2), np.bool_)  # ways that lead to no better place from here
    for _ in range(MOST_ROUNDS):
        if step_mm < LEAST_STEP_MM:
            break
        wanted = turning.strides[1] if step_mm > FINE_MM else turning.strides[2]
        if wanted != stride:
            stride = wanted
            compare_both(*seen, how, r, t, tolerance_mm, stride, counts, there)
            best = score_of(how, there)
            in_vain[:] = False
            if step_mm <= FINE_MM and not _reaches(best, there, turning, BEFORE_FINE_STEPS):
                return False
        for axis in range(2):
            for way in range(2):
                if in_vain[axis, way]:
                    continue
                for u in range(3):
                    trial[u] = t[u] + (2 * way - 1) * step_mm * along[axis, u]
                compare_both(*seen, how, r, trial, tolerance_mm, stride, counts, some)
                score = score_of(how, some)
                in_vain[axis, way] = True
                if score > best:
                    best = score
                    t[:], there[:] = trial, some
                    in_vain[:] = False
                    in_vain[axis, 1 - way] = True  # back to where it was
        if in_vain.all():
            if step_mm <= FINE_MM and not _reaches(best, there, turning, AFTER_FINE_STEPS):
                return False
            step_mm *= 0.5
            in_vain[:] = False
    return True


@compiled
def _reaches(
    score: float, areas: FloatArray, turning: Turning, wanted: tuple[float, float]
) -> bool:
    """Whether a pose has such a share of the score it needs, and no more against it than that."""
    least, most = wanted
    free = areas[CONTRADICTION] <= most * areas[SUPPORT]
    return bool(free and score >= least * turning.needed)
