"""The method, stage by stage: planes, Gauss spheres, rotation, translation, verification."""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter

import numpy as np
from scipy.spatial.transform import Rotation

from registration.gauss_sphere.appeal import appealed, outscoring
from registration.gauss_sphere.beams import seems_turned_around
from registration.gauss_sphere.bending import doubted, left_bias_mm, of_unknown_bias
from registration.gauss_sphere.calibrated import read_known
from registration.gauss_sphere.decision import (
    Verdict,
    answered,
    is_weak,
    preferred,
    questioned,
    refuted,
)
from registration.gauss_sphere.describing import describe
from registration.gauss_sphere.evidence import PlaneEvidence
from registration.gauss_sphere.free_planes import judged_by_free_planes
from registration.gauss_sphere.further_along import unsaid_along
from registration.gauss_sphere.matching import Settled, different, settle_best
from registration.gauss_sphere.misfits import without_misfits
from registration.gauss_sphere.open_directions import covariance_of, sliding, widest_covariance_of
from registration.gauss_sphere.outlines import as_ends
from registration.gauss_sphere.params import GaussSphereParams
from registration.gauss_sphere.rotation import gauss_sphere, rotation_candidates
from registration.gauss_sphere.symmetry import symmetric_rivals
from registration.gauss_sphere.telling_outlines import outlines_of
from registration.gauss_sphere.testimony import denied_share, is_doubtful
from registration.gauss_sphere.translation import pose_candidates
from registration.gauss_sphere.view import View
from registration.gauss_sphere.whole_planes import by_whole_planes
from registration.result import RegistrationResult
from registration.scan import Scan

ONE_DIRECTION_RAD = 0.1
FARTHEST_MM, NEAREST_MM = 0.9e5, 10.0
UNCALIBRATED = (
    "no calibration was given: the bias of the sensor stays in the scans, the pose is the less "
    "accurate for it, and errors may be larger than the covariance says"
)
UNFIT = (
    "the calibration does not fit the scans, it seems to be of another sensor: corrected by it, "
    "planes are bent as by a bias of up to {:.1f} mm, which the covariance allows for"
)
UNMOVED = (
    "; all profiles lie at one X: points are to stand where the sensor's motion along X puts them"
)
BENT = "planes are bent as by a bias of up to {:.1f} mm, which the covariance allows for"
NO_PAIRS = np.zeros((0, 2), dtype=np.int64)


def register_scans(target: Scan, source: Scan, params: GaussSphereParams) -> RegistrationResult:
    """Register two scans of planes without an initial guess."""
    started = perf_counter()
    target_view, source_view = (describe(scan, params) for scan in (target, source))
    described = perf_counter()
    result = register_views(target_view, source_view, params)
    stage_ms = {"planes": 1e3 * (described - started), **result.stage_ms}
    return replace(result, stage_ms=stage_ms)


def register_views(target: View, source: View, params: GaussSphereParams) -> RegistrationResult:
    """Register two described scans, described with the same parameters."""
    result = _registered(target, source, params)
    notes = () if params.calibration else (UNCALIBRATED,)
    far = () if result.status == "ok" else _marks(target, source)
    return replace(result, notes=(*notes, *result.notes, *far)) if notes or far else result


def _registered(target: View, source: View, params: GaussSphereParams) -> RegistrationResult:
    started = perf_counter()
    for name, view in (("target", target), ("source", source)):
        if view.patches.n_points.size == 0:
            taken = np.isfinite(view.fan.depth_mm).any(axis=1)
            unmoved = taken.sum() > 1 and view.fan.gap_mm == 0.0
            return RegistrationResult(
                None,
                "failed",
                f"no plane found in the {name} scan "
                f"({np.isfinite(view.fan.depth_mm).sum()} measured points); at least "
                f"{params.patches.min_profiles} profiles with "
                f"{params.patches.min_points} points on one plane are needed"
                + (UNMOVED if unmoved else ""),
                stage="patches" if np.isfinite(view.fan.depth_mm).any() else "scan",
            )
    nothing = {"planes": PlaneEvidence(target, source, NO_PAIRS, np.zeros(0), params)}
    rotations, _ = rotation_candidates(
        gauss_sphere(target.patches, params.rotation.close_rad),
        gauss_sphere(source.patches, params.rotation.close_rad),
        params.rotation,
    )
    if rotations.shape[0] == 0:
        return replace(_no_rotation(target, source), evidence=nothing)
    turned = perf_counter()
    first_r, first_t, _ = pose_candidates(
        target.patches, source.patches, rotations, params.translation
    )
    shifting = perf_counter() - turned
    settled = settle_best(target, source, first_r, first_t, params)
    if not settled or is_weak(settled[0], target, source, params.decision):
        again = perf_counter()
        wide_r, wide_t, _ = pose_candidates(target.patches, source.patches, rotations, params.wide)
        shifting += perf_counter() - again
        both_r, both_t = np.concatenate([first_r, wide_r]), np.concatenate([first_t, wide_t])
        all_of_them = replace(params.verification, ranked=max(len(both_t), 1))
        wide = replace(params, verification=all_of_them)
        settled = settle_best(target, source, both_r, both_t, wide)
    if not settled:
        return RegistrationResult(
            None,
            "failed",
            "no pose lays two planes of one view on planes of the other: the views may not overlap",
            evidence=nothing,
            stage="translation",
        )
    settled[0] = without_misfits(settled[0], target, source, params)
    bias_mm = left_bias_mm(target, source, read_known(params.calibration), params.bending)
    if bias_mm > 0.0:
        settled[0] = doubted(settled[0], target.patches, source.patches, bias_mm, params)
    settled, verdict, further = _judged(settled, target, source, bias_mm, params)
    unsaid: tuple[str, ...] = ()
    if verdict.status == "ok":
        settled, verdict, unsaid = _unless_symmetric(
            settled, further, verdict, target, source, bias_mm, params
        )
    if bias_mm == 0.0 and not params.calibration:
        verdict = _of_unknown_bias(verdict, settled[0], target, source, params)
    if bias_mm == 0.0 and verdict.status == "ok":
        settled[0], verdict = _whole(settled[0], verdict, target, source, params)
    result, best = answered(verdict, settled, target, source), settled[0]
    about = UNFIT if params.calibration else BENT
    notes = ((about.format(bias_mm),) if bias_mm > 0.0 else ()) + unsaid
    planes = PlaneEvidence(target, source, best.pairs, best.distance2, params)
    stage_ms = {
        "rotation": 1e3 * (turned - started),
        "translation": 1e3 * shifting,
        "verification": 1e3 * (perf_counter() - turned - shifting),
    }
    return replace(result, stage_ms=stage_ms, evidence={"planes": planes}, notes=notes)


