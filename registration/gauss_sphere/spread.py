"""How samples are spread over a scan: even steps could follow what is even in it."""

from __future__ import annotations

import numpy as np

from registration.scan import IntArray

GOLDEN_RATIO = 0.6180339887498949  # multiples of it, less what is whole, fall everywhere


def spread_over(n: int, few: int) -> IntArray:
    """Rising indices of few of n things, at most, all over them."""
    if n <= few:
        return np.arange(n)
    return np.unique((np.arange(few) * GOLDEN_RATIO % 1.0 * n).astype(np.int64))
