"""Poses that a symmetry of few planes allows: the best one, turned about the normals of its planes.

The near sides of a box look like its far sides from behind. Where a scene is little more than one
symmetric thing, what both views share does not tell which of its turns is meant: the true pose may
share less than a turned one, and none of them contradicts the scans.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from registration.gauss_sphere.decision import agreeing_planes
from registration.gauss_sphere.matching import Settled, different
from registration.gauss_sphere.outlines import as_ends, outlines_of
from registration.gauss_sphere.params import GaussSphereParams
from registration.gauss_sphere.testimony import ANY_WAY, said
from registration.gauss_sphere.verification import (
    CONTRADICTION,
    SUPPORT,
    Comparison,
    compare_both,
    comparison,
    score_of,
)
from registration.gauss_sphere.view import View
from registration.kernels import compiled
from registration.scan import FloatArray

TURNS_DEG = (60.0, 90.0, 120.0, 180.0, 240.0, 270.0, 300.0)  # of prisms with 2, 3, 4 or 6 sides
WIDEST_STEP_MM, LEAST_STEP_MM = 16.0, 2.0
LEAST_CONFIRMED = 0.5  # of what is denied, as where a pose is a cell or two beside its place
FAR_OFF = 0.5  # contradiction over support from which on a pose is not moved to where it may fit


def turned_rivals(
    best: Settled, target: View, source: View, params: GaussSphereParams
) -> list[Settled]:
    """The pose turned about the middles of its planes, where the scans allow it, best first.

    They do if it lays surface on surface, puts next to nothing in free space, and many ends of
    faces confirm it. None is looked for where more than params.decision.turned_planes agree: few
    things have so many in a symmetric order.
    """
    decision, how = params.decision, params.outlines
    if agreeing_planes(best, target, decision) > decision.turned_planes:
        return []
    turned = _turned(best, target, source, params)
    if not turned:
        return []
    ends = as_ends(outlines_of(target, how)), as_ends(outlines_of(source, how))
    needed = max(how.least, how.confirmed_share * sum(len(e.point_mm) for e in ends))
    rivals = []
    for pose in turned:
        confirmed, denied = said(pose.rotation, pose.shift_mm, target, source, ends, ANY_WAY, how)
        if confirmed >= max(needed, LEAST_CONFIRMED * denied):
            rivals.append(pose)
    return different(rivals, source, decision)


def _turned(best: Settled, target: View, source: View, params: GaussSphereParams) -> list[Settled]:
    """The pose turned about its planes, and moved along them, where free space allows it.

    Pairs and information stay those of the best pose: the turned ones are told by score and areas.
    """
    a, b, decision = target.patches, source.patches, params.decision
    pairs = best.pairs[best.distance2 < decision.agreeing_distance2]
    turns = np.deg2rad(TURNS_DEG)[:, None] * a.normal[pairs[:, 0], None]
    rotations = Rotation.from_rotvec(turns.reshape(-1, 3)).as_matrix() @ best.rotation
    of_target, of_source = np.repeat(pairs, len(TURNS_DEG), axis=0).T
    moved = np.einsum("nij,nj->ni", rotations, b.centroid_mm[of_source])
    shifts = a.centroid_mm[of_target] - moved
    areas, score = _fitted(
        target,
        source,
        comparison(params.verification),
        rotations,
        shifts,
        a.basis[of_target],
        params.match.tolerances_mm[-1],
        params.match.strides[0],
    )
    free = areas[:, CONTRADICTION] <= decision.plain_contradiction * areas[:, SUPPORT]
    return [
        best._replace(
            rotation=rotations[c], shift_mm=shifts[c], areas=areas[c], score=float(score[c])
        )
        for c in np.flatnonzero(free & (score > decision.repeat_share * best.score))
    ]


@compiled
def _fitted(
    target: View,
    source: View,
    how: Comparison,
    rotations: FloatArray,
    shifts: FloatArray,
    along: FloatArray,
    tolerance_mm: float,
    stride: int,
) -> tuple[FloatArray, FloatArray]:
    """Areas (n, 4) and scores (n,) of poses, each moved along two directions to a better score.

    A pose that starts far from fitting is left where it is, with a score of 0.
    rotations (n, 3, 3), shifts (n, 3), changed in place; along: (n, 2, 3).
    """
    n = shifts.shape[0]
    areas, score, seen = np.zeros((n, 4)), np.zeros(n), (target.seen, source.seen)
    counts = np.empty((target.patches.n_points.size, source.patches.n_points.size), np.int64)
    some, trial = np.empty(4), np.empty(3)
    for c in range(n):
        r, t, step_mm = rotations[c], shifts[c], WIDEST_STEP_MM
        compare_both(*seen, how, r, t, tolerance_mm, stride, counts, some)
        best = score_of(how, some)
        if some[CONTRADICTION] > FAR_OFF * some[SUPPORT]:
            continue
        while step_mm >= LEAST_STEP_MM:
            better = False
            for axis in range(2):
                for step in (-step_mm, step_mm):
                    for u in range(3):
                        trial[u] = t[u] + step * along[c, axis, u]
                    compare_both(*seen, how, r, trial, tolerance_mm, stride, counts, some)
                    if score_of(how, some) > best:
                        best, better = score_of(how, some), True
                        t[:] = trial
            if not better:
                step_mm *= 0.5
        compare_both(*seen, how, r, t, tolerance_mm, 1, counts, areas[c])
        score[c] = score_of(how, areas[c])
    return areas, score
