"""Poses further along the one shift that planes leave open, where a third direction meets, too.

Shifts are looked for by two pairs of planes of unlike directions. Where both slide, the middles of
what is seen of them place a pose, though each view sees another part of them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from registration.gauss_sphere.judging.open_directions import open_shift
from registration.gauss_sphere.params import GaussSphereParams
from registration.gauss_sphere.refinement.matching import Settled, different, settle_best
from registration.gauss_sphere.view import View
from registration.scan import FloatArray

LEAST_LEAN = 0.15  # cosine between the open shift and the normal of a plane that tells of it
NEAR_MM = 4.0  # shifts closer together are one


def with_third_planes(
    settled: list[Settled], target: View, source: View, params: GaussSphereParams
) -> list[Settled]:
    """The settled poses and those that planes of a third direction bring along, best first.

    They are looked for from poses about as good as the best of which just a shift is open.
    """
    least = params.decision.rival_share * settled[0].score
    starts = [
        (pose.rotation, pose.shift_mm + shift_mm * along)
        for pose in settled
        if pose.score >= least and (along := open_shift(pose, target, params.decision)) is not None
        for shift_mm in _meeting(pose, along, target, source, params)
    ]
    if not starts:
        return settled
    rotations, shifts = (np.array(each) for each in zip(*starts, strict=True))
    looks = replace(
        params.verification,
        ranked=len(starts),
        kept=len(starts),
        rough_stride=params.match.strides[0],  # few are compared, so more of each can be
    )
    settling = replace(params, verification=looks)
    found = settle_best(target, source, rotations, shifts, settling, look_again=False)
    return different([*settled, *found], source, params.decision)


def _meeting(
    pose: Settled, along: FloatArray, target: View, source: View, params: GaussSphereParams
) -> list[float]:
    """Shifts in mm of a pose along a direction (3,) at which planes meet, of the largest first."""
    search, one, other = params.translation, target.patches, source.patches
    n_one, n_other = (min(p.n_points.size, search.patches) for p in (one, other))
    normal, middles = one.normal[:n_one], other.centroid_mm[:n_other] @ pose.rotation.T
    alike = normal @ (other.normal[:n_other] @ pose.rotation.T).T
    lean = normal @ along
    tells = (alike > np.cos(search.angle_tolerance_rad)) & (np.abs(lean) > LEAST_LEAN)[:, None]
    i, k = np.nonzero(tells)
    away_mm = one.centroid_mm[i] - middles[k] - pose.shift_mm
    shift_mm = np.sum(normal[i] * away_mm, axis=1) / lean[i]
    within = np.abs(shift_mm) < params.outlines.slide_mm
    area = np.minimum(one.area_mm2[i], other.area_mm2[k])[within]
    chosen: list[float] = []
    for shift in shift_mm[within][np.argsort(-area, kind="stable")]:
        if all(abs(shift - known) > NEAR_MM for known in chosen):
            chosen.append(float(shift))
    return chosen[: params.decision.third_planes]
