"""When two poses count as one."""

from __future__ import annotations

import numpy as np

from registration.kernels import compiled
from registration.scan import FloatArray


@compiled
def are_same(
    ra: FloatArray,
    ta: FloatArray,
    rb: FloatArray,
    tb: FloatArray,
    middle_mm: FloatArray,
    distinct_rad: float,
    distinct_mm: float,
) -> bool:
    """Whether two poses are one: nearly alike in turn, and in where they take middle_mm (3,)."""
    chord2, moved2 = 0.0, 0.0
    for u in range(3):
        moved = ta[u] - tb[u]
        for v in range(3):
            difference = ra[u, v] - rb[u, v]
            chord2 += difference * difference
            moved += difference * middle_mm[v]
        moved2 += moved * moved
    # |Ra - Rb|^2 = 8 sin^2(angle / 2) for rotations.
    angle = 2.0 * np.arcsin(min(np.sqrt(chord2 / 8.0), 1.0))
    return bool(angle < distinct_rad and moved2 < distinct_mm**2)
