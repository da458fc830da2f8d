"""Poses by the planes that agree on them, where a few that do not would leave them open."""

from __future__ import annotations

import numpy as np

from registration.gauss_sphere.judging.decision import agreeing_planes, is_plain
from registration.gauss_sphere.judging.open_directions import open_directions_of
from registration.gauss_sphere.params import GaussSphereParams
from registration.gauss_sphere.refinement.matching import Settled, floors_of, scored
from registration.gauss_sphere.refinement.refine import likelihood
from registration.gauss_sphere.refinement.settling import make_likely
from registration.gauss_sphere.view import View

LEAST_FITTING = 2.0 / 3.0  # of the pairs: poses that are turned by a like thing lose more
# Enough where next to nothing is in free space, which turned poses put some surface in, and planes
# agree without a large systematic error, which could make any few of them agree.
LEAST_PLANES, MOST_FLOOR_MM = 3, 0.12


def without_misfits(
    pose: Settled, target: View, source: View, params: GaussSphereParams
) -> Settled:
    """The pose by those of its planes that fit, if it is only left open by the others.

    Two planes a few mm apart may be taken for one, as a drawer and the next, which stands out, and
    of a round thing each view has its own planes. What explains that as an error of all planes
    leaves directions open that the others fix. It is as sure, then, as the planes that fit make it.
    """
    fits = pose.distance2 < params.refine.capped_distance2
    if fits.all() or not open_directions_of(pose, target, params.decision).size:
        return pose
    pairs, distance2 = pose.pairs[fits], np.empty(np.count_nonzero(fits))
    many = pairs.shape[0] >= max(params.decision.sure_planes, LEAST_FITTING * fits.size)
    if (not many and not is_plain(pose, params.decision)) or pairs.shape[0] < LEAST_PLANES:
        return pose
    r, t, information, sure = pose.rotation.copy(), pose.shift_mm.copy(), *np.zeros((2, 6, 6))
    floor_mm = make_likely(
        target.patches, source.patches, pairs, likelihood(params.refine), floors_of(params),
        r, t, information, sure, distance2,
    )  # fmt: skip
    fitting = Settled(r, t, information, sure, floor_mm, pairs, distance2, pose.areas, pose.score)
    fitting = scored(fitting, target, source, params)
    agreeing = agreeing_planes(fitting, target, params.decision)
    strict = many and agreeing >= params.decision.sure_planes
    exact = floor_mm <= max(MOST_FLOOR_MM, floors_of(params)[0])
    plain = is_plain(pose, params.decision) and is_plain(fitting, params.decision)
    if not strict and not (plain and exact and agreeing >= LEAST_PLANES):
        return pose
    return pose if open_directions_of(fitting, target, params.decision).size else fitting
