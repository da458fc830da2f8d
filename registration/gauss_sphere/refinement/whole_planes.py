"""Pieces of one plane put together, and the pose that whole planes make likely."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from registration.gauss_sphere.params import GaussSphereParams
from registration.gauss_sphere.planes.patches import Patches
from registration.gauss_sphere.refinement.chance import take_chance
from registration.gauss_sphere.refinement.matching import Settled
from registration.gauss_sphere.refinement.plane_pairs import (
    Difference,
    compare,
    no_difference,
    squared_distance,
)
from registration.gauss_sphere.refinement.refine import (
    EXACTLY,
    Likelihood,
    distances2,
    likelihood,
    maximise,
    widened,
)
from registration.gauss_sphere.small_matrices import invert_symmetric3, is_positive_definite
from registration.kernels import compiled
from registration.scan import FloatArray, IntArray

LEAST_COSINE = 0.98
DOUBT = 2.0
NEARLY = 0.5  # of what was known: no direction may be known less well than that
BARELY = 1e-6  # of what was known before: enough to invert what leaves a direction open


class Joining(NamedTuple):
    """WholePlaneParams as the compiled loops take them; floor_mm: systematic error of a piece."""

    floor_mm: float
    distance2: float
    loosest_mm: float
    rounds: int


def by_whole_planes(
    best: Settled, target: Patches, source: Patches, params: GaussSphereParams
) -> Settled:
    """The settled pose, refined by whole planes.

    A table seen between the things on it is many pieces, and of a wall one view may see the left
    and the other the right: the pose was settled by pieces that lie on each other. Once it is
    known, pieces of one plane count as one, whether a point of both views lies on them or not.
    The pose stays as it was where its planes agree only under a large systematic error, and where
    it would leave its own covariance.
    """
    how = params.whole_planes
    if best.floor_mm > how.most_floor_mm or np.count_nonzero(best.distance2 < how.distance2) < 3:
        return best
    joining = Joining(how.floor_share * best.floor_mm, how.distance2, how.loosest_mm, how.rounds)
    r, t, sure, distance2 = (
        best.rotation.copy(), best.shift_mm.copy(), best.sure.copy(), best.distance2.copy(),
    )  # fmt: skip
    within = _refine_within(
        target, source, best.pairs, likelihood(params.refine), joining, best.floor_mm,
        how.moved_distance2, r, t, sure, distance2,
    )  # fmt: skip
    if not within:
        return best
    return best._replace(rotation=r, shift_mm=t, sure=sure, distance2=distance2)


@compiled
def _refine_within(
    target: Patches,
    source: Patches,
    pairs: IntArray,
    likely: Likelihood,
    joining: Joining,
    floor_mm: float,
    most_moved2: float,
    r: FloatArray,
    t: FloatArray,
    sure: FloatArray,
    distance2: FloatArray,
) -> bool:
    """Refine a pose; False where it leaves what was known of it, or is known less well.

    r (3, 3), t (3,) and sure (6, 6) are changed in place either way, distance2 (m,) of the pairs
    (m, 2) if it is True.
    """
    old_r, old_t, old_sure = r.copy(), t.copy(), sure.copy()
    agreeing = pairs[distance2 < joining.distance2]
    _refine(target, source, agreeing, likely, joining, r, t, sure)
    moved2 = _moved2(old_r, old_t, old_sure, r, t)
    if moved2 > most_moved2 or not is_positive_definite(sure - NEARLY * old_sure):
        return False
    distance2[:] = distances2(target, source, pairs, likely, floor_mm, r, t)
    return True


@compiled
def _moved2(
    r: FloatArray, t: FloatArray, sure: FloatArray, new_r: FloatArray, new_t: FloatArray
) -> float:
    """Squared distance of a new pose from one that is known as well as sure (6, 6) says."""
    turn, step = new_r @ r.T, np.empty(6)
    step[0] = 0.5 * (turn[2, 1] - turn[1, 2])
    step[1] = 0.5 * (turn[0, 2] - turn[2, 0])
    step[2] = 0.5 * (turn[1, 0] - turn[0, 1])
    step[3:] = new_t - turn @ t
    return float(step @ sure @ step)


@compiled
def _compare(
    a: Patches, i: int, b: Patches, k: int, r: FloatArray, t: FloatArray, out: Difference
) -> float:
    """As compare, without floors; called and not inlined, which takes longer to compile."""
    return compare(a, i, b, k, r, t, 0.0, 0.0, out)


@compiled
def put_together(patches: Patches, lever_mm: float, joining: Joining) -> tuple[Patches, IntArray]:
    """Whole planes of one view, and which of them each patch (m,) is a piece of.

    A piece belongs to a plane when its tilts and its offset are, within the noise, those of the
    plane; and the plane must be known well enough to say. The sum of two is what fitting all their
    points would give.
    """
    m = patches.n_points.size
    pieces = _copy(patches)
    for j in range(m):
        pieces.covariance[j, 0, 0] += (joining.floor_mm / lever_mm) ** 2
        pieces.covariance[j, 1, 1] += (joining.floor_mm / lever_mm) ** 2
        pieces.covariance[j, 2, 2] += joining.floor_mm**2
    whole, whole_of = _copy(pieces), np.empty(m, np.int64)
    unturned, unmoved = np.eye(3), np.zeros(3)
    difference = no_difference()
    none = int(np.int64(-1))  # with a plain -1 all would be compiled for that literal, too
    n = 0
    for j in range(m):
        best, nearest2 = none, joining.distance2
        for g in range(n):
            cosine = _compare(pieces, j, whole, g, unturned, unmoved, difference)
            if cosine < LEAST_COSINE or difference.spread[2, 2] > joining.loosest_mm**2:
                continue
            d2 = squared_distance(difference)
            if d2 < nearest2:
                best, nearest2 = g, d2
        if best < 0:
            best = n
            n += 1
            whole.normal[best] = pieces.normal[j]
            whole.centroid_mm[best] = pieces.centroid_mm[j]
            whole.basis[best] = pieces.basis[j]
            whole.covariance[best] = pieces.covariance[j]
            whole.area_mm2[best] = pieces.area_mm2[j]
        else:
            _compare(whole, best, pieces, j, unturned, unmoved, difference)
            _add(whole, best, pieces.area_mm2[j], difference)
        whole_of[j] = best
    return _first(whole, n), whole_of


@compiled
def _copy(p: Patches) -> Patches:
    return Patches(
        p.normal.copy(), p.offset_mm, p.centroid_mm.copy(), p.basis.copy(), p.covariance.copy(),
        p.spread_mm, p.n_points, p.area_mm2.copy(), p.label,
    )  # fmt: skip


@compiled
def _first(p: Patches, n: int) -> Patches:
    return Patches(
        p.normal[:n], p.offset_mm[:n], p.centroid_mm[:n], p.basis[:n], p.covariance[:n],
        p.spread_mm[:n], p.n_points[:n], p.area_mm2[:n], p.label,
    )  # fmt: skip


@compiled
def _add(whole: Patches, g: int, area_mm2: float, difference: Difference) -> None:
    """Add a piece, seen in the coordinates of plane g, to it: each weighs by its covariance."""
    of_whole, of_piece = np.empty((3, 3)), np.empty((3, 3))
    invert_symmetric3(whole.covariance[g], of_whole)
    invert_symmetric3(difference.spread - whole.covariance[g], of_piece)
    together = np.empty((3, 3))
    invert_symmetric3(of_whole + of_piece, together)
    pull, step = np.zeros(3), np.zeros(3)
    for u in range(3):
        for v in range(3):
            pull[u] += of_piece[u, v] * difference.residual[v]
    for u in range(3):
        for v in range(3):
            step[u] += together[u, v] * pull[v]
    normal, basis = whole.normal[g], whole.basis[g]
    whole.centroid_mm[g] += step[2] * normal
    normal += step[0] * basis[0] + step[1] * basis[1]
    normal /= np.sqrt((normal**2).sum())
    for v in range(2):
        basis[v] -= (basis[v] * normal).sum() * normal
        if v == 1:
            basis[1] -= (basis[1] * basis[0]).sum() * basis[0]
        basis[v] /= np.sqrt((basis[v] ** 2).sum())
    whole.covariance[g] = together
    whole.area_mm2[g] += area_mm2


@compiled
def _refine(
    target: Patches,
    source: Patches,
    agreeing: IntArray,
    likely: Likelihood,
    joining: Joining,
    r: FloatArray,
    t: FloatArray,
    sure: FloatArray,
) -> None:
    """Refine the pose r, t in place by the whole planes of the pairs that agree, and by others.

    After each refinement the plane of which the pose foretells best where the other view should
    see it joins in, if it does see it there. sure: (6, 6) out.
    """
    whole_a, of_a = put_together(target, likely.lever_mm, joining)
    whole_b, of_b = put_together(source, likely.lever_mm, joining)
    n_a, n_b = whole_a.normal.shape[0], whole_b.normal.shape[0]
    # Each plane once: paired with two pieces that the other view left apart, it would count twice.
    used_a, used_b = np.zeros(n_a, np.bool_), np.zeros(n_b, np.bool_)
    pairs = np.empty((n_a * n_b, 2), np.int64)
    n = 0
    for m in range(agreeing.shape[0]):
        i, k = of_a[agreeing[m, 0]], of_b[agreeing[m, 1]]
        if not (used_a[i] or used_b[k]):
            used_a[i] = used_b[k] = True
            pairs[n, 0], pairs[n, 1] = i, k
            n += 1
    distance2, information = np.empty(n_a * n_b), np.empty((6, 6))
    difference = no_difference()
    before, wide_mm = sure.copy(), 0.0
    for done in range(joining.rounds + 1):
        maximise(whole_a, whole_b, pairs[:n], likely, 0.0, r, t, information, distance2, EXACTLY)
        wide_mm = widened(whole_a, whole_b, pairs[:n], likely, 0.0, r, t, sure, DOUBT)
        if done == joining.rounds:
            break
        covariance = np.linalg.inv(sure + BARELY * before)
        best_i, best_k, least = -1, -1, joining.loosest_mm**2
        for i in range(n_a):
            for k in range(n_b):
                if used_a[i] or used_b[k]:
                    continue
                cosine = _compare(whole_a, i, whole_b, k, r, t, difference)
                if cosine < LEAST_COSINE:
                    continue
                jacobian = difference.jacobian
                difference.spread[:] += jacobian @ covariance @ jacobian.T
                if difference.spread[2, 2] > least:
                    continue
                if squared_distance(difference) < joining.distance2:
                    best_i, best_k, least = i, k, difference.spread[2, 2]
        if best_i < 0:
            break
        used_a[best_i] = used_b[best_k] = True
        pairs[n, 0], pairs[n, 1] = best_i, best_k
        n += 1
    take_chance(whole_a, whole_b, pairs[:n], likely, wide_mm, r, t, sure)
