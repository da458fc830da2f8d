"""Poses that a symmetry of few planes allows: the best one, turned about its planes or moved on.

The near sides of a box look like its far sides from behind. Where a scene is little more than one
symmetric thing, what both views share does not tell which of its turns is meant: the true pose may
share less than a turned one, and none of them contradicts the scans.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from registration.gauss_sphere.judging.decision import agreeing_patches, agreeing_planes, is_plain
from registration.gauss_sphere.judging.free_planes import has_free_plane
from registration.gauss_sphere.judging.turning import (
    REPEATED_MM,
    Turning,
    is_nearly_free,
    turned_poses,
)
from registration.gauss_sphere.outlines.ends import as_ends
from registration.gauss_sphere.outlines.placing import placed, placed_by_some
from registration.gauss_sphere.outlines.telling import outlines_of
from registration.gauss_sphere.outlines.testimony import said
from registration.gauss_sphere.params import DecisionParams, GaussSphereParams
from registration.gauss_sphere.refinement.matching import Settled, different, scored, settle_best
from registration.gauss_sphere.refinement.verification import comparison
from registration.gauss_sphere.view import View
from registration.scan import FloatArray, IntArray

SIDES_OF_PRISMS = (2, 3, 4, 5, 6, 8)  # that look the same a turn of 360 degrees / sides further
# With no turn as well: where equal things stand in a row, all is the same a period further.
TURNS_RAD = np.deg2rad(np.unique([360.0 * k / n for n in SIDES_OF_PRISMS for k in range(n)]))
NEARLY = 0.8  # of the score it needs, what it must have before it is placed
LIKE_BEST = 0.6  # of the best score: other settled poses are asked from there on
# What some ends of faces say of a pose, for all of them to be asked: they must confirm so much of
# the share that all must, or say something of no more than so many of them, where silence counts.
ROUGHLY_CONFIRMED, NEARLY_SILENT = 0.4, 0.3
AS_GOOD = 0.98  # of a pose's score: what its planes must reach to have it where they want it


class Found(NamedTuple):
    """A pose that may be as good as the best one.

    along: (2, 3) the directions in which it is looked for where it is. further_along: whether it is
    the best pose moved along its planes, without a turn.
    """

    pose: Settled
    along: FloatArray
    further_along: bool


def symmetric_rivals(
    settled: list[Settled], target: View, source: View, params: GaussSphereParams
) -> tuple[list[Settled], list[Settled]]:
    """The best pose turned about the normals of its planes, where the scans allow it, best first.

    They do if it lays surface on surface, puts next to nothing in free space, and ends of faces
    speak for it nearly as well as for the best pose. The same is asked of the best pose moved along
    its planes, as to the next of equal things in a row, if enough planes agree there; and of the
    other settled poses, which planes alone do not allow, but ends of faces may have elsewhere. None
    is looked for where more than params.decision.turned_planes agree.

    With these go, where no more than params.decision.silent_planes agree, those of which ends of
    faces say nothing, as each view sees others: such a pose may be the true one of views that lie
    far apart.
    """
    best, decision, how = settled[0], params.decision, params.outlines
    agreeing = agreeing_patches(best, target, decision)
    if not 0 < len(agreeing) <= decision.turned_planes:
        return [], []
    few = len(agreeing) <= decision.silent_planes
    found = _found(settled, agreeing, target, source, params)
    found = _worth_asking(found, best, few, target, source, params)
    if not found:
        return [], []
    ends = as_ends(outlines_of(target, how)), as_ends(outlines_of(source, how))
    least = max(how.least, how.confirmed_share * sum(len(e.point_mm) for e in ends))
    confirmed, denied = said(best.rotation, best.shift_mm, target, source, ends, how)
    most_denied = denied / max(confirmed + denied, how.least) + decision.turned_denied
    enough, rivals, unsaid = _enough_planes(len(agreeing), decision), [], []
    unmoved = not has_free_plane(best, target, source, params)
    for pose, along, further_along in found:
        t, confirmed, denied = placed(
            target, source, ends, pose.rotation, pose.shift_mm, along, how
        )
        there = scored(pose._replace(shift_mm=t), target, source, params)
        if not _allowed(there, best, decision):
            continue
        if unmoved and has_free_plane(there, target, source, params):
            continue
        silent = confirmed + denied < how.least and denied <= most_denied * how.least
        if few and silent and there.score > decision.silent_share * best.score:
            unsaid.append(there)
        if confirmed < least or denied > most_denied * (confirmed + denied):
            continue
        rival, n_planes = _settled(there, best, target, source, params)
        away_mm = np.linalg.norm(there.shift_mm - best.shift_mm)
        if not further_along or (n_planes >= enough and away_mm >= REPEATED_MM):
            rivals.append(rival)
    return different(rivals, source, decision), different(unsaid, source, decision)


def _enough_planes(n_planes: int, params: DecisionParams) -> float:
    """How many planes must agree on a pose further along, where so many agree on the best one.

    Where these are few, surface and ends of faces say enough. Of many, two large ones may lie on
    others that look like them: half a chair further, say.
    """
    return params.repeat_planes * n_planes if n_planes > params.sure_planes else 0.0


def _found(
    settled: list[Settled],
    agreeing: IntArray,
    target: View,
    source: View,
    params: GaussSphereParams,
) -> list[Found]:
    """What is asked: settled poses, and the best one turned about its planes or moved along them.

    agreeing: (m, 2) patches of target and source, a pair a plane.
    """
    best, decision = settled[0], params.decision
    along = target.patches.basis[_largest(agreeing[:, 0], target)]
    others = [
        Found(pose, along, False)
        for pose in settled[1:]
        if pose.score > LIKE_BEST * best.score and is_nearly_free(pose.areas)
    ]
    # One further along has to do more: a settled pose must not be lost for it.
    turned = [
        one
        for one in _turned(best, agreeing, target, source, params)
        if not one.further_along
        or all(len(different([one.pose, o.pose], source, decision)) == 2 for o in others)
    ]
    found = [*turned, *others]
    unlike = different([one.pose for one in found], source, decision)
    return [one for pose in unlike for one in found if one.pose is pose]


def _worth_asking(
    found: list[Found],
    best: Settled,
    few: bool,
    target: View,
    source: View,
    params: GaussSphereParams,
) -> list[Found]:
    """Those that some ends of faces do not already tell from rivals, nor from poses in silence.

    few: whether so few planes agree on the best pose that these count.
    """
    if not found:
        return []
    poses, how = [one.pose for one in found], params.outlines
    words, n_ends = placed_by_some(
        target,
        source,
        np.array([pose.rotation for pose in poses]),
        np.array([pose.shift_mm for pose in poses]),
        np.array([one.along for one in found]),
        how,
    )
    if n_ends < how.least:  # too few to tell
        return found
    confirmed = words[:, 2] >= ROUGHLY_CONFIRMED * how.confirmed_share * n_ends
    silent = words[:, :2].sum(axis=1) <= NEARLY_SILENT * n_ends
    least = NEARLY * params.decision.silent_share * best.score
    return [
        one
        for one, is_confirmed, is_silent in zip(found, confirmed, silent, strict=True)
        if is_confirmed or (few and is_silent and one.pose.score > least)
    ]


def _largest(patches: IntArray, view: View) -> int:
    return int(patches[view.patches.area_mm2[patches].argmax()])


def _allowed(pose: Settled, best: Settled, params: DecisionParams) -> bool:
    """Whether a pose lays enough surface on surface, and next to nothing in free space."""
    return is_plain(pose, params) and pose.score > params.repeat_share * best.score


def _settled(
    pose: Settled, best: Settled, target: View, source: View, params: GaussSphereParams
) -> tuple[Settled, int]:
    """The pose as its planes have it, or as it is where they turn it away or it fits clearly less.

    Two planes that are nearly parallel turn a pose by their noise, and by much. With it goes how
    many planes agree there.
    """
    again = settle_best(
        target, source, pose.rotation[None], pose.shift_mm[None], params, look_again=False
    )
    if not again or len(different([pose, again[0]], source, params.decision)) == 2:
        return pose, 0
    good = again[0].score >= AS_GOOD * pose.score and _allowed(again[0], best, params.decision)
    return again[0] if good else pose, agreeing_planes(again[0], target, params.decision)


def _turned(
    best: Settled, agreeing: IntArray, target: View, source: View, params: GaussSphereParams
) -> list[Found]:
    """The pose turned about its planes, or moved along them, where free space allows it.

    agreeing: (m, 2) patches of target and source, a pair a plane. The poses are told by score and
    areas; which planes they match is not looked up.
    """
    decision, search, looks = params.decision, params.translation, params.verification
    needed = decision.repeat_share * best.score
    turning = Turning(
        TURNS_RAD,
        search.patches,
        math.cos(decision.distinct_rad),
        search.distance_tolerance_mm,
        params.match.tolerances_mm[-1],
        np.array([looks.few_stride, looks.rough_stride, params.match.strides[0]]),
        needed,
        decision.distinct_rad,
        decision.distinct_mm,
    )
    how = comparison(params.verification)
    turned = turned_poses(target, source, how, turning, best.rotation, best.shift_mm, agreeing)
    found = []
    for c in np.flatnonzero(turned.score > NEARLY * needed):
        pose = best._replace(
            rotation=turned.rotation[c],
            shift_mm=turned.shift_mm[c],
            information=np.zeros((6, 6)),
            sure=np.zeros((6, 6)),
            pairs=best.pairs[:0],
            distance2=best.distance2[:0],
            areas=turned.areas[c],
            score=float(turned.score[c]),
        )
        if is_nearly_free(pose.areas):
            found.append(Found(pose, turned.along[c], bool(turned.unturned[c])))
    return found
