"""Profiles to straight segments: optimal splits by least squares in inverse depth."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from registration.gauss_sphere.fan.beams import Fan
from registration.gauss_sphere.params import SegmentParams
from registration.kernels import compiled
from registration.scan import FloatArray, IntArray

COARSE = 16  # splits of a piece that are tried before the best one is refined


class Segments(NamedTuple):
    """Straight pieces in the order of profiles and pixels, structure of arrays.

    profile, first, last: (n,) profile and inclusive pixel range.  n_points: (n,) measured points.
    slope_low, slope_high: (n,) range of beam slopes.
    sums: (n, 6) sums of 1, s, s^2, q, s q, q^2 over the points, q the inverse depth, each weighted
        by 1 / variance of q: adding rows is fitting together.
    """

    profile: IntArray
    first: IntArray
    last: IntArray
    n_points: IntArray
    slope_low: FloatArray
    slope_high: FloatArray
    sums: FloatArray


class Cutting(NamedTuple):
    """SegmentParams as the compiled loops take them."""

    cliff_mm: float
    max_gap_pixels: int
    min_points: int
    split_gain: float
    tolerance_sigma: float


def cutting(params: SegmentParams) -> Cutting:
    """The parameters that say how profiles are cut."""
    return Cutting(
        params.cliff_mm,
        params.max_gap_pixels,
        params.min_points,
        params.split_gain,
        params.tolerance_sigma,
    )


@compiled
def _line_rss(sums: FloatArray, a: int, b: int) -> float:
    """Chi-square of the best line through points a..b-1, from running sums."""
    w, s, q = sums[b, 0] - sums[a, 0], sums[b, 1] - sums[a, 1], sums[b, 3] - sums[a, 3]
    # Variance of s, and covariance of s and q, times w^2: dividing once costs half.
    spread = w * (sums[b, 2] - sums[a, 2]) - s * s
    shared = w * (sums[b, 4] - sums[a, 4]) - s * q
    explained = (q * q * spread + shared * shared) / (w * spread) if spread > 0.0 else q * q / w
    rss = sums[b, 5] - sums[a, 5] - explained
    return rss if rss > 0.0 else 0.0


@compiled
def _best_split(sums: FloatArray, a: int, b: int, least: int) -> tuple[int, float]:
    """Where two lines fit points a..b-1 best, and their chi-square: coarse, then fine."""
    best, where = np.inf, -1
    stride = max(1, (b - a) // COARSE)
    for k in range(a + least, b - least + 1, stride):
        rss = _line_rss(sums, a, k) + _line_rss(sums, k, b)
        if rss < best:
            best, where = rss, k
    while stride > 1 and where >= 0:
        stride = (stride + 1) // 2
        middle = where
        for k in (middle - stride, middle + stride):
            if a + least <= k <= b - least:
                rss = _line_rss(sums, a, k) + _line_rss(sums, k, b)
                if rss < best:
                    best, where = rss, k
    return where, best


@compiled
def _has_neighbour(depth: FloatArray, u: int, far: float, max_gap: int) -> bool:
    """Whether a point beyond a gap to either side, the next there, is about as deep."""
    for step in (-1, 1):
        for gap in range(1, max_gap + 1):
            v = u + step * (gap + 1)
            if not 0 <= v < depth.size or np.isfinite(depth[v - step]):
                break
            if abs(depth[v] - depth[u]) < far:
                return True
    return False


@compiled
def _running_sums(
    depth: FloatArray,
    slope: FloatArray,
    sigma: FloatArray,
    cliff: float,
    max_gap: int,
    index: IntArray,
    sums: FloatArray,
) -> int:
    """Sums (pixels + 1, 6) over the points before each, their pixels, and how many there are."""
    m, w_, ws, wss, wq, wsq, wqq = 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for u in range(depth.size):
        d, s, far = depth[u], slope[u], cliff + 5.0 * sigma[u]
        if np.isnan(d):
            continue
        # An isolated point, far from both neighbours in depth, is an outlier.
        left = u > 0 and abs(depth[u - 1] - d) < far
        right = u + 1 < depth.size and abs(depth[u + 1] - d) < far
        if not (left or right or _has_neighbour(depth, u, far, max_gap)):
            continue
        index[m] = u
        m += 1
        q, root = 1.0 / d, d * d / sigma[u]
        w = root * root
        w_ += w
        ws += w * s
        wss += w * s * s
        wq += w * q
        wsq += w * s * q
        wqq += w * q * q
        sums[m, 0], sums[m, 1], sums[m, 2] = w_, ws, wss
        sums[m, 3], sums[m, 4], sums[m, 5] = wq, wsq, wqq
    return m


@compiled
def _cut(
    sums: FloatArray,
    start: int,
    end: int,
    least: int,
    split_gain: float,
    tolerance: float,
    stack: IntArray,
    best_of: IntArray,
    cuts: IntArray,
) -> int:
    """Cut points start..end-1 where lines change; returns the number of cuts, both ends included.

    stack: (2 pixels + 4, 2) to work in.  best_of: (pixels + 2, 2) to work in, between which cuts a
    cut was found best: written for each before it is read.  cuts: (pixels + 2,) out.
    """
    # Binary splitting leaves the cuts in order, because the left half is done first.
    n_cuts, top = 1, 1
    cuts[0] = start
    stack[0, 0], stack[0, 1] = start, end
    while top > 0:
        top -= 1
        a, b = stack[top, 0], stack[top, 1]
        split = False
        needed = split_gain + tolerance * tolerance * (b - a)
        whole = _line_rss(sums, a, b)
        if b - a >= 2 * least and whole > needed:
            where, rss = _best_split(sums, a, b, least)
            if where >= 0 and whole - rss > needed:
                best_of[where, 0], best_of[where, 1] = a, b
                stack[top, 0], stack[top, 1] = where, b
                stack[top + 1, 0], stack[top + 1, 1] = a, where
                top += 2
                split = True
        if not split:
            cuts[n_cuts] = b
            n_cuts += 1
    # Each cut again, best between its neighbours; then cuts that win nothing go.
    for _ in range(2):
        for c in range(1, n_cuts - 1):
            a, k, b = cuts[c - 1], cuts[c], cuts[c + 1]
            if best_of[k, 0] == a and best_of[k, 1] == b:
                continue
            where, rss = _best_split(sums, a, b, least)
            cuts[c] = where if where >= 0 else k
            best_of[cuts[c], 0], best_of[cuts[c], 1] = a, b
    c = 1
    while c < n_cuts - 1:
        a, k, b = cuts[c - 1], cuts[c], cuts[c + 1]
        gain = _line_rss(sums, a, b) - _line_rss(sums, a, k) - _line_rss(sums, k, b)
        if gain <= split_gain + tolerance * tolerance * (b - a):
            for i in range(c, n_cuts - 1):
                cuts[i] = cuts[i + 1]
            n_cuts -= 1
        else:
            c += 1
    return n_cuts


@compiled
def find_segments(fan: Fan, how: Cutting) -> Segments:
    """Cut every profile into the straight pieces that its noise can tell apart."""
    cliff, max_gap, least = how.cliff_mm, how.max_gap_pixels, how.min_points
    split_gain, tolerance = how.split_gain, how.tolerance_sigma
    n_profiles, n_pixels = fan.depth_mm.shape
    capacity = n_profiles * (n_pixels // least + 1)
    profile, first, last, n_points = np.empty((4, capacity), np.int64)
    low, high, of_points = np.empty(capacity), np.empty(capacity), np.empty((capacity, 6))
    index, cuts = np.empty(n_pixels, np.int64), np.empty(n_pixels + 2, np.int64)
    sums, best_of = np.zeros((n_pixels + 1, 6)), np.empty((n_pixels + 2, 2), np.int64)
    stack = np.empty((2 * n_pixels + 4, 2), np.int64)
    found = 0
    for p in range(n_profiles):
        depth, slope, sigma = fan.depth_mm[p], fan.slope[p], fan.sigma_mm[p]
        m = _running_sums(depth, slope, sigma, cliff, max_gap, index, sums)
        start = 0
        while start < m:
            end = start + 1
            while end < m:
                u, v = index[end - 1], index[end]
                jump = abs(depth[v] - depth[u])
                if v - u > max_gap + 1 or jump > cliff * (v - u) + 5.0 * sigma[v]:
                    break
                end += 1
            n_cuts = 0
            if end - start >= least:
                n_cuts = _cut(sums, start, end, least, split_gain, tolerance, stack, best_of, cuts)
            for c in range(n_cuts - 1):
                a, b = cuts[c], cuts[c + 1]
                if b - a < least:
                    continue
                profile[found], n_points[found] = p, b - a
                first[found], last[found] = index[a], index[b - 1]
                for i in range(6):
                    of_points[found, i] = sums[b, i] - sums[a, i]
                s_a, s_b = slope[index[a]], slope[index[b - 1]]
                low[found], high[found] = min(s_a, s_b), max(s_a, s_b)
                found += 1
            start = end
    return Segments(
        profile[:found], first[:found], last[:found], n_points[:found], low[:found], high[:found],
        of_points[:found],
    )  # fmt: skip
