"""Profiles to straight segments: optimal splits by least squares in inverse depth."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from registration.gauss_sphere.beams import Fan
from registration.gauss_sphere.params import SegmentParams
from registration.kernels import compiled
from registration.scan import FloatArray, IntArray


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


def find_segments(fan: Fan, params: SegmentParams) -> Segments:
    """Cut every profile into the straight pieces that its noise can tell apart."""
    n_profiles, n_pixels = fan.depth_mm.shape
    capacity = n_profiles * (n_pixels // params.min_points + 1)
    table = np.empty((capacity, 4), dtype=np.int64)
    numbers = np.empty((capacity, 8))
    n = _segment_profiles(
        fan,
        params.cliff_mm,
        params.max_gap_pixels,
        params.min_points,
        params.split_gain,
        params.tolerance_sigma,
        table,
        numbers,
    )
    return Segments(
        profile=table[:n, 0].copy(),
        first=table[:n, 1].copy(),
        last=table[:n, 2].copy(),
        n_points=table[:n, 3].copy(),
        slope_low=numbers[:n, 6].copy(),
        slope_high=numbers[:n, 7].copy(),
        sums=numbers[:n, :6].copy(),
    )


@compiled
def _line_rss(sums: FloatArray, a: int, b: int) -> float:
    """Chi-square of the best line through points a..b-1, from running sums."""
    w = sums[b, 0] - sums[a, 0]
    s = sums[b, 1] - sums[a, 1]
    ss = sums[b, 2] - sums[a, 2]
    q = sums[b, 3] - sums[a, 3]
    sq = sums[b, 4] - sums[a, 4]
    qq = sums[b, 5] - sums[a, 5]
    mean_s, mean_q = s / w, q / w
    var_s = ss - s * mean_s
    cov = sq - s * mean_q
    rss = qq - q * mean_q
    if var_s > 0.0:
        rss -= cov * cov / var_s
    return float(max(rss, 0.0))


@compiled
def _best_split(sums: FloatArray, a: int, b: int, least: int) -> tuple[int, float]:
    """Where two lines fit points a..b-1 best, and their chi-square: coarse, then fine."""
    best, where = np.inf, -1
    stride = max(1, (b - a) // 24)
    k = a + least
    while k <= b - least:
        rss = _line_rss(sums, a, k) + _line_rss(sums, k, b)
        if rss < best:
            best, where = rss, k
        k += stride
    if stride > 1 and where >= 0:
        low, high = max(a + least, where - stride + 1), min(b - least, where + stride - 1)
        for k in range(low, high + 1):
            rss = _line_rss(sums, a, k) + _line_rss(sums, k, b)
            if rss < best:
                best, where = rss, k
    return where, best


@compiled
def _segment_profiles(
    fan: Fan,
    cliff: float,
    max_gap: int,
    least: int,
    split_gain: float,
    tolerance: float,
    table: IntArray,
    numbers: FloatArray,
) -> int:
    slope, depth, sigma = fan.slope, fan.depth_mm, fan.sigma_mm
    n_profiles, n_pixels = depth.shape
    index = np.empty(n_pixels, np.int64)
    sums = np.zeros((n_pixels + 1, 6))
    stack = np.empty((2 * n_pixels + 4, 2), np.int64)
    cuts = np.empty(n_pixels + 2, np.int64)
    found = 0
    for p in range(n_profiles):
        m = 0
        for u in range(n_pixels):
            d = depth[p, u]
            if np.isfinite(d):
                # An isolated point, far from both neighbours in depth, is an outlier.
                left = u > 0 and abs(depth[p, u - 1] - d) < cliff + 5.0 * sigma[p, u]
                right = u + 1 < n_pixels and abs(depth[p, u + 1] - d) < cliff + 5.0 * sigma[p, u]
                if not (left or right):
                    continue
                index[m] = u
                q = 1.0 / d
                w = d**4 / sigma[p, u] ** 2
                s = slope[p, u]
                sums[m + 1, 0] = sums[m, 0] + w
                sums[m + 1, 1] = sums[m, 1] + w * s
                sums[m + 1, 2] = sums[m, 2] + w * s * s
                sums[m + 1, 3] = sums[m, 3] + w * q
                sums[m + 1, 4] = sums[m, 4] + w * s * q
                sums[m + 1, 5] = sums[m, 5] + w * q * q
                m += 1
        start = 0
        while start < m:
            end = start + 1
            while end < m:
                u, v = index[end - 1], index[end]
                jump = abs(depth[p, v] - depth[p, u])
                if v - u > max_gap + 1 or jump > cliff * (v - u) + 5.0 * sigma[p, v]:
                    break
                end += 1
            if end - start >= least:
                # Binary splitting leaves the cuts in order, because the left half is done first.
                n_cuts, top = 1, 1
                cuts[0] = start
                stack[0, 0], stack[0, 1] = start, end
                while top > 0:
                    top -= 1
                    a, b = stack[top, 0], stack[top, 1]
                    split = False
                    if b - a >= 2 * least:
                        where, rss = _best_split(sums, a, b, least)
                        gain = _line_rss(sums, a, b) - rss
                        if where >= 0 and gain > split_gain + tolerance**2 * (b - a):
                            stack[top, 0], stack[top, 1] = where, b
                            stack[top + 1, 0], stack[top + 1, 1] = a, where
                            top += 2
                            split = True
                    if not split:
                        cuts[n_cuts] = b
                        n_cuts += 1
                # Each cut again, best between its neighbours; then cuts that win nothing go.
                for _ in range(2):
                    moved = False
                    for c in range(1, n_cuts - 1):
                        where, rss = _best_split(sums, cuts[c - 1], cuts[c + 1], least)
                        if where >= 0 and where != cuts[c]:
                            cuts[c] = where
                            moved = True
                    if not moved:
                        break
                c = 1
                while c < n_cuts - 1:
                    a, k, b = cuts[c - 1], cuts[c], cuts[c + 1]
                    gain = _line_rss(sums, a, b) - _line_rss(sums, a, k) - _line_rss(sums, k, b)
                    if gain <= split_gain + tolerance**2 * (b - a):
                        for i in range(c, n_cuts - 1):
                            cuts[i] = cuts[i + 1]
                        n_cuts -= 1
                    else:
                        c += 1
                for c in range(n_cuts - 1):
                    a, b = cuts[c], cuts[c + 1]
                    if b - a < least:
                        continue
                    table[found, 0] = p
                    table[found, 1] = index[a]
                    table[found, 2] = index[b - 1]
                    table[found, 3] = b - a
                    for i in range(6):
                        numbers[found, i] = sums[b, i] - sums[a, i]
                    s_a, s_b = slope[p, index[a]], slope[p, index[b - 1]]
                    numbers[found, 6] = min(s_a, s_b)
                    numbers[found, 7] = max(s_a, s_b)
                    found += 1
            start = end
    return found
