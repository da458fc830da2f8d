"""Points that lie off all that is beside them, as sunlight, glare and interference make them."""

from __future__ import annotations

import numpy as np

from registration.kernels import compiled
from registration.scan import BoolArray, FloatArray

# A spike is so far from points beside it, or so many times as far as the closest fifth of points is
# off the middle of those beside them: noise of any size makes none.
SPIKE_MM, SPIKE_BENDS, CLOSEST = 10.0, 25.0, 0.2
# Fewer than such a share of points are left: thin things and ends of faces reach 0.4 %.
MANY = 0.01
ROWS = 8  # of profiles that tell how many there are
APART = 3  # pixels to the points between which one is looked at: a spike may be so wide
BESIDE = 4  # pixels to both sides, of which a third must be near


@compiled
def leave_out_spikes(depth: FloatArray, usable: BoolArray) -> None:
    """Where a scan (profiles, pixels) has many spikes, they are not usable.

    A few do no harm; many cut profiles into pieces too short for a line.
    """
    if _share_of_spikes(depth, usable, SPIKE_MM) > MANY:
        reach_mm = max(SPIKE_MM, SPIKE_BENDS * _least_bend(depth, usable))
        if _share_of_spikes(depth, usable, reach_mm) > MANY:
            _leave_out(depth, usable, reach_mm)


@compiled
def _share_of_spikes(depth: FloatArray, usable: BoolArray, reach_mm: float) -> float:
    """How many points of some profiles lie between two that are near to each other, not to it."""
    n, all_of_them = 0, 1
    for p in range(0, depth.shape[0], max(depth.shape[0] // ROWS, 1)):
        for u in range(APART, depth.shape[1] - APART):
            if usable[p, u - APART] & usable[p, u] & usable[p, u + APART]:
                a, b, c = depth[p, u - APART], depth[p, u], depth[p, u + APART]
                if abs(c - a) <= reach_mm and min(abs(b - a), abs(b - c)) > reach_mm:
                    n += not _goes_on(depth, usable, p, u, reach_mm)
                all_of_them += 1
    return n / all_of_them


@compiled
def _least_bend(depth: FloatArray, usable: BoolArray) -> float:
    """How far the closest points of some profiles are off the middle of those beside them."""
    bend, n = np.empty(depth.size), 0
    for p in range(0, depth.shape[0], max(depth.shape[0] // ROWS, 1)):
        for u in range(1, depth.shape[1] - 1):
            if usable[p, u - 1] & usable[p, u] & usable[p, u + 1]:
                bend[n] = abs(depth[p, u] - 0.5 * (depth[p, u - 1] + depth[p, u + 1]))
                n += 1
    return float(np.sort(bend[:n])[int(CLOSEST * n)]) if n else 0.0


@compiled
def _goes_on(depth: FloatArray, usable: BoolArray, p: int, u: int, reach_mm: float) -> bool:
    """Whether the profile before or after has a point near to one: thin things go on there."""
    for q in (p - 1, p + 1):
        within = 0 <= q < depth.shape[0]
        if within and usable[q, u] and abs(depth[q, u] - depth[p, u]) <= reach_mm:
            return True
    return False


@compiled
def _leave_out(depth: FloatArray, usable: BoolArray, reach_mm: float) -> None:
    """Points far from most of those beside them are not usable."""
    before = usable.copy()
    for p in range(depth.shape[0]):
        for u in range(depth.shape[1]):
            if not before[p, u]:
                continue
            beside, near = 0, 0
            for v in range(max(u - BESIDE, 0), min(u + BESIDE + 1, depth.shape[1])):
                if before[p, v] and v != u:
                    far_mm = abs(depth[p, v] - depth[p, u])
                    beside += 1
                    near += far_mm <= reach_mm * max(0.5 * abs(v - u), 1.0)
            if 3 * near < beside:
                usable[p, u] = _goes_on(depth, before, p, u, reach_mm)
