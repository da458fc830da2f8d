"""Poses that a symmetry of few planes allows: the best one, turned about the normals of its planes.

The near sides of a box look like its far sides from behind. Where a scene is little more than one
symmetric thing, what both views share does not tell which of its turns is meant: the true pose may
share less than a turned one, and none of them contradicts the scans.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from registration.gauss_sphere.decision import agreeing_patches
from registration.gauss_sphere.matching import Settled, different, settle_best
from registration.gauss_sphere.outlines import Ends, as_ends, outlines_of
from registration.gauss_sphere.params import GaussSphereParams
from registration.gauss_sphere.poses import are_same
from registration.gauss_sphere.testimony import ANY_WAY, said, said_of_ends
from registration.gauss_sphere.verification import (
    CONTRADICTION,
    SUPPORT,
    Comparison,
    compare_both,
    compared,
    comparison,
    score_of,
)
from registration.gauss_sphere.view import View
from registration.kernels import compiled
from registration.scan import FloatArray, IntArray

SIDES_OF_PRISMS = (2, 3, 4, 5, 6, 8)  # that look the same a turn of 360 degrees / sides further
TURNS_DEG = tuple(sorted({360.0 * k / n for n in SIDES_OF_PRISMS for k in range(1, n)}))
WIDEST_STEP_MM, LEAST_STEP_MM = 16.0, 2.0
MOST_STEPS = 24  # that a pose is moved by, of all widths together
FEW, WORTH_LOOKING = 3, 0.3  # support that a third of the samples must tell of, to ask more
WORTH_MOVING = 0.5  # of the score that a rival needs: a pose with less is not moved to a better fit
NEARLY = 0.8  # of that score: what it needs before it is placed
FAR_OFF = 0.5  # contradiction over support from which on it is not moved, either
OPEN_STEPS_MM = (8.0, 4.0, 2.0)  # along which a pose is moved to where ends of faces confirm it
AS_GOOD = 0.98  # of the score of a pose that ends placed: with it that of its planes is taken


def turned_rivals(
    best: Settled, target: View, source: View, params: GaussSphereParams
) -> list[Settled]:
    """The pose turned about the normals of its planes, where the scans allow it, best first.

    They do if it lays surface on surface, puts next to nothing in free space, and ends of faces
    speak for it nearly as well as for the best pose. None is looked for where more than
    params.decision.turned_planes agree.
    """
    decision, how = params.decision, params.outlines
    agreeing = agreeing_patches(best, target, decision)
    if len(agreeing) > decision.turned_planes:
        return []
    turned, along = _turned(best, agreeing, target, source, params)
    if not turned:
        return []
    ends = as_ends(outlines_of(target, how)), as_ends(outlines_of(source, how))
    least = max(how.least, how.confirmed_share * sum(len(e.point_mm) for e in ends))
    of_best = said(best.rotation, best.shift_mm, target, source, ends, ANY_WAY, how)
    most_denied = _share_denied(*of_best) + decision.turned_denied
    rivals = []
    for pose in different(turned, source, decision):
        (axes,) = (axes for one, axes in zip(turned, along, strict=True) if one is pose)
        t = pose.shift_mm.copy()
        confirmed, denied = _placed(
            target, source, *ends, pose.rotation, t, axes, np.array(OPEN_STEPS_MM), how.off_mm,
            how.on_mm, how.behind_mm,
        )  # fmt: skip
        placed = _scored(pose._replace(shift_mm=t), target, source, params)
        free = placed.areas[CONTRADICTION] <= decision.turned_contradiction * placed.areas[SUPPORT]
        enough = confirmed >= least and placed.score > decision.repeat_share * best.score
        if free and enough and _share_denied(confirmed, denied) <= most_denied:
            rivals.append(_settled(placed, target, source, params))
    return different(rivals, source, decision)


def _share_denied(confirmed: int, denied: int) -> float:
    """What is denied, of all ends of faces that the other view tells of."""
    return denied / max(confirmed + denied, 1)


def _scored(pose: Settled, target: View, source: View, params: GaussSphereParams) -> Settled:
    """The pose with what the scans say of it."""
    areas, score = compared(
        target, source, pose.rotation, pose.shift_mm, params.match.tolerances_mm[-1],
        params.verification,
    )  # fmt: skip
    return pose._replace(areas=areas, score=score)


def _settled(pose: Settled, target: View, source: View, params: GaussSphereParams) -> Settled:
    """The pose as its planes have it, or as it is where they turn it away or fit the less.

    Two planes that are nearly parallel turn a pose by their noise, and by much.
    """
    again = settle_best(
        target, source, pose.rotation[None], pose.shift_mm[None], params, look_again=False
    )
    if (
        again
        and again[0].score >= AS_GOOD * pose.score
        and len(different([pose, again[0]], source, params.decision)) == 1
    ):
        return again[0]
    return pose


def _turned(
    best: Settled, agreeing: IntArray, target: View, source: View, params: GaussSphereParams
) -> tuple[list[Settled], list[FloatArray]]:
    """The pose turned about its planes, and moved along them, where free space allows it.

    agreeing: (m, 2) patches of target and source, a pair a plane. The turned poses are told by
    score and areas; which planes they match is not looked up. With each go the two directions,
    (2, 3), along which it was moved.
    """
    a, b, decision = target.patches, source.patches, params.decision
    starts = _pairs_of_planes(best, agreeing, target, source, params)
    turns = np.deg2rad(TURNS_DEG)[:, None] * a.normal[starts[:, 2], None]
    rotations = Rotation.from_rotvec(turns.reshape(-1, 3)).as_matrix() @ best.rotation
    of_target, of_source, of_plane = np.repeat(starts, len(TURNS_DEG), axis=0).T
    along = a.basis[of_plane]
    moved = np.einsum("nij,nj->ni", rotations, b.centroid_mm[of_source])
    shifts = a.centroid_mm[of_target] - moved
    needed = decision.repeat_share * best.score
    areas, score = _fitted(
        target,
        source,
        comparison(params.verification),
        rotations,
        shifts,
        along,
        params.match.tolerances_mm[-1],
        np.array([params.verification.rough_stride, params.match.strides[0]]),
        needed,
        decision.distinct_rad,
    )
    rough = best._replace(
        information=np.zeros((6, 6)), sure=np.zeros((6, 6)), pairs=best.pairs[:0],
        distance2=best.distance2[:0],
    )  # fmt: skip
    free = areas[:, CONTRADICTION] <= decision.turned_contradiction * areas[:, SUPPORT]
    chosen = np.flatnonzero(free & (score > NEARLY * needed))
    poses = [
        rough._replace(
            rotation=rotations[c], shift_mm=shifts[c], areas=areas[c], score=float(score[c])
        )
        for c in chosen
    ]
    return poses, [along[c] for c in chosen]


def _pairs_of_planes(
    best: Settled, agreeing: IntArray, target: View, source: View, params: GaussSphereParams
) -> IntArray:
    """(n, 3) pairs of patches that lie in one plane under the pose, and the patch of that plane.

    First the pairs that agree, (m, 2); then all others, as the tops of two boxes: about a turned
    pose one box may lie on the other. The largest, so many as are shifts looked for with.
    """
    a, b, decision, most = target.patches, source.patches, params.decision, params.translation
    normal = a.normal[agreeing[:, 0]].T
    large_a, large_b = slice(most.patches), slice(most.patches)
    like_a = a.normal[large_a] @ normal > np.cos(decision.distinct_rad)
    like_b = b.normal[large_b] @ best.rotation.T @ normal > np.cos(decision.distinct_rad)
    moved = b.centroid_mm[large_b] @ best.rotation.T + best.shift_mm
    apart_mm = (a.centroid_mm[large_a] @ normal)[:, None] - (moved @ normal)[None]
    together = like_a[:, None] & like_b[None] & (abs(apart_mm) < most.distance_tolerance_mm)
    for i, j in agreeing:
        together[i : i + 1, j : j + 1] = False
    i, j = np.nonzero(together.any(axis=2))
    plane = agreeing[together[i, j].argmax(axis=1), 0]
    largest = np.argsort(-np.minimum(a.area_mm2[i], b.area_mm2[j]), kind="stable")[: most.patches]
    others = np.stack([i, j, plane], axis=1)[largest]
    starts: IntArray = np.concatenate([agreeing[:, [0, 1, 0]], others])
    return starts


@compiled
def _placed(
    target: View,
    source: View,
    of_target: Ends,
    of_source: Ends,
    r: FloatArray,
    t: FloatArray,
    along: FloatArray,
    steps_mm: FloatArray,
    off_mm: float,
    on_mm: float,
    behind_mm: float,
) -> tuple[int, int]:
    """Move a pose along two directions to where most ends of faces confirm it, and fewest deny it.

    Support does not tell where along its planes it is. t (3,) is changed in place; along: (2, 3).
    Returns how many ends confirm it, and how many deny it.
    """
    any_way, trial, how = np.zeros(3), np.empty(3), (off_mm, on_mm, behind_mm)
    said = said_of_ends(r, t, target, source, of_target, of_source, any_way, *how)
    for step_mm in steps_mm:
        for _ in range(3):
            better = False
            for axis in range(2):
                for step in (-step_mm, step_mm):
                    for u in range(3):
                        trial[u] = t[u] + step * along[axis, u]
                    there = said_of_ends(
                        r, trial, target, source, of_target, of_source, any_way, *how
                    )
                    if there[0] - there[1] > said[0] - said[1]:
                        said, better = there, True
                        t[:] = trial
            if not better:
                break
    return said


@compiled
def _fitted(
    target: View,
    source: View,
    how: Comparison,
    rotations: FloatArray,
    shifts: FloatArray,
    along: FloatArray,
    tolerance_mm: float,
    strides: IntArray,
    needed: float,
    distinct_rad: float,
) -> tuple[FloatArray, FloatArray]:
    """Areas (n, 4) and scores (n,) of poses, each moved along two directions to a better score.

    The best are moved first, and only one of those that are turned alike. The rest is left where it
    is, with a score of 0.
    strides: (2,) of the samples that are looked at, to find the best starts and to move them;
    needed: score that a pose needs. rotations (n, 3, 3); shifts (n, 3), changed in place;
    along: (n, 2, 3).
    """
    n, nowhere = shifts.shape[0], np.zeros(3)
    areas, score, seen = np.zeros((n, 4)), np.zeros(n), (target.seen, source.seen)
    counts = np.empty((target.patches.n_points.size, source.patches.n_points.size), np.int64)
    some, start = np.empty(4), np.zeros(n)
    for c in range(n):
        r, t = rotations[c], shifts[c]
        compare_both(*seen, how, r, t, tolerance_mm, FEW * strides[0], counts, some)
        if some[SUPPORT] < WORTH_LOOKING * needed:
            continue
        compare_both(*seen, how, r, t, tolerance_mm, strides[0], counts, some)
        far = some[CONTRADICTION] > FAR_OFF * some[SUPPORT]
        start[c] = 0.0 if far else score_of(how, some)
    for c in np.argsort(-start, kind="mergesort"):
        if start[c] < WORTH_MOVING * needed:
            break
        r, t, known = rotations[c], shifts[c], False
        for k in range(n):
            known = known or (
                score[k] > needed
                and are_same(r, nowhere, rotations[k], nowhere, nowhere, distinct_rad, np.inf)
            )
        if known:
            continue
        _move_to_fit(target, source, how, r, t, along[c], tolerance_mm, strides[1], counts)
        compare_both(*seen, how, r, t, tolerance_mm, 1, counts, areas[c])
        score[c] = score_of(how, areas[c])
    return areas, score


@compiled
def _move_to_fit(
    target: View,
    source: View,
    how: Comparison,
    r: FloatArray,
    t: FloatArray,
    along: FloatArray,
    tolerance_mm: float,
    stride: int,
    counts: IntArray,
) -> None:
    """Move a pose along two directions (2, 3) to a better score: t (3,) is changed in place."""
    seen, some, trial = (target.seen, source.seen), np.empty(4), np.empty(3)
    compare_both(*seen, how, r, t, tolerance_mm, stride, counts, some)
    best, step_mm = score_of(how, some), WIDEST_STEP_MM
    for _ in range(MOST_STEPS):
        if step_mm < LEAST_STEP_MM:
            break
        better = False
        for axis in range(2):
            for step in (-step_mm, step_mm):
                for u in range(3):
                    trial[u] = t[u] + step * along[axis, u]
                compare_both(*seen, how, r, trial, tolerance_mm, stride, counts, some)
                if score_of(how, some) > best:
                    best, better = score_of(how, some), True
                    t[:] = trial
        if not better:
            step_mm *= 0.5