def _judged(
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
        return settled, refuted(denied) if verdict.status == "ok" else verdict, []
    left, verdict = judged_by_free_planes(left, target, source, params, appeal=True)
    if verdict.status != "ok":
        return left, verdict, []
    better = outscoring(settled, left[0], target, source, params.decision)
    if better:
        others = different([*left[1:], *better], source, params.decision)
        return [left[0], *others], preferred(verdict.covariance, left[0], better), []
    ends = as_ends(outlines[0]), as_ends(outlines[1])
    return left, verdict, unsaid_along(left[0], target, source, ends, bias_mm, params)


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
        return [settled[0], *others], verdict, _told(settled[0], unsaid, decision.distinct_rad)
    poses = different([*alike, *settled[1:]], source, decision)
    if bias_mm > 0.0 and poses[0] is not settled[0] and poses[0].pairs.size:
        poses[0] = doubted(poses[0], target.patches, source.patches, bias_mm, params)
    covariance = covariance_of(poses[0], target, decision)
    return poses, questioned(covariance, alike[0], alike[1:]), ()


def _told(best: Settled, unsaid: list[Settled], least_rad: float) -> tuple[str, ...]:
    """A note on the first of the poses that nothing speaks for or against, if there is any."""
    if not unsaid:
        return ()
    turn = Rotation.from_matrix(unsaid[0].rotation @ best.rotation.T).magnitude()
    moved_mm = np.linalg.norm(unsaid[0].shift_mm - best.shift_mm)
    turned, share = turn > least_rad, unsaid[0].score / best.score
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


def _whole(
    best: Settled, verdict: Verdict, target: View, source: View, params: GaussSphereParams
) -> tuple[Settled, Verdict]:
    """The answer by whole planes; no surer than before where no calibration tells the bias.

    Pieces of a plane that an unknown bias bends do not quite line up: put together they make the
    pose more exact all the same, and would make it look surer than it is.
    """
    whole = by_whole_planes(best, target.patches, source.patches, params)
    if params.calibration:
        covariance = np.linalg.inv(whole.sure)
        verdict = verdict._replace(covariance=0.5 * (covariance + covariance.T))
    return whole, verdict


def _marks(target: View, source: View) -> tuple[str, ...]:
    """What may be wrong with scans whose points lie where no profile scanner sees any."""
    notes = []
    for name, view in (("target", target), ("source", source)):
        fan = view.fan
        lean_y, lean_z = fan.lean[:, None, None] * fan.x_mm[:, None]
        depth_mm = fan.depth_mm + fan.apex_mm[2] + lean_z
        aside_mm = fan.slope * fan.depth_mm + fan.apex_mm[1] + lean_y
        near = np.count_nonzero((abs(depth_mm) < NEAREST_MM) & (abs(aside_mm) < NEAREST_MM))
        far = np.count_nonzero(depth_mm > FARTHEST_MM)
        if near:
            notes.append(
                f"{near} of {np.isfinite(depth_mm).sum()} points of the {name} scan lie within "
                f"{NEAREST_MM:g} mm of Y = Z = 0: give NaN where nothing returned, lengths in mm"
            )
        if seems_turned_around(fan):
            notes.append(
                f"the farther away points of the {name} scan lie, the closer together are their "
                "beams, as where Z is height: give depth as Z, which grows away from the sensor"
            )
        if far:
            notes.append(
                f"{far} of {np.isfinite(depth_mm).sum()} points of the {name} scan lie more than "
                f"{FARTHEST_MM / 1e3:g} m away: where nothing returned, give NaN"
            )
    return tuple(notes)


def _no_rotation(target: View, source: View) -> RegistrationResult:
    one_way = [view for view in (target, source) if _one_direction(view)]
    if one_way:
        return RegistrationResult(
            None,
            "underdetermined",
            f"the {'target' if one_way[0] is target else 'source'} scan shows planes of one "
            f"direction only ({one_way[0].patches.n_points.size} found): a turn about their normal "
            "and shifts along them stay open; a second plane at an angle is needed",
            undetermined=sliding(target.patches) if _one_direction(target) else np.zeros((0, 6)),
            stage="scene",
        )
    return RegistrationResult(
        None,
        "failed",
        "no two planes of one view subtend the angle of two planes of the other: the views may "
        "not overlap",
        stage="rotation",
    )


def _one_direction(view: View) -> bool:
    across = np.cross(view.patches.normal, view.patches.normal[0])
    return bool((np.linalg.norm(across, axis=1) < ONE_DIRECTION_RAD).all())
