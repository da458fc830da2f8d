"""The thesis method, stage by stage (figures 4.1 and 5.1); each stage can be entered halfway."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

from registration.result import RegistrationResult
from registration.scan import Scan
from registration.thesis.evidence import ViewEvidence
from registration.thesis.gauss_sphere import compact_sphere
from registration.thesis.icp import refined
from registration.thesis.merging import merge_profiles
from registration.thesis.outcome import decide
from registration.thesis.params import ThesisParams
from registration.thesis.patches import Patches, build_patches
from registration.thesis.preprocess import preprocess
from registration.thesis.rotation import search_rotation
from registration.thesis.segments import Segments, find_segments

StageTimes = dict[str, float]


def register_scans(target: Scan, source: Scan, params: ThesisParams) -> RegistrationResult:
    """Register two scans as chapters 4 and 5 describe; never raises for what the scans contain."""
    stage_ms: StageTimes = {}
    with _timed("preprocess", stage_ms):
        scans = [preprocess(scan, params.preprocess) for scan in (target, source)]
    with _timed("segments", stage_ms):
        segments = [find_segments(scan, params.segments) for scan in scans]
    return _from_segments(segments, scans, params, stage_ms)


def register_segments(
    target_segments: Segments,
    source_segments: Segments,
    params: ThesisParams,
    target_scan: Scan | None = None,
    source_scan: Scan | None = None,
) -> RegistrationResult:
    """Enter with segments; the scans are needed unless params.patches.triplets is "fitted"."""
    return _from_segments(
        [target_segments, source_segments], [target_scan, source_scan], params, {}
    )


def register_patches(
    target_patches: Patches, source_patches: Patches, params: ThesisParams
) -> RegistrationResult:
    """Enter with patches, found ones or true ones."""
    nothing = [None, None]
    return _from_patches([target_patches, source_patches], nothing, nothing, params, {})


def _from_segments(
    segments: list[Segments],
    scans: Sequence[Scan | None],
    params: ThesisParams,
    stage_ms: StageTimes,
) -> RegistrationResult:
    with _timed("merging", stage_ms):
        chains = [merge_profiles(view, params.merge) for view in segments]
    with _timed("patches", stage_ms):
        patches = [
            build_patches(view, chain, params.patches, scan)
            for view, chain, scan in zip(segments, chains, scans, strict=True)
        ]
    return _from_patches(patches, segments, scans, params, stage_ms)


def _from_patches(
    patches: list[Patches],
    segments: Sequence[Segments | None],
    scans: Sequence[Scan | None],
    params: ThesisParams,
    stage_ms: StageTimes,
) -> RegistrationResult:
    with _timed("gauss_sphere", stage_ms):
        target, source = (
            ViewEvidence(*stages, compact_sphere(stages[2], params.sphere))
            for stages in zip(scans, segments, patches, strict=True)
        )
    with _timed("rotation", stage_ms):
        search = search_rotation(
            target.sphere,
            source.sphere,
            params.rotation,
            params.belief.tie_angle_rad,
            (target.patches.centroid_mm, source.patches.centroid_mm),
        )
    with _timed("translation", stage_ms):
        result = decide(target, source, search, params)
    if params.icp.rounds > 0:
        with _timed("icp", stage_ms):
            result = refined(result, scans[0], scans[1], params.icp)
    return replace(result, stage_ms=stage_ms)


@contextmanager
def _timed(stage: str, stage_ms: StageTimes) -> Iterator[None]:
    start = time.perf_counter()
    yield
    stage_ms[stage] = 1e3 * (time.perf_counter() - start)
