"""Rough poses settled: which planes they lay on each other, and the pose that these make likely."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from registration.gauss_sphere.candidates.translation import search_of
from registration.gauss_sphere.fan.calibrated import read_known
from registration.gauss_sphere.params import DecisionParams, GaussSphereParams
from registration.gauss_sphere.planes.patches import middle
from registration.gauss_sphere.refinement.poses import are_same
from registration.gauss_sphere.refinement.refine import likelihood
from registration.gauss_sphere.refinement.settling import Effort, settle_all
from registration.gauss_sphere.refinement.verification import compared, comparison
from registration.gauss_sphere.view import View
from registration.scan import FloatArray, IntArray


class Settled(NamedTuple):
    """A pose, the planes it matches, and what the scans say of it.

    rotation (3, 3), shift_mm (3,): p_target = R p_source + t.
    information: (6, 6) of a perturbation (rad, mm) on the left, about the target's origin, by the
        planes that agree; sure: (6, 6) the same with all their disagreement taken into account.
    floor_mm: systematic error of a plane's offset under which the matched planes agree.
    pairs: (m, 2) target and source patch; distance2: (m,) their squared Mahalanobis distances.
    areas: (2,) mm^2 of support and contradiction.
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


def settle_best(
    target: View,
    source: View,
    rotations: FloatArray,
    shifts_mm: FloatArray,
    params: GaussSphereParams,
    *,
    look_again: bool = True,
) -> list[Settled]:
    """Settle the candidates by falling score until the rest cannot rival the best.

    Planes are matched by the samples that fall on them, and the pose refined by them, with
    shrinking tolerance. Best first; poses that are nearly the same are one.
    look_again: for other shifts at the rotation of the best, as of scenes that repeat themselves:
        the first search looks along many rotations, none known well, and does not see them all.
    """
    verification, match, decision = params.verification, params.match, params.decision
    effort = Effort(
        verification.rough_tolerance_mm,
        verification.rough_stride,
        verification.ranked,
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
    found, kept = settle_all(
        target,
        source,
        comparison(verification),
        likelihood(params.refine),
        floors_of(params),
        effort,
        search_of(params.wide, params.wide.kept if look_again else 0),
        rotations,
        shifts_mm,
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
                found.pairs[c, :n].copy(),
                found.distance2[c, :n].copy(),
                found.areas[c],
                float(found.score[c]),
            )
        )
    return settled


def different(poses: list[Settled], source: View, params: DecisionParams) -> list[Settled]:
    """The poses, best first, without those that are nearly the same as a better one."""
    centre, kept = middle(source.patches), list[Settled]()
    within = params.distinct_rad, params.distinct_mm
    for one in sorted(poses, key=lambda pose: -pose.score):
        known = (are_same(one.rotation, one.shift_mm, other.rotation, other.shift_mm, centre,
                          *within) for other in kept)  # fmt: skip
        if not any(known):
            kept.append(one)
    return kept


def scored(pose: Settled, target: View, source: View, params: GaussSphereParams) -> Settled:
    """The pose with what the scans say of it where it is now."""
    areas, score = compared(
        target, source, pose.rotation, pose.shift_mm, params.match.tolerances_mm[-1],
        params.verification,
    )  # fmt: skip
    return pose._replace(areas=areas, score=score)


def floors_of(params: GaussSphereParams) -> FloatArray:
    """(n,) systematic errors of planes to try, in mm: none below what a calibration leaves."""
    return _floors_mm(params.refine.floors_mm, read_known(params.calibration).known_to_mm)


@lru_cache(maxsize=8)
def _floors_mm(floors_mm: tuple[float, ...], known_to_mm: float) -> FloatArray:
    return np.unique(np.maximum(floors_mm, known_to_mm))
