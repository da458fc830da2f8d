"""Translation candidates for a rotation: shifts that many pairs of planes agree on."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from registration.gauss_sphere.pair_shifts import (
    PairShifts,
    agrees,
    fuse,
    pair_up,
    refit,
    room_for,
)
from registration.gauss_sphere.params import TranslationParams
from registration.gauss_sphere.patches import Patches
from registration.kernels import compiled
from registration.scan import FloatArray, IntArray

LEAST_SINE = 0.24  # between the normals of two planes that start a shift
LEAST_ACROSS = 0.5  # cosine between the line that they leave and the normal of a third


class Search(NamedTuple):
    """TranslationParams as the compiled loops take them."""

    patches: int
    cos_tolerance: float
    pairs: int
    third_pairs: int
    starts: int
    per_line: int
    distance_tolerance_mm: float
    tilt_tolerance_rad: float
    reach: float
    distinct_mm: float
    kept: int


def pose_candidates(
    target: Patches, source: Patches, rotations: FloatArray, params: TranslationParams
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Find for every rotation the shifts with most agreement in 3D.

    Two pairs of planes start a shift and leave a line open; where third pairs are densest on it
    they fix it (section 5.7, density in place of centroids). All pairs that agree refine it.

    Returns (c, 3, 3) rotations, (c, 3) shifts in mm, (c,) agreeing area in mm^2, best first.
    """
    # Few rotations, as of scenes along three axes, leave the more shifts to tell apart.
    kept = max(params.kept_per_rotation, params.kept // max(rotations.shape[0], 1))
    capacity = rotations.shape[0] * kept
    out_r, out_t = np.empty((capacity, 3, 3)), np.empty((capacity, 3))
    out_score = np.empty(capacity)
    found = _shifts(
        target,
        source,
        rotations,
        Search(
            params.patches,
            math.cos(params.angle_tolerance_rad),
            params.pairs,
            params.third_pairs,
            params.starts,
            params.per_line,
            params.distance_tolerance_mm,
            params.tilt_tolerance_rad,
            params.reach,
            params.distinct_mm,
            kept,
        ),
        out_r,
        out_t,
        out_score,
    )
    order = np.argsort(-out_score[:found], kind="stable")
    return out_r[order], out_t[order], out_score[order]


@compiled
def _shifts(
    target: Patches,
    source: Patches,
    rotations: FloatArray,
    search: Search,
    out_r: FloatArray,
    out_t: FloatArray,
    out_score: FloatArray,
) -> int:
    n_target = min(target.n_points.size, search.patches)
    n_source = min(source.n_points.size, search.patches)
    pairs = room_for(n_target * n_source)
    kept_t, kept_score = np.empty((search.kept, 3)), np.empty(search.kept)
    served = np.empty(n_source)
    found = 0
    for c in range(rotations.shape[0]):
        m = pair_up(
            target, source, n_target, n_source, rotations[c], search.cos_tolerance,
            search.distance_tolerance_mm, search.tilt_tolerance_rad, search.reach, pairs,
        )  # fmt: skip
        if m == 0:
            continue
        order = np.argsort(-pairs.weight[:m], kind="mergesort")[: search.third_pairs]
        n_kept = _search(pairs, order, search, served, kept_t, kept_score)
        for j in range(n_kept):
            out_r[found] = rotations[c]
            out_t[found] = kept_t[j]
            out_score[found] = kept_score[j]
            found += 1
    return found


@compiled
def _search(
    pairs: PairShifts,
    order: IntArray,
    search: Search,
    served: FloatArray,
    kept_t: FloatArray,
    kept_score: FloatArray,
) -> int:
    """Shifts that most pairs agree on, best first, and their areas; returns how many there are."""
    t, start, line = np.empty(3), np.empty(3), np.empty(3)
    crossing, area = np.empty(order.size), np.empty(order.size)
    n_kept, n_starts = 0, 0
    first = min(order.size, search.pairs)
    for total in range(1, 2 * first - 2):
        # Pairs of pairs in order of their ranks' sum: the large planes first.
        for one in range(max(0, total - first + 1), (total + 1) // 2):
            p, q = order[one], order[total - one]
            if pairs.target[p] == pairs.target[q] or pairs.source[p] == pairs.source[q]:
                continue
            if not _line_of(pairs, p, q, line):
                continue
            fuse(pairs, p, q, start)
            if not agrees(pairs, p, start) or not agrees(pairs, q, start):
                continue
            n = _crossings(pairs, order, p, q, start, line, crossing, area)
            # Where the outlines put it, then where third planes are densest along the line.
            place = 0.0
            for turn in range(1 + search.per_line):
                if turn > 0:
                    place = _densest(crossing[:n], area[:n], search.distance_tolerance_mm)
                    if not np.isfinite(place):
                        break
                for u in range(3):
                    t[u] = start[u] + place * line[u]
                score = 0.0
                for _ in range(2):
                    score = refit(pairs, order, t, served)
                n_kept = _keep(t, score, search.distinct_mm, kept_t, kept_score, n_kept)
                n_starts += 1
            if n_starts >= search.starts:
                return n_kept
    return n_kept


@compiled
def _line_of(pairs: PairShifts, p: int, q: int, line: FloatArray) -> bool:
    """The direction (3,) that the planes of two pairs leave open; False where it is not one."""
    a, b = pairs.normal[p], pairs.normal[q]
    line[0] = a[1] * b[2] - a[2] * b[1]
    line[1] = a[2] * b[0] - a[0] * b[2]
    line[2] = a[0] * b[1] - a[1] * b[0]
    size = np.sqrt(line[0] ** 2 + line[1] ** 2 + line[2] ** 2)
    if size < LEAST_SINE:
        return False
    for u in range(3):
        line[u] /= size
    return True


@compiled
def _crossings(
    pairs: PairShifts,
    order: IntArray,
    p: int,
    q: int,
    start: FloatArray,
    line: FloatArray,
    crossing: FloatArray,
    area: FloatArray,
) -> int:
    """Where the planes of third pairs cut the line from start, in mm along it; how many do."""
    n, t = 0, np.empty(3)
    for s in order:
        across, ahead = 0.0, pairs.delta_mm[s]
        for u in range(3):
            across += pairs.normal[s, u] * line[u]
            ahead -= pairs.normal[s, u] * start[u]
        if abs(across) < LEAST_ACROSS:
            continue
        place = ahead / across
        for u in range(3):
            t[u] = start[u] + place * line[u]
        if agrees(pairs, s, t) and agrees(pairs, p, t) and agrees(pairs, q, t):
            crossing[n], area[n] = place, pairs.weight[s]
            n += 1
    return n


@compiled
def _densest(crossing: FloatArray, area: FloatArray, window_mm: float) -> float:
    """The crossing with most area around it, which is then used up; NaN where none is left."""
    best, place = 0.0, np.nan
    for j in range(crossing.size):
        near = 0.0
        for k in range(crossing.size):
            if abs(crossing[k] - crossing[j]) < window_mm:
                near += area[k]
        if area[j] > 0.0 and near > best:
            best, place = near, crossing[j]
    for k in range(crossing.size):
        if abs(crossing[k] - place) < 2.0 * window_mm:
            area[k] = 0.0
    return place


@compiled
def _keep(
    t: FloatArray,
    score: float,
    distinct: float,
    kept_t: FloatArray,
    kept_score: FloatArray,
    n: int,
) -> int:
    """Keep the best scores of distinct shifts, sorted by insertion."""
    for j in range(n):
        d0, d1, d2 = kept_t[j, 0] - t[0], kept_t[j, 1] - t[1], kept_t[j, 2] - t[2]
        if d0 * d0 + d1 * d1 + d2 * d2 < distinct * distinct:
            if score > kept_score[j]:
                kept_t[j] = t
                kept_score[j] = score
            return n
    if n < kept_score.size:
        n += 1
    elif score <= kept_score[n - 1]:
        return n
    j = n - 1
    while j > 0 and kept_score[j - 1] < score:
        kept_score[j] = kept_score[j - 1]
        kept_t[j] = kept_t[j - 1]
        j -= 1
    kept_score[j] = score
    kept_t[j] = t
    return n
