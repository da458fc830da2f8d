"""Whether the best pose is an answer: shared surface, free space, open directions, rivals."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform

from registration.gauss_sphere.judging.open_directions import (
    NOTHING_OPEN,
    is_elsewhere,
    uncertainty,
)
from registration.gauss_sphere.params import DecisionParams
from registration.gauss_sphere.planes.patches import Patches
from registration.gauss_sphere.refinement.matching import Settled
from registration.gauss_sphere.refinement.verification import CONTRADICTION, SUPPORT
from registration.gauss_sphere.view import View
from registration.kernels import compiled
from registration.result import Candidate, RegistrationResult, Status
from registration.scan import FloatArray, IntArray


class Verdict(NamedTuple):
    """What is said of the best of some poses: see RegistrationResult for each."""

    status: Status
    reason: str = ""
    stage: str = ""
    covariance: FloatArray | None = None
    undetermined: FloatArray = NOTHING_OPEN


def judge(
    ranked: list[Settled],
    target: View,
    source: View,
    params: DecisionParams,
    appeal: bool = False,
) -> Verdict:
    """Whether the best of the settled poses is an answer, and how sure it is.

    appeal: outlines have been asked, too: each pose that they leave is a rival, on less surface,
        unless it slides and many planes agree on the best.
    """
    best = ranked[0]
    against = shortcoming(best, target, source, params)
    if against:
        return Verdict("failed", against, "verification")
    covariance, open_directions, reason = uncertainty(best, best.sure, target, params)
    rivals = [p for p in ranked[1:] if is_rival(p, best, target, params, appeal)]
    if open_directions.shape[0]:
        alike = [p for p in rivals if p.score > params.rival_share * best.score]
        others = [p for p in alike if is_elsewhere(p, best, open_directions, target, params)]
        besides = _others(best, others)
        return Verdict("underdetermined", reason + besides, "scene", undetermined=open_directions)
    return questioned(covariance, best, rivals) if rivals else Verdict("ok", covariance=covariance)


def questioned(covariance: FloatArray | None, best: Settled, rivals: list[Settled]) -> Verdict:
    """What is left of an answer that other poses could be, too, the best of them first."""
    return Verdict(
        "ambiguous",
        f"{len(rivals) + 1} poses fit about equally well: the scanned part is symmetric or "
        f"repeats itself, or too little is shared; the best of the others scores "
        f"{rivals[0].score / best.score:.0%} of the first",
        "decision",
        covariance,
    )


def preferred(covariance: FloatArray | None, answer: Settled, better: list[Settled]) -> Verdict:
    """What is left of an answer that ends of faces prefer to poses of higher score, best first."""
    return Verdict(
        "ambiguous",
        "ends of faces prefer the first pose, and more surface another, on which nearly as many "
        f"planes agree: it scores {better[0].score / answer.score:.0%} of the first; a thing may "
        "have been moved between the scans, or each view sees another of like things",
        "decision",
        covariance,
    )


def outscored(covariance: FloatArray | None, answer: Settled, better: list[Settled]) -> Verdict:
    """What is left of an answer that planes fix if what slides on fewer scores more, best first."""
    return Verdict(
        "ambiguous",
        "more planes agree on the first pose, and more surface on another, which leaves a "
        f"direction open: it scores {better[0].score / answer.score:.0%} of the first",
        "decision",
        covariance,
    )


def _others(best: Settled, rivals: list[Settled]) -> str:
    """What to say besides of other poses that fit about as well, the best of them first."""
    if not rivals:
        return ""
    number = f"{len(rivals)} other poses fit" if len(rivals) > 1 else "another pose fits"
    share = rivals[0].score / best.score
    return f"; besides, {number} about equally well, with {share:.0%} of the score of the first"


def shortcoming(best: Settled, target: View, source: View, params: DecisionParams) -> str:
    """Why a pose is no answer, whatever the others are: too little for it, or too much against."""
    share = best.areas[SUPPORT] / mean_seen_mm2(target, source)
    against = best.areas[CONTRADICTION] / max(best.areas[SUPPORT], 1e-9)
    if share < params.least_support:
        return (
            f"the best pose lays only {share:.0%} of the seen surface on the other view's; "
            f"{params.least_support:.0%} are needed: the views may not overlap"
        )
    if against > params.most_contradiction:
        return (
            f"the best pose puts surface in space that the other view saw to be empty, "
            f"{against:.0%} of the surface it matches; {params.most_contradiction:.0%} are allowed"
        )
    if share >= params.large_support or has_sure_planes(best, target, params):
        return ""
    agreeing = agreeing_planes(best, target, params)
    return (
        f"{agreeing} planes agree on {share:.0%} of the seen surface, as planes of unrelated "
        f"scenes may; {params.sure_planes} planes or {params.large_support:.0%} are needed"
    )


def has_sure_planes(pose: Settled, target: View, params: DecisionParams) -> bool:
    """Whether as many planes agree on a pose as those of other places hardly do."""
    agreeing = agreeing_planes(pose, target, params)
    enough = params.sure_planes - 1 if is_plain(pose, params) else params.sure_planes
    return agreeing >= enough


def is_plain(pose: Settled, params: DecisionParams) -> bool:
    """Whether a pose puts next to nothing in free space."""
    return bool(pose.areas[CONTRADICTION] <= params.plain_contradiction * pose.areas[SUPPORT])


def is_thin(pose: Settled, target: View, source: View, params: DecisionParams) -> bool:
    """Whether too little speaks for a pose that outlines had to place.

    Fewer than params.appeal_planes planes are too few on any surface, and few ones on little of it.
    """
    if agreeing_planes(pose, target, params) < params.appeal_planes:
        return True
    share = pose.areas[SUPPORT] / mean_seen_mm2(target, source)
    return bool(share < params.appeal_support and not has_sure_planes(pose, target, params))


def fixed_first(
    settled: list[Settled], target: View, source: View, params: DecisionParams
) -> list[Settled]:
    """The settled poses, an answer that many planes fix before the best if that slides on fewer.

    What slides agrees with any scene, and may do so on a little more surface.
    """
    best, *others = settled
    if not uncertainty(best, best.sure, target, params)[1].size:
        return settled
    fewer = agreeing_planes(best, target, params)
    for pose in others:
        if (
            pose.score > params.rival_share * best.score
            and agreeing_planes(pose, target, params) > fewer
            and has_sure_planes(pose, target, params)
            and not shortcoming(pose, target, source, params)
            and not uncertainty(pose, pose.sure, target, params)[1].size
        ):
            return [pose, *(other for other in settled if other is not pose)]
    return settled


def is_weak(best: Settled, target: View, source: View, params: DecisionParams) -> bool:
    """Whether a pose is no answer, or one on so little surface that there may be better ones."""
    share = best.areas[SUPPORT] / mean_seen_mm2(target, source)
    return bool(share < params.weak_support or shortcoming(best, target, source, params))


def mean_seen_mm2(target: View, source: View) -> float:
    """Surface that a view sees, in the mean of both."""
    return 0.5 * (target.seen_mm2 + source.seen_mm2)


def refuted(share: float) -> Verdict:
    """What is left of an answer when outlines of faces deny it, by a share of what they say."""
    return Verdict(
        "failed",
        f"the best pose is denied by {share:.0%} of the outlines of faces that both views tell of: "
        "faces of one view go on, or are missing, where the other saw them end",
        "verification",
    )


def answered(
    verdict: Verdict, poses: list[Settled], target: View, source: View
) -> RegistrationResult:
    """The answer of a verdict on poses, best first, scored by the share of the seen surface."""
    seen = mean_seen_mm2(target, source)
    candidates = tuple(map(Candidate, transforms(poses), (pose.score / seen for pose in poses)))
    if verdict.status == "failed":
        return RegistrationResult(None, candidates=candidates, **verdict._asdict())
    first, *others = candidates
    return RegistrationResult(first.T_target_source, candidates=tuple(others), **verdict._asdict())


def agreeing_planes(pose: Settled, target: View, params: DecisionParams) -> int:
    """Number of different planes that agree within their noise: pieces of one plane are one."""
    return len(agreeing_patches(pose, target, params))


def agreeing_patches(pose: Settled, target: View, params: DecisionParams) -> IntArray:
    """(m, 2) pairs that agree within their noise, one of each different plane of the target."""
    return _agreeing(
        target.patches,
        pose.pairs,
        pose.distance2,
        params.agreeing_distance2,
        params.same_plane_rad,
        params.same_plane_mm,
    )


@compiled
def _agreeing(
    patches: Patches,
    pairs: IntArray,
    distance2: FloatArray,
    agreeing2: float,
    same_rad: float,
    same_mm: float,
) -> IntArray:
    """The pairs (m, 2) within a squared distance, the first of each different plane."""
    different, n = np.empty_like(pairs), 0
    for c in range(distance2.size):
        if not distance2[c] < agreeing2:
            continue
        i, new = pairs[c, 0], True
        for k in different[:n, 0]:
            away2 = 0.0
            for u in range(3):
                away2 += (patches.normal[i, u] - patches.normal[k, u]) ** 2
            apart = abs(patches.offset_mm[i] - patches.offset_mm[k]) > same_mm
            new = new and (np.sqrt(away2) > same_rad or apart)
        if new:
            different[n] = pairs[c]
            n += 1
    return different[:n]


def is_rival(
    pose: Settled, best: Settled, target: View, params: DecisionParams, appeal: bool = False
) -> bool:
    """Whether a pose could be the true one in place of the best.

    A symmetry makes poses alike in all: score, free space and how far planes fix them. A pose that
    slides freely on two planes agrees with any scene; it does not question one that many planes
    agree on to within their noise.
    appeal: it was left by outlines, too, and is one on less surface.
    """
    if repeats(pose, best, target, params):
        return True
    if pose.score <= (params.repeat_share if appeal else params.rival_share) * best.score:
        return False
    if not appeal and pose.areas[CONTRADICTION] > params.most_contradiction * pose.areas[SUPPORT]:
        return False
    if agreeing_planes(best, target, params) < params.sure_planes:
        return True
    return not bool(uncertainty(pose, pose.information, target, params)[1].size)


def repeats(pose: Settled, best: Settled, target: View, params: DecisionParams) -> bool:
    """Whether a pose lays about as many planes on each other as the best, on less surface.

    Where a scene repeats itself, as shelves and rows of boxes do, a pose that is off by a period
    differs from the true one in how much the views share, and not in how well they agree on it.
    Three planes, as of a corner, agree with those of any other corner, four with those of a cube's
    next sides, if nothing speaks against it: of so few planes one less makes a pose a rival.
    """
    if pose.score <= params.repeat_share * best.score:
        return False
    if pose.areas[CONTRADICTION] > params.repeat_contradiction * pose.areas[SUPPORT]:
        return False
    agreeing = agreeing_planes(pose, target, params)
    planes = agreeing_planes(best, target, params)
    few = planes < params.sure_planes
    if few and (planes < params.sure_planes - 1 or is_plain(pose, params)):
        return agreeing >= planes - 1
    if agreeing < max(params.sure_planes - 1, params.repeat_planes * planes):
        return False
    # A pose that slides is easily like another: more must speak for it, and less against it.
    if not uncertainty(pose, pose.information, target, params)[1].size:
        return True
    return bool(
        agreeing >= max(params.sure_planes, params.sliding_planes * planes)
        and pose.areas[CONTRADICTION] <= params.sliding_contradiction * pose.areas[SUPPORT]
    )


def transforms(poses: list[Settled]) -> RigidTransform:
    """The poses as as many transforms."""
    matrix = np.zeros((len(poses), 4, 4))
    matrix[:, 3, 3] = 1.0
    matrix[:, :3, :3] = [pose.rotation for pose in poses]
    matrix[:, :3, 3] = [pose.shift_mm for pose in poses]
    # As they are: refined poses are rotations to the last bits, and to check it costs more.
    return RigidTransform(matrix, normalize=False)
