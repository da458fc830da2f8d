"""Settled poses judged: by planes, by ends of faces where planes leave doubt, by symmetries."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from registration.gauss_sphere.judging.appeal import appealed, outscoring
from registration.gauss_sphere.judging.bending import doubted, of_unknown_bias
from registration.gauss_sphere.judging.decision import (
    Verdict,
    fixed_first,
    outscored,
    preferred,
    questioned,
    refuted,
)
from registration.gauss_sphere.judging.free_planes import judged_by_free_planes
from registration.gauss_sphere.judging.further_along import unsaid_along
from registration.gauss_sphere.judging.misfits import without_misfits
from registration.gauss_sphere.judging.open_directions import covariance_of, widest_covariance_of
from registration.gauss_sphere.judging.symmetry import symmetric_rivals
from registration.gauss_sphere.outlines.ends import as_ends
from registration.gauss_sphere.outlines.telling import outlines_of
from registration.gauss_sphere.outlines.testimony import denied_share, is_doubtful
from registration.gauss_sphere.params import DecisionParams, GaussSphereParams
from registration.gauss_sphere.planes.patches import middle
from registration.gauss_sphere.refinement.matching import Settled, different
from registration.gauss_sphere.view import View


def judged(
    settled: list[Settled], target: View, source: View, bias_mm: float, params: GaussSphereParams
) -> tuple[list[Settled], Verdict, tuple[str, ...]]:
    """The settled poses that are left, best first, what is said of the best, and notes on it.

    bias_mm: what is seen of a bias of the planes.
    """
    settled, verdict, further = _by_planes_and_ends(settled, target, source, bias_mm, params)
    notes: tuple[str, ...] = ()
    if verdict.status == "ok":
        settled, verdict, notes = _unless_symmetric(
            settled, further, verdict, target, source, bias_mm, params
        )
    if bias_mm == 0.0 and not params.calibration:
        verdict = _of_unknown_bias(verdict, settled[0], target, source, params)
    return settled, verdict, notes


def _by_planes_and_ends(
    settled: list[Settled], target: View, source: View, bias_mm: float, params: GaussSphereParams
) -> tuple[list[Settled], Verdict, list[Settled]]:
    """Judge poses by planes, and by outlines where planes leave doubt or ends of faces raise it.

    With them go poses further along, of which the scans say nothing but that they allow them.
    """
    settled, verdict = judged_by_free_planes(settled, target, source, params)
    best = settled[0]
    pose, how, denied = (best.rotation, best.shift_mm, target, source), params.outlines, 0.0
    if verdict.status == "ok" and not is_doubtful(*pose, how):
        return settled, verdict, []
    outlines = outlines_of(target, how), outlines_of(source, how)
    if verdict.status == "ok":
        denied = denied_share(*pose, outlines, how)
        if denied <= how.refuted_share:
            return settled, verdict, []
    left = appealed(settled, target, source, outlines, bias_mm, params)
    if not left:
        if verdict.status in ("ok", "failed"):
            return settled, refuted(denied) if verdict.status == "ok" else verdict, []
        return *_by_number_of_planes(settled, target, source, bias_mm, params), []
    left, verdict = judged_by_free_planes(left, target, source, params, appeal=True)
    if verdict.status != "ok":
        return left, verdict, []
    better = outscoring(settled, left[0], target, source, params.decision)
    if better:
        others = different([*left[1:], *better], source, params.decision)
        return [left[0], *others], preferred(verdict.covariance, left[0], better), []
    ends = as_ends(outlines[0]), as_ends(outlines[1])
    return left, verdict, unsaid_along(left[0], target, source, ends, bias_mm, params)


def _by_number_of_planes(
    settled: list[Settled], target: View, source: View, bias_mm: float, params: GaussSphereParams
) -> tuple[list[Settled], Verdict]:
    """Judge poses of which outlines do not tell: what many planes fix before what slides on few."""
    best, *others = settled
    fitted = [best, *(_fitted(pose, target, source, bias_mm, params) for pose in others)]
    left = fixed_first(fitted, target, source, params.decision)
    left, verdict = judged_by_free_planes(left, target, source, params)
    better = [pose for pose in left[1:] if pose.score > left[0].score]
    if verdict.status == "ok" and better:
        verdict = outscored(verdict.covariance, left[0], better)
    return left, verdict


def _fitted(
    pose: Settled, target: View, source: View, bias_mm: float, params: GaussSphereParams
) -> Settled:
    """A pose by the planes that fit it, as sure as what is seen of a bias allows."""
    pose = without_misfits(pose, target, source, params)
    return doubted(pose, target.patches, source.patches, bias_mm, params) if bias_mm > 0.0 else pose


def _unless_symmetric(
    settled: list[Settled],
    further: list[Settled],
    verdict: Verdict,
    target: View,
    source: View,
    bias_mm: float,
    params: GaussSphereParams,
) -> tuple[list[Settled], Verdict, tuple[str, ...]]:
    """The verdict, "ambiguous" if few planes would have the best pose turned or further along, too.

    Then all poses are ordered anew: another one may fit better. With it goes a note on a pose of
    which the scans say nothing more than that they allow it, of those further along or others.
    """
    decision = params.decision
    rivals, unsaid = symmetric_rivals(settled, target, source, params)
    unsaid = different([*further, *unsaid], source, decision)
    alike = different([settled[0], *rivals], source, decision)
    if len(alike) == 1:
        others = different([*unsaid, *settled[1:]], source, decision) if unsaid else settled[1:]
        return [settled[0], *others], verdict, _told(settled[0], unsaid, source, decision)
    poses = different([*alike, *settled[1:]], source, decision)
    if bias_mm > 0.0 and poses[0] is not settled[0] and poses[0].pairs.size:
        poses[0] = doubted(poses[0], target.patches, source.patches, bias_mm, params)
    covariance = covariance_of(poses[0], target, decision)
    return poses, questioned(covariance, alike[0], alike[1:]), ()


def _told(
    best: Settled, unsaid: list[Settled], source: View, params: DecisionParams
) -> tuple[str, ...]:
    """A note on the first of the poses that nothing speaks for or against, if there is any."""
    if not unsaid:
        return ()
    turn = Rotation.from_matrix(unsaid[0].rotation @ best.rotation.T).magnitude()
    turned, share = turn > params.distinct_rad, unsaid[0].score / best.score
    centre = middle(source.patches)
    away = (unsaid[0].rotation - best.rotation) @ centre + unsaid[0].shift_mm - best.shift_mm
    moved_mm = np.linalg.norm(away)
    how = f"turned by {np.rad2deg(turn):.0f} degrees" if turned else f"moved by {moved_mm:.0f} mm"
    return (
        f"{how}, the pose has {share:.0%} of its score, and no end of a face says "
        "which is right: if the views may lie far apart, see the candidates",
    )


def _of_unknown_bias(
    verdict: Verdict, best: Settled, target: View, source: View, params: GaussSphereParams
) -> Verdict:
    """The verdict with a covariance that allows for a bias of which no calibration tells."""
    if verdict.covariance is None:
        return verdict
    unsure = of_unknown_bias(best, target.patches, source.patches, params)
    covariance = widest_covariance_of(unsure, target, params.decision)
    return verdict if covariance is None else verdict._replace(covariance=covariance)
