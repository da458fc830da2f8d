"""A rough pose settled: which planes it lays on each other, and the pose that these make likely."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from registration.gauss_sphere.params import MatchParams, RefineParams, VerificationParams
from registration.gauss_sphere.refine import (
    Likelihood,
    likelihood,
    maximise,
    maximise_consistently,
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
    information: (6, 6) of a perturbation (rad, mm) on the left, about the target's origin.
    floor_mm: systematic error of a plane's offset under which the matched planes agree.
    pairs: (m, 2) target and source patch; distance2: (m,) their squared Mahalanobis distances.
    areas: (4,) mm^2 of support, contradiction, hidden, outside.
    score: support less weighted contradiction, mm^2.
    """

    rotation: FloatArray
    shift_mm: FloatArray
    information: FloatArray
    floor_mm: float
    pairs: IntArray
    distance2: FloatArray
    areas: FloatArray
    score: float


def settle(
    target: View,
    source: View,
    rotation: FloatArray,
    shift_mm: FloatArray,
    match: MatchParams,
    refine: RefineParams,
    verification: VerificationParams,
    least_score: float = -np.inf,
) -> Settled | None:
    """Match planes by the samples that fall on them and refine, with shrinking tolerance.

    None where fewer than two planes match, or where the score, after the first refinements, is
    below least_score: another pose is known to be much better.
    """
    r, t = rotation.copy(), shift_mm.copy()
    information, areas = np.zeros((6, 6)), np.zeros(4)
    capacity = target.patches.n_points.size * source.patches.n_points.size
    pairs = np.zeros((capacity, 2), dtype=np.int64)
    distance2 = np.zeros(capacity)
    n, floor_mm = _settle(
        target,
        source,
        comparison(verification),
        likelihood(refine),
        np.asarray(match.tolerances_mm),
        np.asarray(match.floors_mm),
        np.asarray(match.strides),
        np.asarray(refine.floors_mm),
        match.least_samples,
        least_score,
        r,
        t,
        information,
        pairs,
        distance2,
        areas,
    )
    if n < 2:
        return None
    score = float(areas[SUPPORT] - verification.contradiction_weight * areas[CONTRADICTION])
    return Settled(r, t, information, floor_mm, pairs[:n], distance2[:n], areas, score)


@compiled
def _settle(
    target: View,
    source: View,
    how: Comparison,
    likely: Likelihood,
    tolerances: FloatArray,
    rough_floors: FloatArray,
    strides: IntArray,
    floors: FloatArray,
    least: int,
    least_score: float,
    r: FloatArray,
    t: FloatArray,
    information: FloatArray,
    pairs: IntArray,
    distance2: FloatArray,
    areas: FloatArray,
) -> tuple[int, float]:
    counts = np.zeros((target.patches.n_points.size, source.patches.n_points.size), np.int64)
    n = 0
    for stage in range(tolerances.size):
        compare_both(target, source, how, r, t, tolerances[stage], strides[stage], counts, areas)
        n = 0
        for i in range(counts.shape[0]):
            for k in range(counts.shape[1]):
                if counts[i, k] >= least:
                    pairs[n, 0], pairs[n, 1] = i, k
                    n += 1
        score = areas[SUPPORT] - how.contradiction_weight * areas[CONTRADICTION]
        if n < 2 or (stage > 1 and score < least_score):
            return 0, 0.0
        maximise(
            target.patches,
            source.patches,
            pairs[:n],
            likely,
            rough_floors[stage],
            r,
            t,
            information,
            distance2,
        )
    floor = maximise_consistently(
        target.patches, source.patches, pairs[:n], likely, floors, r, t, information, distance2
    )
    compare_both(target, source, how, r, t, tolerances[-1], 1, counts, areas)
    return n, floor
