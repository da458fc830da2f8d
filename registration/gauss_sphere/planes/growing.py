"""Segments to patches: planes grown over the profiles by adding the sums of their segments."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from registration.gauss_sphere.fan.beams import ONE_PLACE, Fan
from registration.gauss_sphere.params import PatchParams
from registration.gauss_sphere.planes.points import Grouped, grouped
from registration.gauss_sphere.planes.segments import Segments
from registration.kernels import compiled
from registration.scan import FloatArray, IntArray


class Growing(NamedTuple):
    """What PatchParams say of growing, as the compiled loops take it."""

    join_gain: float
    tolerance_sigma: float
    max_tilt: float
    bridge_profiles: int
    min_points: int
    min_profiles: int
    edge_pixels: int


def growing(params: PatchParams) -> Growing:
    """The parameters that say how patches grow."""
    return Growing(
        params.join_gain,
        params.tolerance_sigma,
        params.max_tilt,
        params.bridge_profiles,
        params.min_points,
        params.min_profiles,
        params.edge_pixels,
    )


@compiled
def grown(fan: Fan, segments: Segments, how: Growing) -> Grouped:
    """The points of the patches that segments grow into over the profiles."""
    reach_mm = (how.bridge_profiles + 0.5) * fan.gap_mm
    owner = _grow(
        segments, fan.x_mm, how.join_gain, how.tolerance_sigma, how.max_tilt, how.bridge_profiles,
        reach_mm,
    )  # fmt: skip
    least_mm = ONE_PLACE * fan.gap_mm
    n_patches = _keep_large(segments, owner, fan.x_mm, least_mm, how.min_points, how.min_profiles)
    return grouped(segments, owner, n_patches, fan.depth_mm, how.edge_pixels)


@compiled
def _plane_rss(m: FloatArray, max_c: float) -> tuple[float, float]:
    """Chi-square of the best plane q = A + B s + C x q, in the noise at x = 0, and its C.

    A residual is 1 - C x times that of q, as is the depth at x that at 0: with x = 0 far away, the
    points of a plane tilted along X would seem to be off by more than they are, or by less.

    m: 1, s, ss, xq, s x q, x x q q, q, s q, x q q, q q.  max_c bounds C softly: the tilt along X.
    """
    # Eliminate A and B of the 3 x 3 normal equations by hand.
    w = m[0]
    b11 = m[2] - m[1] * m[1] / w
    b12 = m[4] - m[1] * m[3] / w
    b22 = m[5] - m[3] * m[3] / w + 1.0 / (max_c * max_c)
    r1 = m[7] - m[1] * m[6] / w
    r2 = m[8] - m[3] * m[6] / w
    rss = m[9] - m[6] * m[6] / w
    if b11 > 0.0:
        rss -= r1 * r1 / b11
        c22 = b22 - b12 * b12 / b11
        r2 -= b12 * r1 / b11
    else:
        c22 = b22
    rss -= r2 * r2 / c22
    return float(max(rss, 0.0)), r2 / c22


@compiled
def _shifted(m: FloatArray, dx: float, out: FloatArray) -> None:
    """The sums m with every x larger by dx."""
    for i in range(10):
        out[i] = m[i]
    out[3] = m[3] + dx * m[6]
    out[4] = m[4] + dx * m[7]
    out[5] = m[5] + 2.0 * dx * m[8] + dx * dx * m[9]
    out[8] = m[8] + dx * m[9]


@compiled
def _alone(m: FloatArray, max_tilt: float, c: float, out: FloatArray) -> float:
    """Chi-square of a part by itself, in the noise that a plane of C = c has at x = 0.

    About its own middle: far from x = 0, C would take away the residuals of a part of one profile,
    as nothing else holds it there.  out: (10,) to work in.
    """
    middle = m[3] / m[6]
    _shifted(m, -middle, out)
    rss, _ = _plane_rss(out, max_tilt * out[6] / out[0])
    return float(rss * (1.0 - c * middle) ** 2)


@compiled
def _root(parent: IntArray, i: int) -> int:
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@compiled
def _grow(
    segments: Segments,
    x: FloatArray,
    gain: float,
    tolerance: float,
    max_tilt: float,
    bridge: int,
    reach_mm: float,
) -> IntArray:
    """(n,) the segment that stands for the patch of each."""
    profile, low, high = segments.profile, segments.slope_low, segments.slope_high
    sums, count = segments.sums, segments.n_points
    n = profile.size
    first_of = np.searchsorted(profile, np.arange(x.size + 1))
    parent = np.arange(n)
    total = np.zeros((n, 10))  # sums of the patch that the root stands for
    about = x[profile]  # the x that these sums are taken about
    points = count.astype(np.float64)
    one, other, both, own = np.zeros(10), np.zeros(10), np.zeros(10), np.zeros(10)
    for i in range(n):
        for j, k in ((0, 0), (1, 1), (2, 2), (6, 3), (7, 4), (9, 5)):
            total[i, j] = sums[i, k]
    for i in range(n):
        p = profile[i]
        joined = False
        for back in range(1, bridge + 1):
            if p - back < 0 or (joined and back > 1):
                break
            if abs(x[p] - x[p - back]) > reach_mm:
                continue
            for j in range(first_of[p - back], first_of[p - back + 1]):
                shared = min(high[i], high[j]) - max(low[i], low[j])
                if shared <= 0.25 * min(high[i] - low[i], high[j] - low[j]):
                    continue
                ri, rj = _root(parent, i), _root(parent, j)
                if ri == rj:
                    joined = True
                    continue
                # About where they meet, for the noise there.
                _shifted(total[ri], about[ri] - x[p], one)
                _shifted(total[rj], about[rj] - x[p], other)
                for t in range(10):
                    both[t] = one[t] + other[t]
                max_c = max_tilt * both[6] / both[0]
                together, c = _plane_rss(both, max_c)
                loss = together - _alone(one, max_tilt, c, own) - _alone(other, max_tilt, c, own)
                fewer = min(points[ri], points[rj])
                if loss < gain + tolerance * tolerance * fewer:
                    parent[ri] = rj
                    points[rj] += points[ri]
                    total[rj], about[rj] = both, x[p]
                    joined = True
    for i in range(n):
        parent[i] = _root(parent, i)
    return parent


@compiled
def _keep_large(
    segments: Segments,
    owner: IntArray,
    x: FloatArray,
    least_mm: float,
    min_points: int,
    min_profiles: int,
) -> int:
    """Number the patches that are large enough, all others -1.

    least_mm: profiles nearer to each other count as one: a plane needs several places.
    """
    n = owner.size
    points, profiles = np.zeros(n, np.int64), np.zeros(n, np.int64)
    latest, number = np.full(n, -1), np.full(n, -1)
    for i in range(n):
        points[owner[i]] += segments.n_points[i]
        # Segments come profile by profile.
        p, last = segments.profile[i], latest[owner[i]]
        if last < 0 or abs(x[p] - x[last]) > least_mm:
            latest[owner[i]] = p
            profiles[owner[i]] += 1
    kept = 0
    for i in range(n):
        if points[i] >= min_points and profiles[i] >= min_profiles:
            number[i] = kept
            kept += 1
    for i in range(n):
        owner[i] = number[owner[i]]
    return kept
