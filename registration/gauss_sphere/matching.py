"""Rough poses settled: which planes they lay on each other, and the pose that these make likely."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from registration.gauss_sphere.calibrated import read_known
from registration.gauss_sphere.chance import take_chance
from registration.gauss_sphere.params import GaussSphereParams
from registration.gauss_sphere.patches import middle
from registration.gauss_sphere.poses import are_same
from registration.gauss_sphere.refine import (
    ROUGHLY,
    Likelihood,
    likelihood,
    maximise,
    maximise_consistently,
    widened,
)
from registration.gauss_sphere.verification import (
    CONTRADICTION,
    SUPPORT,
    Comparison,
    View,
    compare_both,
    comparison,
)
from registration.kernels import compiled
from registration.scan import FloatArray, IntArray


class Settled(NamedTuple):
    """A pose, the planes it matches, and what the scans say of it.

    rotation (3, 3), shift_mm (3,): p_target = R p_source + t.
    information: (6, 6) of a perturbation (rad, mm) on the left, about the target's origin, by the
        planes that agree; sure: (6, 6) the same with all their disagreement taken into account.
    floor_mm: systematic error of a plane's offset under which the matched planes agree.
    pairs: (m, 2) target and source patch; distance2: (m,) their squared Mahalanobis distances.
    areas: (4,) mm^2 of support, contradiction, hidden, outside.
    score: support less weighted contradiction, mm^2.
    """

    rotation: FloatArray
    shift_mm: FloatArray
    information: FloatArray
    sure: FloatArray
    floor_mm: float
    pairs: IntArray
    distance2: FloatArray
    areas: FloatArray
    score: float


class Effort(NamedTuple):
    """Parameters of settling as the compiled loops take them.

    kept, worth_settling, worth_refining: see VerificationParams.
    tolerances_mm, floors_mm, strides, least_samples: see MatchParams.
    distinct_rad, distinct_mm: poses closer than this are one; they are compared at middle_mm (3,).
    """

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


def settle_best(
    target: View,
    source: View,
    rotations: FloatArray,
    shifts_mm: FloatArray,
    scores: FloatArray,
    params: GaussSphereParams,
) -> list[Settled]:
    """Settle the candidates by falling score until the rest cannot rival the best.

    Planes are matched by the samples that fall on them, and the pose refined by them, with
    shrinking tolerance. Best first; poses that are nearly the same are one.
    """
    verification, match, decision = params.verification, params.match, params.decision
    effort = Effort(
        verification.kept,
        verification.worth_settling,
        verification.worth_refining,
        np.asarray(match.tolerances_mm),
        np.asarray(match.floors_mm),
        np.asarray(match.strides),
        match.least_samples,
        decision.distinct_rad,
        decision.distinct_mm,
        middle(source.patches),
    )
    known_to_mm = read_known(params.calibration).known_to_mm
    floors_mm = np.unique(np.maximum(params.refine.floors_mm, known_to_mm))
    found, kept = _settle_best(
        target,
        source,
        comparison(verification),
        likelihood(params.refine),
        floors_mm,
        effort,
        rotations,
        shifts_mm,
        scores,
    )
    settled = []
    for c in kept:
        n = found.n_pairs[c]
        settled.append(
            Settled(
                found.rotation[c],
                found.shift_mm[c],
                found.information[c],
                found.sure[c],
                float(found.floor_mm[c]),
                found.pairs[c, :n],
                found.distance2[c, :n],
                found.areas[c],
                float(found.score[c]),
            )
        )
    return settled


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
def _settle_best(
    target: View,
    source: View,
    how: Comparison,
    likely: Likelihood,
    floors: FloatArray,
    effort: Effort,
    rotations: FloatArray,
    shifts: FloatArray,
    scores: FloatArray,
) -> tuple[Matches, IntArray]:
    n_a, n_b = target.patches.n_points.size, source.patches.n_points.size
    capacity = min(effort.kept, scores.size)
    found = Matches(
        np.empty((capacity, 3, 3)),
        np.empty((capacity, 3)),
        np.zeros((capacity, 6, 6)),
        np.zeros((capacity, 6, 6)),
        np.empty(capacity),
        np.empty(capacity, np.int64),
        np.empty((capacity, n_a * n_b, 2), np.int64),
        np.empty((capacity, n_a * n_b)),
        np.empty((capacity, 4)),
        np.empty(capacity),
    )
    counts = np.zeros((n_a, n_b), np.int64)
    best, n = -np.inf, 0
    for c in np.argsort(-scores, kind="mergesort")[:capacity]:
        if n > 0 and scores[c] < effort.worth_settling * best:
            break
        if _known(effort, found, n, rotations[c], shifts[c]):
            continue
        found.rotation[n] = rotations[c]
        found.shift_mm[n] = shifts[c]
        least = effort.worth_settling * max(best, 0.0)
        if not _settle(target, source, how, likely, effort, least, counts, found, n):
            continue
        # Only those that may be the answer, or question it, are refined to the end.
        if found.score[n] >= effort.worth_refining * best:
            _finish(target, source, how, likely, floors, effort, counts, found, n)
            best = max(best, found.score[n])
            n += 1
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
            target, source, how, r, t, effort.tolerances_mm[stage], effort.strides[stage], counts,
            areas,
        )  # fmt: skip
        n = 0
        for i in range(counts.shape[0]):
            for k in range(counts.shape[1]):
                if counts[i, k] >= effort.least_samples:
                    pairs[n, 0], pairs[n, 1] = i, k
                    n += 1
        found.score[c] = areas[SUPPORT] - how.contradiction_weight * areas[CONTRADICTION]
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
    found.floor_mm[c] = maximise_consistently(
        target.patches, source.patches, found.pairs[c, : found.n_pairs[c]], likely, floors, r, t,
        found.information[c], found.distance2[c],
    )  # fmt: skip
    pairs = found.pairs[c, : found.n_pairs[c]]
    take_chance(
        target.patches, source.patches, pairs, likely, found.floor_mm[c], r, t, found.information[c]
    )  # fmt: skip
    wide_mm = widened(
        target.patches, source.patches, pairs, likely, found.floor_mm[c], r, t, found.sure[c], 0.0
    )  # fmt: skip
    take_chance(target.patches, source.patches, pairs, likely, wide_mm, r, t, found.sure[c])
    compare_both(target, source, how, r, t, effort.tolerances_mm[-1], 1, counts, areas)
    found.score[c] = areas[SUPPORT] - how.contradiction_weight * areas[CONTRADICTION]
