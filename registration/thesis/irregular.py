"""Patches of any shape and what lies between groups of profiles (chapter 7)."""

from __future__ import annotations

import numpy as np

from registration.kernels import compiled
from registration.scan import FloatArray, IntArray, Scan
from registration.thesis.merging import run_beside
from registration.thesis.segments import Segments


def covered_points(
    segments: Segments, index: IntArray, patch: IntArray, scan: Scan | None
) -> tuple[FloatArray, IntArray]:
    """All measured points of the segments of each patch, or as many along their lines.

    index, patch: (s,) segments and the patch of each. Without a scan the points of a segment are
    spread evenly between its ends. Returns (q, 3) mm and (q,).
    """
    if scan is None:
        count = segments.count[index]
        ends = np.repeat(segments.endpoints_mm[index], count, axis=0)
        number = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        share = (number / np.maximum(np.repeat(count, count) - 1, 1))[:, None]
        return ends[:, 0] + share * (ends[:, 1] - ends[:, 0]), np.repeat(patch, count)
    width = segments.last[index] - segments.first[index] + 1
    pixel = np.arange(width.sum()) - np.repeat(np.cumsum(width) - width, width)
    pixel += np.repeat(segments.first[index], width)
    points = scan.points_mm[np.repeat(segments.profile[index], width), pixel]
    measured = np.isfinite(points[:, 2])
    return points[measured], np.repeat(patch, width)[measured]


def strip_areas(
    segments: Segments, index: IntArray, patch: IntArray, normal: FloatArray, offset_mm: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Area and centroid of patches made of strips, each a segment and one step wide.

    normal, offset_mm: (m, 3), (m,) the planes. Returns (m,) mm^2 and (m, 3) mm, on the plane.
    Sections of a plane by planes of constant X, step apart, are step / sqrt(1 - n_x^2) apart.
    """
    m = len(normal)
    x, profile = segments.centroid_mm[index, 0], segments.profile[index]
    step = (x.max() - x.min()) / max(int(profile.max() - profile.min()), 1) if len(x) else 0.0
    spread = np.sqrt(np.maximum(1.0 - normal[:, 0] ** 2, 1e-12))
    length = segments.length_mm[index]
    total = np.bincount(patch, length, minlength=m)
    middle = segments.endpoints_mm[index].mean(axis=1)
    centroid = np.stack(
        [np.bincount(patch, length * middle[:, c], minlength=m) / total for c in range(3)], axis=1
    )
    height = np.einsum("mj,mj->m", centroid, normal) - offset_mm
    return total * step / spread, centroid - height[:, None] * normal


def join_transitions(
    segments: Segments, chain: IntArray, seeds: list[IntArray], coplanar_mm: float
) -> IntArray:
    """Let the chains beside a patch join it where they lie on its plane.

    seeds: the chains that make a patch by themselves, as indices of their segments; the one with
        the longest segments in all grows first, and its plane with it.
    A chain joins when one of its segments runs beside one of the patch's in the profile before or
    after, and the ends of all of its segments lie within coplanar_mm of the plane. What joins none
    is left as it is. Returns (n,) chain of each segment, in the numbering given.
    """
    members = _by_chain(chain)
    beside = _neighbours(segments, chain)
    weight = {int(chain[seed[0]]): float(segments.length_mm[seed].sum()) for seed in seeds}
    joined = chain.copy()
    free = np.ones(len(members), dtype=bool)
    for seed in sorted(weight, key=lambda c: (-weight[c], c)):
        if not free[seed]:
            continue
        free[seed] = False
        moments = _moments(segments, members[seed])
        normal, centre = _plane(moments)
        waiting = list(beside[seed])
        while waiting:
            c = waiting.pop(0)
            if not free[c]:
                continue
            ends = segments.endpoints_mm[members[c]].reshape(-1, 3)
            if (np.abs((ends - centre) @ normal) > coplanar_mm).any():
                continue
            free[c] = False
            joined[members[c]] = seed
            moments = moments + _moments(segments, members[c])
            normal, centre = _plane(moments)
            waiting += beside[c]
    return joined


def _by_chain(chain: IntArray) -> list[IntArray]:
    """The segments of every chain, in order."""
    order = np.argsort(chain, kind="stable")
    count = np.bincount(chain) if len(chain) else np.zeros(0, dtype=np.int64)
    return list(np.split(order, np.cumsum(count)[:-1])) if len(count) else []


def _neighbours(segments: Segments, chain: IntArray) -> list[list[int]]:
    """For every chain those with a segment beside one of its own, longest stretch first."""
    starts = np.searchsorted(segments.profile, np.arange(segments.profile.max(initial=-1) + 2))
    ends = np.ascontiguousarray(segments.endpoints_mm[:, :, 1:])
    pairs, shared = _beside(starts.astype(np.int64), ends)
    near: list[list[int]] = [[] for _ in range(int(chain.max(initial=-1)) + 1)]
    for q in np.argsort(-shared, kind="stable"):
        a, b = int(chain[pairs[q, 0]]), int(chain[pairs[q, 1]])
        if a != b:
            near[a].append(b)
            near[b].append(a)
    return near


@compiled
def _beside(starts: IntArray, ends: FloatArray) -> tuple[IntArray, FloatArray]:
    """(q, 2) segments of neighbouring profiles that run beside each other, and (q,) how far."""
    most = 0
    for k in range(1, len(starts) - 1):
        most += (starts[k] - starts[k - 1]) * (starts[k + 1] - starts[k])
    pairs = np.empty((most, 2), dtype=np.int64)
    shared = np.empty(most)
    q = 0
    for k in range(1, len(starts) - 1):
        for i in range(starts[k - 1], starts[k]):
            for j in range(starts[k], starts[k + 1]):
                stretch = run_beside(ends[i], ends[j], np.inf)
                if stretch > 0.0:
                    pairs[q, 0] = i
                    pairs[q, 1] = j
                    shared[q] = stretch
                    q += 1
    return pairs[:q], shared[:q]


def _moments(segments: Segments, index: IntArray) -> FloatArray:
    """(4, 4) sum of the products of (x, y, z, 1) over evenly filled segments, by their points.

    A segment of length l spreads its points by l^2 / 12 along its direction.
    """
    count = segments.count[index].astype(np.float64)
    rows = np.column_stack([segments.centroid_mm[index], np.ones(len(index))])
    sums: FloatArray = np.einsum("s,si,sj->ij", count, rows, rows)
    along = segments.direction[index] * segments.length_mm[index, None]
    sums[:3, :3] += np.einsum("s,si,sj->ij", count / 12.0, along, along)
    return sums


def _plane(moments: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit normal, of arbitrary sign, and a point of the least-squares plane."""
    centre = moments[:3, 3] / moments[3, 3]
    scatter = moments[:3, :3] / moments[3, 3] - np.outer(centre, centre)
    return np.linalg.eigh(scatter)[1][:, 0], centre
