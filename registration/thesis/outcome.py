"""From ranked rotations to the answer, or to the reason why there is none.

The thesis takes the rotation of largest overlap and trusts it. The checks of BeliefParams are ours.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from registration.result import Candidate, RegistrationResult, Status
from registration.scan import FloatArray, IntArray
from registration.thesis.evidence import ViewEvidence
from registration.thesis.params import ThesisParams
from registration.thesis.rotation import RotationSearch, match_normals
from registration.thesis.translation import Shifts, estimate_translation, oriented_pairs


@dataclass(frozen=True)
class _Pose:
    """One rotation, followed through the translation stage."""

    R: FloatArray
    overlap: float
    translation_mm: FloatArray | None
    normal_matches: IntArray
    shifts: Shifts


def decide(
    target: ViewEvidence, source: ViewEvidence, search: RotationSearch, params: ThesisParams
) -> RegistrationResult:
    """Estimate the translation of the best rotation and judge whether to believe the pose.

    Rotations whose overlap ties with the best (BeliefParams.tie_margin) are ranked by the number of
    patches that agree on a shift, a choice the thesis leaves open. A pose that is not believed is
    no answer but the first of the candidates. Never raises.
    """
    evidence: dict[str, Any] = {
        "target": target,
        "source": source,
        "shifts": _NO_SHIFTS,
        "normal_matches": np.zeros((0, 2), dtype=np.int64),
        "two_rotations": search.two_rotations,
    }
    empty = [name for name in ("target", "source") if len(evidence[name].patches) == 0]
    if empty:
        said = [_no_patches(name, evidence[name], params) for name in empty]
        return RegistrationResult(
            None,
            "failed",
            "; ".join(reason for _, reason in said),
            evidence=evidence,
            stage=said[0][0],
        )
    if search.status != "ok":
        return RegistrationResult(
            None,
            search.status,
            search.reason,
            undetermined=open_directions(target, params.rotation.angle_tolerance_rad),
            evidence=evidence,
            stage="rotation",
        )
    poses = _poses(target, source, search, params)
    best, others = poses[0], poses[1:]
    evidence |= {"shifts": best.shifts, "normal_matches": best.normal_matches}
    status, stage, reason = _verdict(best, others, params)
    candidates = tuple(
        Candidate(_transform(p), p.overlap)
        for p in (poses if status == "failed" else others)
        if p.translation_mm is not None
    )
    return RegistrationResult(
        None if status == "failed" else _transform(best),
        status,
        reason,
        candidates=candidates,
        evidence=evidence,
        stage=stage,
    )


def open_directions(view: ViewEvidence, tolerance_rad: float) -> FloatArray:
    """Unit directions of (rotation vector, translation) that the normals of a view leave open.

    Returns (k, 6): the shift along a line that all planes share, or, when they are all parallel,
    the two shifts along them and the turn about their normal.
    """
    normals = view.sphere.direction
    if len(normals) == 0:
        return np.eye(6)
    _, spread, axes = np.linalg.svd(np.vstack([normals, np.zeros((3, 3))]))
    free = axes[spread < np.sin(tolerance_rad)]
    shifts = np.hstack([np.zeros_like(free), free])
    if len(free) < 2:
        return shifts
    return np.vstack([np.concatenate([axes[0], np.zeros(3)]), shifts])


def _poses(
    target: ViewEvidence, source: ViewEvidence, search: RotationSearch, params: ThesisParams
) -> list[_Pose]:
    """Every rotation with its translation; those that tie with the best ranked by their shifts."""
    poses = []
    for R, overlap in zip(search.R_target_source, search.overlap, strict=True):
        tolerance = params.rotation.overlap_tolerance_rad
        matches = match_normals(target.sphere, source.sphere, R, tolerance)
        pairs = oriented_pairs(target.sphere, source.sphere, matches)
        translation, shifts = estimate_translation(
            target.patches, source.patches, pairs, R, params.translation
        )
        poses.append(_Pose(R, float(overlap), translation, matches, shifts))
    floor = (1.0 - params.belief.tie_margin) * poses[0].overlap
    tied = [p for p in poses if p.overlap >= floor]
    tied.sort(key=lambda p: -p.shifts.agreeing)
    return tied + [p for p in poses if p.overlap < floor]


def _verdict(best: _Pose, others: list[_Pose], params: ThesisParams) -> tuple[Status, str, str]:
    """Status, stage and reason."""
    belief = params.belief
    if best.translation_mm is None:
        return (
            "failed",
            "translation",
            (
                "the densest intervals of the three axes have no shift in common; "
                'translation.density = "3d" looks at the axes together, which may or may not '
                "find one"
            ),
        )
    if best.overlap < belief.min_overlap:
        return (
            "failed",
            "rotation",
            (
                f"the normals of the best rotation overlap by {best.overlap:.0%} of the smaller "
                f"view; {belief.min_overlap:.0%} are needed to believe it"
            ),
        )
    agreeing = best.shifts.agreeing
    if agreeing < belief.min_shifts:
        agree = "patch of a view agrees" if agreeing == 1 else "patches of a view agree"
        return (
            "failed",
            "translation",
            (f"{agreeing} {agree} on a translation; {belief.min_shifts} are needed to believe it"),
        )
    for other in others:
        if (
            other.translation_mm is not None
            and other.overlap >= (1.0 - belief.tie_margin) * best.overlap
            and other.shifts.agreeing >= (1.0 - belief.tie_margin) * agreeing
        ):
            angle = Rotation.from_matrix(other.R @ best.R.T).magnitude()
            return (
                "ambiguous",
                "rotation",
                (
                    f"another rotation, {np.degrees(angle):.0f} degrees away, explains as much: "
                    f"{other.overlap:.0%} of the normals and {other.shifts.agreeing} patches "
                    f"against {best.overlap:.0%} and {agreeing}"
                ),
            )
    return "ok", "", ""


def _transform(pose: _Pose) -> RigidTransform:
    assert pose.translation_mm is not None
    return RigidTransform.from_components(pose.translation_mm, Rotation.from_matrix(pose.R))


def _no_patches(name: str, view: ViewEvidence, params: ThesisParams) -> tuple[str, str]:
    """At which stage a view ran empty, and what to say of it."""
    if view.scan_filtered is not None and view.scan_filtered.n_valid == 0:
        return "scan", f"the {name} has no measured point, apart from isolated ones"
    if view.segments is not None and len(view.segments) == 0:
        return "segments", (
            f"the {name} has no straight segment of {params.segments.min_points} points or more"
        )
    found = "no patches" if view.segments is None else f"{len(view.segments)} segments but no patch"
    return "patches", (
        f"the {name} has {found}: {params.patches.min_profiles} like profiles in a row are needed"
    )


_NO_SHIFTS = Shifts(
    values_mm=np.zeros((0, 3)),
    weights=np.zeros(0),
    patch_pairs=np.zeros((0, 2), dtype=np.int64),
    chosen=np.zeros(0, dtype=bool),
    box_mm=np.full((2, 3), np.nan),
)
