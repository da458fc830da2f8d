"""Global registration by KISS-Matcher."""

from __future__ import annotations

from time import perf_counter

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from registration.peers.entries import measured_mm, require
from registration.peers.params import KissMatcherParams
from registration.scan import Scan

# Its solver needs three matches; fewer make it raise or return anything.
LEAST_MATCHES = 3


def match(
    target: Scan, source: Scan, params: KissMatcherParams
) -> tuple[RigidTransform | None, str, dict[str, float]]:
    """The pose of the matches that agree with each other, or None and why; times by stage."""
    kiss_matcher = require("kiss_matcher")
    bounds = {"robin": 1.0, "solver": 0.75}  # in cells, the library's defaults
    if params.clamp_noise_bounds:
        # What the library's own clamping does, without its warning on every call.
        bounds = {name: min(cells, 1.0 / params.voxel_mm) for name, cells in bounds.items()}
    config = kiss_matcher.KISSMatcherConfig(
        voxel_size=params.voxel_mm,
        robin_noise_bound_gain=bounds["robin"],
        solver_noise_bound_gain=bounds["solver"],
        enable_noise_bound_clamping=False,
    )
    matcher = kiss_matcher.KISSMatcher(config)
    started = perf_counter()
    source_mm, target_mm = (np.asfortranarray(measured_mm(s).T) for s in (source, target))
    source_matched, target_matched = matcher.match(source_mm, target_mm)
    matched = perf_counter()
    stage_ms = {"matching": 1e3 * (matched - started)}
    if len(source_matched) < LEAST_MATCHES:
        reason = f"KISS-Matcher matched {len(source_matched)} points; {LEAST_MATCHES} are needed"
        return None, reason, stage_ms
    solution = matcher.prune_and_solve(source_matched, target_matched)
    stage_ms["solving"] = 1e3 * (perf_counter() - matched)
    rotation, translation_mm = (
        np.asarray(part, dtype=np.float64) for part in (solution.rotation, solution.translation)
    )
    if not solution.valid or not np.isfinite(rotation).all():
        return None, "KISS-Matcher calls its solution invalid", stage_ms
    pose = RigidTransform.from_components(translation_mm.ravel(), Rotation.from_matrix(rotation))
    return pose, "", stage_ms
