"""Points that lie off all that is beside them, as sunlight, glare and interference make them."""

from __future__ import annotations

import numpy as np

from registration.kernels import compiled
from registration.scan import BoolArray, FloatArray

# A spike is so far from points beside it, or so many times as far as the closest fifth of points is
# off the middle of those beside them, or would be at its depth: no noise makes one.
SPIKE_MM, SPIKE_BENDS, CLOSEST = 10.0, 25.0, 0.2
# Fewer than such a share of points are left: thin things and ends of faces reach 0.4 %.
MANY = 0.01
ROWS = 8  # of profiles that tell how many there are
APART = 3  # pixels to the points between which one is looked at: a spike may be so wide
BESIDE = 4  # pixels to both sides: a third must be near, or two pairs be in line with the point


@compiled
def leave_out_spikes(depth: FloatArray, usable: BoolArray) -> None:
    """Where a scan (profiles, pixels) has many spikes, they are not usable.

    A few do no harm; many cut profiles into pieces too short for a line.
    """
    if _share_of_spikes(depth, usable, SPIKE_MM, 0.0) > MANY:
        reach = _reach(depth, usable)
        if _share_of_spikes(depth, usable, *reach) > MANY:
            _leave_out(depth, usable, *reach)


@compiled
def _share_of_spikes(depth: FloatArray, usable: BoolArray, reach_mm: float, growth: float) -> float:
    """How many points of some profiles lie between two that are near to each other, not to it.

    Near is within reach_mm, or growth (1/mm) times the squared depth where that is more.
    """
    n, all_of_them = 0, 1
    for p in range(0, depth.shape[0], max(depth.shape[0] // ROWS, 1)):
        for u in range(APART, depth.shape[1] - APART):
            if usable[p, u - APART] & usable[p, u] & usable[p, u + APART]:
                a, b, c = depth[p, u - APART], depth[p, u], depth[p, u + APART]
                near = max(reach_mm, growth * min(a * a, c * c))
                if abs(c - a) <= near and min(abs(b - a), abs(b - c)) > near:
                    n += not _goes_on(depth, usable, p, u, reach_mm, growth)
                all_of_them += 1
    return n / all_of_them


@compiled
def _reach(depth: FloatArray, usable: BoolArray) -> tuple[float, float]:
    """How far from others a point of the scene may lie: in mm, and by the squared depth in 1/mm.

    By the points closest to the middle of those beside them, of those that are not exactly there:
    depths may be rounded. Noise may be the same everywhere, or grow with the square of the depth.
    """
    bend, growing, n = np.empty(depth.size), np.empty(depth.size), 0
    for p in range(0, depth.shape[0], max(depth.shape[0] // ROWS, 1)):
        for u in range(1, depth.shape[1] - 1):
            if usable[p, u - 1] & usable[p, u] & usable[p, u + 1]:
                off = abs(depth[p, u] - 0.5 * (depth[p, u - 1] + depth[p, u + 1]))
                if off > 0.0:
                    bend[n], growing[n] = off, off / depth[p, u] ** 2
                    n += 1
    if n == 0:
        return SPIKE_MM, 0.0
    closest = int(CLOSEST * n)
    reach_mm = SPIKE_BENDS * float(np.sort(bend[:n])[closest])
    return max(SPIKE_MM, reach_mm), SPIKE_BENDS * float(np.sort(growing[:n])[closest])


@compiled
def _leave_out(depth: FloatArray, usable: BoolArray, reach_mm: float, growth: float) -> None:
    """Points that neither lie near to others of their profile, nor go on, are not usable."""
    before = usable.copy()
    for p in range(depth.shape[0]):
        for u in range(depth.shape[1]):
            if before[p, u] and not _is_beside(depth[p], before[p], u, reach_mm, growth):
                usable[p, u] = _goes_on(depth, before, p, u, reach_mm, growth)


@compiled
def _goes_on(
    depth: FloatArray, usable: BoolArray, p: int, u: int, reach_mm: float, growth: float
) -> bool:
    """Whether the profile before or after has a point near to one: thin things go on there."""
    for q in (p - 1, p + 1):
        if 0 <= q < depth.shape[0] and usable[q, u]:
            a, b = depth[q, u], depth[p, u]
            if abs(a - b) <= max(reach_mm, growth * min(a * a, b * b)):
                return True
    return False


@compiled
def _is_beside(
    depth: FloatArray, usable: BoolArray, u: int, reach_mm: float, growth: float
) -> bool:
    """Whether a point lies near to a third of those beside it, or in line with pairs of them."""
    beside, close, in_line, here = 0, 0, 0, depth[u]
    for k in range(1, BESIDE + 1):
        pair, least = 0.0, here * here
        for v in (u - k, u + k):
            if 0 <= v < depth.size and usable[v]:
                there2 = min(depth[v] * depth[v], here * here)
                near = max(reach_mm, growth * there2) * max(0.5 * k, 1.0)
                close += abs(depth[v] - here) <= near
                beside += 1
                pair, least = pair + 0.5 * depth[v], min(least, there2)
            else:
                pair = np.nan
        in_line += abs(pair - here) <= max(reach_mm, growth * least)
    return bool(3 * close >= beside or in_line >= 2)
