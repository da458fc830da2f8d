"""How rough poses are settled: compared with the views, refined by the planes that they match."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from registration.gauss_sphere.candidates.shift_search import Search
from registration.gauss_sphere.candidates.translation import shifts_at
from registration.gauss_sphere.planes.patches import Patches
from registration.gauss_sphere.refinement.chance import take_chance
from registration.gauss_sphere.refinement.poses import are_same
from registration.gauss_sphere.refinement.refine import (
    ROUGHLY,
    Likelihood,
    maximise,
    maximise_consistently,
    widened,
)
from registration.gauss_sphere.refinement.verification import Comparison, compare_both, score_of
from registration.gauss_sphere.view import View
from registration.kernels import compiled
from registration.scan import FloatArray, IntArray


class Effort(NamedTuple):
    """Parameters of settling as the compiled loops take them.

    rough_tolerance_mm, rough_stride, ranked, kept, worth_settling, worth_refining: see
        VerificationParams.
    tolerances_mm, floors_mm, strides, least_samples: see MatchParams.
    distinct_rad, distinct_mm: poses closer than this are one; they are compared at middle_mm (3,).
    """

    rough_tolerance_mm: float
    rough_stride: int
    ranked: int
    kept: int
    worth_settling: float
    worth_refining: float
    tolerances_mm: FloatArray
    floors_mm: FloatArray
    strides: IntArray
    least_samples: int
    distinct_rad: float
    distinct_mm: float
    middle_mm: FloatArray


class Matches(NamedTuple):
    """What settling fills in for each pose: the fields of Settled, one more axis in front."""

    rotation: FloatArray
    shift_mm: FloatArray
    information: FloatArray
    sure: FloatArray
    floor_mm: FloatArray
    n_pairs: IntArray
    pairs: IntArray
    distance2: FloatArray
    areas: FloatArray
    score: FloatArray


@compiled
def _same(effort: Effort, ra: FloatArray, ta: FloatArray, rb: FloatArray, tb: FloatArray) -> bool:
    return are_same(ra, ta, rb, tb, effort.middle_mm, effort.distinct_rad, effort.distinct_mm)


@compiled
def _known(effort: Effort, found: Matches, n: int, r: FloatArray, t: FloatArray) -> bool:
    known = False
    for c in range(n):
        known = known or _same(effort, found.rotation[c], found.shift_mm[c], r, t)
    return known


@compiled
def settle_all(
    target: View,
    source: View,
    how: Comparison,
    likely: Likelihood,
    floors: FloatArray,
    effort: Effort,
    again: Search,
    rotations: FloatArray,
    shifts: FloatArray,
) -> tuple[Matches, IntArray]:
    """Settle candidates, then shifts that are found again at the best rotation, if they may rival.

    again: how these are looked for, with none to keep for not at all.
    Returns the poses found, and which of them are different, best first.
    """
    n_a, n_b = target.patches.n_points.size, source.patches.n_points.size
    capacity = effort.kept * (2 if again.kept_per_rotation > 0 else 1)
    # Each sample counts for one pair, so no more pairs than this can have enough of them.
    n_samples = target.seen.sample_area.size + source.seen.sample_area.size
    most_pairs = min(n_a * n_b, n_samples // effort.least_samples)
    found = Matches(
        np.empty((capacity, 3, 3)),
        np.empty((capacity, 3)),
        np.zeros((capacity, 6, 6)),
        np.zeros((capacity, 6, 6)),
        np.empty(capacity),
        np.empty(capacity, np.int64),
        np.empty((capacity, most_pairs, 2), np.int64),
        np.empty((capacity, most_pairs)),
        np.empty((capacity, 2)),
        np.empty(capacity),
    )
    counts = np.zeros((n_a, n_b), np.int64)
    none = int(np.int64(0))  # with a plain 0 all would be compiled for that literal, too
    n = _settle_more(
        target, source, how, likely, floors, effort, counts, found, none, rotations, shifts
    )
    if n > 0 and again.kept_per_rotation > 0:
        best = found.rotation[np.argmax(found.score[:n])]
        shifts = shifts_at(target.patches, source.patches, best, again)
        rotations = np.empty((shifts.shape[0], 3, 3))
        rotations[:] = best
        n = _settle_more(
            target, source, how, likely, floors, effort, counts, found, n, rotations, shifts
        )
    order = np.argsort(-found.score[:n], kind="mergesort")
    kept, n_kept = np.empty(n, np.int64), 0
    for c in order:
        new = True
        for other in kept[:n_kept]:
            new = new and not _same(
                effort, found.rotation[other], found.shift_mm[other], found.rotation[c],
                found.shift_mm[c],
            )  # fmt: skip
        if new:
            kept[n_kept] = c
            n_kept += 1
    return found, kept[:n_kept]


@compiled
def _settle_more(
    target: View,
    source: View,
    how: Comparison,
    likely: Likelihood,
    floors: FloatArray,
    effort: Effort,
    counts: IntArray,
    found: Matches,
    n: int,
    rotations: FloatArray,
    shifts: FloatArray,
) -> int:
    """Settle candidates that may rival each other and the n poses found; how many they are then."""
    new = np.empty(shifts.shape[0], np.int64)
    score = np.empty(new.size)
    ranked, areas = 0, np.empty(2)
    for c in range(new.size):
        if ranked < effort.ranked and not _known(effort, found, n, rotations[c], shifts[c]):
            compare_both(
                target.seen, source.seen, how, rotations[c], shifts[c],
                effort.rough_tolerance_mm, effort.rough_stride, counts, areas,
            )  # fmt: skip
            new[ranked], score[ranked] = c, score_of(how, areas)
            ranked += 1
    best = -np.inf
    for c in range(n):
        best = max(best, found.score[c])
    for k in np.argsort(-score[:ranked], kind="mergesort")[: effort.kept]:
        if n > 0 and score[k] < effort.worth_settling * best:
            break
        r, t = rotations[new[k]], shifts[new[k]]
        if _known(effort, found, n, r, t):
            continue
        found.rotation[n], found.shift_mm[n] = r, t
        least = effort.worth_settling * max(best, 0.0)
        if not _settle(target, source, how, likely, effort, least, counts, found, n):
            continue
        # Only those that may be the answer, or question it, are refined to the end.
        if n == 0 or found.score[n] >= effort.worth_refining * best:
            _finish(target, source, how, likely, floors, effort, counts, found, n)
            best = max(best, found.score[n])
            n += 1
    return n


@compiled
def _settle(
    target: View,
    source: View,
    how: Comparison,
    likely: Likelihood,
    effort: Effort,
    least_score: float,
    counts: IntArray,
    found: Matches,
    c: int,
) -> bool:
    """Settle pose c of found; whether it is new, matches two planes and may rival the others."""
    r, t, pairs, areas = found.rotation[c], found.shift_mm[c], found.pairs[c], found.areas[c]
    for stage in range(effort.tolerances_mm.size):
        compare_both(
            target.seen, source.seen, how, r, t, effort.tolerances_mm[stage],
            effort.strides[stage], counts, areas,
        )  # fmt: skip
        n = 0
        for i in range(counts.shape[0]):
            for k in range(counts.shape[1]):
                if counts[i, k] >= effort.least_samples:
                    pairs[n, 0], pairs[n, 1] = i, k
                    n += 1
        found.score[c] = score_of(how, areas)
        if n < 2 or (stage > 1 and found.score[c] < least_score):
            return False
        maximise(
            target.patches, source.patches, pairs[:n], likely, effort.floors_mm[stage], r, t,
            found.information[c], found.distance2[c], ROUGHLY,
        )  # fmt: skip
        found.n_pairs[c] = n
        # Many starts lead to one pose.
        if stage == 1 and _known(effort, found, c, r, t):
            return False
    return True


@compiled
def _finish(
    target: View,
    source: View,
    how: Comparison,
    likely: Likelihood,
    floors: FloatArray,
    effort: Effort,
    counts: IntArray,
    found: Matches,
    c: int,
) -> None:
    r, t, areas = found.rotation[c], found.shift_mm[c], found.areas[c]
    found.floor_mm[c] = make_likely(
        target.patches, source.patches, found.pairs[c, : found.n_pairs[c]], likely, floors, r, t,
        found.information[c], found.sure[c], found.distance2[c],
    )  # fmt: skip
    seen = target.seen, source.seen
    compare_both(*seen, how, r, t, effort.tolerances_mm[-1], 1, counts, areas)
    found.score[c] = score_of(how, areas)


@compiled
def make_likely(
    target: Patches,
    source: Patches,
    pairs: IntArray,
    likely: Likelihood,
    floors: FloatArray,
    r: FloatArray,
    t: FloatArray,
    information: FloatArray,
    sure: FloatArray,
    distance2: FloatArray,
) -> float:
    """Refine a pose to the end, in place, by pairs of planes (m, 2); the floor that they need.

    information, sure: (6, 6) and distance2: (m,) out, see Settled.
    """
    floor_mm = maximise_consistently(
        target, source, pairs, likely, floors, r, t, information, distance2
    )
    take_chance(target, source, pairs, likely, floor_mm, r, t, information)
    wide_mm = widened(target, source, pairs, likely, floor_mm, r, t, sure, 0.0)
    take_chance(target, source, pairs, likely, wide_mm, r, t, sure)
    return float(floor_mm)
