"""Registration of two profiles in one laser plane, stage by stage (section 4.2)."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from registration.planar.circle import GaussCircle, gauss_circle, planar_transform, wrapped
from registration.planar.overlap import Matches, line_table, matches_under
from registration.planar.params import PlanarParams
from registration.planar.refine import averaged, laid_on_lines
from registration.planar.search import Ranking, rank_poses
from registration.result import Candidate, RegistrationResult, Status
from registration.scan import Scan
from registration.thesis.preprocess import preprocess
from registration.thesis.segments import Segments, find_segments

# What a plane cannot tell: the turns about Y and Z and the shift along X, all taken as zero.
OUT_OF_PLANE = np.eye(6)[[1, 2, 3]]


@dataclass(frozen=True)
class PlanarEvidence:
    """What the stages made of a pair of profiles, each as (target, source).

    matches: the segments that overlap under the best pose, before it is refined.
    scans_filtered: None where the method was entered with segments.
    """

    segments: tuple[Segments, Segments]
    circles: tuple[GaussCircle, GaussCircle]
    matches: Matches
    scans_filtered: tuple[Scan, Scan] | None = None


def register_profiles(target: Scan, source: Scan, params: PlanarParams) -> RegistrationResult:
    """Register two scans of one profile each, whose laser planes coincide.

    The turn about X and the shift along Y and Z are estimated; the rest is taken as zero and
    listed as undetermined. Never raises for what the scans contain. Section 4.2.
    """
    sizes = [scan.points_mm.shape[0] for scan in (target, source)]
    if sizes != [1, 1]:
        return RegistrationResult(
            None,
            "failed",
            f"the target has {sizes[0]} profiles and the source {sizes[1]}; in the plane, one "
            "profile is registered to one profile",
            stage="scan",
        )
    stage_ms: dict[str, float] = {}
    with _timed("preprocess", stage_ms):
        scans = preprocess(target, params.preprocess), preprocess(source, params.preprocess)
    with _timed("segments", stage_ms):
        segments = [find_segments(scan, params.segments) for scan in scans]
    with _timed("plane", stage_ms):
        result = register_segments(segments[0], segments[1], params)
    evidence = replace(result.evidence["planar"], scans_filtered=scans)
    return replace(result, stage_ms=stage_ms, evidence={"planar": evidence})


def register_segments(
    target: Segments, source: Segments, params: PlanarParams
) -> RegistrationResult:
    """Enter with the segments of one profile each, found ones or true ones."""
    lines = line_table(target), line_table(source)
    ranking = rank_poses(target, source, *lines, params)
    best = ranking.pose[0] if len(ranking.pose) else np.zeros(3)
    tolerances = params.angle_tolerance_rad, params.offset_tolerance_mm
    matches = matches_under(*lines, best, *tolerances)
    circles = gauss_circle(target), gauss_circle(source)
    rivals = ranking.rivals(params)
    status, stage, reason = _verdict(ranking, rivals, circles, params)
    pose = None
    if status in ("ok", "ambiguous"):
        pose = best
        if params.refinement == "centroids":
            pose = averaged(best, matches, target.centroid_mm[:, 1:], source.centroid_mm[:, 1:])
        elif params.refinement == "lines":
            pose = laid_on_lines(best, *lines, params)
    undetermined = OUT_OF_PLANE
    if status == "underdetermined":
        widest = int(np.argmax(np.where(ranking.parallel, ranking.overlap_mm, -1.0)))
        matches = matches_under(*lines, ranking.pose[widest], *tolerances)
        along = np.array([0.0, 0.0, 0.0, 0.0, -matches.normal[0, 1], matches.normal[0, 0]])
        undetermined = np.vstack([OUT_OF_PLANE, along])
    return RegistrationResult(
        None if pose is None else planar_transform(pose),
        status,
        reason,
        undetermined=undetermined.copy(),
        candidates=_candidates(ranking, rivals),
        evidence={"planar": PlanarEvidence((target, source), circles, matches)},
        stage=stage,
    )


def _verdict(
    ranking: Ranking,
    rivals: list[int],
    circles: tuple[GaussCircle, GaussCircle],
    params: PlanarParams,
) -> tuple[Status, str, str]:
    """Whether to believe the pose that won: status, stage and reason."""
    empty = [
        name
        for name, circle in zip(("target", "source"), circles, strict=True)
        if circle.length_mm.sum() == 0.0
    ]
    if empty:
        return (
            "failed",
            "segments",
            (
                f"the profile of the {' and of the '.join(empty)} has no straight segment of "
                f"{params.segments.min_points} points or more"
            ),
        )
    shorter_mm = min(circle.length_mm.sum() for circle in circles)
    share = ranking.overlap_mm / shorter_mm
    if params.winners == "determined" and (ranking.parallel[0] or share[0] < params.min_overlap):
        along = share[ranking.parallel].max(initial=0.0)
        if along >= params.min_overlap:
            crossing = share[~ranking.parallel].max(initial=0.0)
            return (
                "underdetermined",
                "scene",
                (
                    f"only parallel segments overlap enough, by {along:.0%} of the shorter "
                    f"profile, so the shift along them stays open; of two directions, "
                    f"{crossing:.0%} overlap"
                ),
            )
    if share[0] < params.min_overlap or share[0] == 0.0:
        return (
            "failed",
            "verification",
            (
                f"the segments of the best pose overlap by {share[0]:.0%} of the shorter profile; "
                f"{params.min_overlap:.0%} are needed to believe it"
            ),
        )
    for k in rivals[:1]:
        if (
            ranking.overlap_mm[k] >= (1.0 - params.tie_margin) * ranking.overlap_mm[0]
            and ranking.parallel[k] == ranking.parallel[0]
        ):
            turn = np.degrees(np.abs(wrapped(ranking.pose[k, 0] - ranking.pose[0, 0])))
            return (
                "ambiguous",
                "decision",
                (
                    f"another pose, {turn:.0f} degrees away, makes the segments overlap as much: "
                    f"{ranking.overlap_mm[k]:.0f} mm against {ranking.overlap_mm[0]:.0f} mm"
                ),
            )
    return "ok", "", ""


def _candidates(ranking: Ranking, rivals: list[int]) -> tuple[Candidate, ...]:
    if not rivals:
        return ()
    poses = planar_transform(ranking.pose[rivals])  # at once, which is quicker than one by one
    scores = ranking.overlap_mm[rivals].tolist()
    return tuple(Candidate(poses[k], score) for k, score in enumerate(scores))


@contextmanager
def _timed(stage: str, stage_ms: dict[str, float]) -> Iterator[None]:
    start = time.perf_counter()
    yield
    stage_ms[stage] = 1e3 * (time.perf_counter() - start)
