"""The method, stage by stage: planes, Gauss spheres, rotation, translation, verification."""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter

import numpy as np

from registration.gauss_sphere.candidates.rotation import rotations_between
from registration.gauss_sphere.candidates.translation import pose_candidates
from registration.gauss_sphere.describing import describe
from registration.gauss_sphere.evidence import PlaneEvidence
from registration.gauss_sphere.failures import no_plane, no_pose, no_rotation, oddities
from registration.gauss_sphere.fan.calibrated import read_known
from registration.gauss_sphere.judging.bending import doubted, left_bias_mm
from registration.gauss_sphere.judging.decision import Verdict, answered, is_weak
from registration.gauss_sphere.judging.judged import judged
from registration.gauss_sphere.judging.misfits import without_misfits
from registration.gauss_sphere.params import GaussSphereParams
from registration.gauss_sphere.refinement.matching import Settled, settle_best
from registration.gauss_sphere.refinement.whole_planes import by_whole_planes
from registration.gauss_sphere.view import View
from registration.result import RegistrationResult
from registration.scan import FloatArray, Scan

UNCALIBRATED = (
    "no calibration was given: the bias of the sensor stays in the scans, the pose is the less "
    "accurate for it, and errors may be larger than the covariance says"
)
UNFIT = (
    "the calibration does not fit the scans, it seems to be of another sensor: corrected by it, "
    "planes are bent as by a bias of up to {:.1f} mm, which the covariance allows for"
)
BENT = "planes are bent as by a bias of up to {:.1f} mm, which the covariance allows for"
NO_PAIRS = np.zeros((0, 2), dtype=np.int64)


def register_scans(target: Scan, source: Scan, params: GaussSphereParams) -> RegistrationResult:
    """Register two scans of planes without an initial guess.

    Raises CalibrationError or OSError where params name a calibration that cannot be read.
    """
    started = perf_counter()
    target_view, source_view = (describe(scan, params) for scan in (target, source))
    described = perf_counter()
    result = register_views(target_view, source_view, params)
    stage_ms = {"planes": 1e3 * (described - started), **result.stage_ms}
    return replace(result, stage_ms=stage_ms)


def register_views(target: View, source: View, params: GaussSphereParams) -> RegistrationResult:
    """Register two described scans, described with the same parameters.

    Raises as register_scans does.
    """
    result = _registered(target, source, params)
    before = () if params.calibration else (UNCALIBRATED,)
    after = () if result.status == "ok" else oddities(target, source)
    return replace(result, notes=(*before, *result.notes, *after)) if before or after else result


def _registered(target: View, source: View, params: GaussSphereParams) -> RegistrationResult:
    started = perf_counter()
    for name, view in (("target", target), ("source", source)):
        if view.patches.n_points.size == 0:
            return no_plane(name, view, params.patches)
    nothing = {"planes": PlaneEvidence(target, source, NO_PAIRS, np.zeros(0), params)}
    rotations = rotations_between(target.patches, source.patches, params.rotation)
    if rotations.shape[0] == 0:
        return replace(no_rotation(target, source), evidence=nothing)
    turned = perf_counter()
    settled, shifting = _settled(target, source, rotations, params)
    if not settled:
        return replace(no_pose(), evidence=nothing)
    settled[0] = without_misfits(settled[0], target, source, params)
    bias_mm = left_bias_mm(target, source, read_known(params.calibration), params.bending)
    if bias_mm > 0.0:
        settled[0] = doubted(settled[0], target.patches, source.patches, bias_mm, params)
    settled, verdict, notes = judged(settled, target, source, bias_mm, params)
    if bias_mm > 0.0:
        bent = UNFIT if params.calibration else BENT
        notes = (bent.format(bias_mm), *notes)
    elif verdict.status == "ok":
        settled[0], verdict = _whole(settled[0], verdict, target, source, params)
    best = settled[0]
    return replace(
        answered(verdict, settled, target, source),
        stage_ms={
            "rotation": 1e3 * (turned - started),
            "translation": 1e3 * shifting,
            "verification": 1e3 * (perf_counter() - turned - shifting),
        },
        evidence={"planes": PlaneEvidence(target, source, best.pairs, best.distance2, params)},
        notes=notes,
    )


def _settled(
    target: View, source: View, rotations: FloatArray, params: GaussSphereParams
) -> tuple[list[Settled], float]:
    """The poses of some rotations that planes agree on, and the time in s that shifts took.

    Where the best of them is no answer, shifts are looked for once more, among more pairs.
    """
    patches, started = (target.patches, source.patches), perf_counter()
    rough_r, rough_t, _ = pose_candidates(*patches, rotations, params.translation)
    shifting = perf_counter() - started
    settled = settle_best(target, source, rough_r, rough_t, params)
    if settled and not is_weak(settled[0], target, source, params.decision):
        return settled, shifting
    started = perf_counter()
    wide_r, wide_t, _ = pose_candidates(*patches, rotations, params.wide)
    shifting += perf_counter() - started
    both_r, both_t = np.concatenate([rough_r, wide_r]), np.concatenate([rough_t, wide_t])
    all_of_them = replace(params.verification, ranked=max(len(both_t), 1))
    wide = replace(params, verification=all_of_them)
    return settle_best(target, source, both_r, both_t, wide), shifting


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
