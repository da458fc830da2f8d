"""Colours and views that figures, stills and the page share, for whom matplotlib is too much."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from registration.scan import FloatArray

TARGET, SOURCE = "#0072B2", "#E69F00"  # blue and orange of Okabe and Ito, safe for the colour-blind
MARK, GREY, PALE, INK = "#D55E00", "#8C8C8C", "#D9D9D9", "#222222"
# Paul Tol's "muted" colours, safe for the colour-blind; heaviest normals first.
NORMAL_COLOURS = (
    "#332288", "#CC6677", "#117733", "#DDCC77", "#88CCEE", "#882255", "#44AA99", "#AA4499",
    "#999933",
)  # fmt: skip


class Projection(NamedTuple):
    """A view of a drawing: the coordinates that run to the right and up the page."""

    name: str
    right: int
    up: int


# As the sensor sees it; and from above, the sensor at the foot of the page. Y to the right in both.
FRONT = Projection("Front view", 1, 0)
TOP = Projection("Top view", 1, 2)


def limits(points_mm: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Corners of a box around all points with a margin; never flat, 100 mm when there are none."""
    points = np.concatenate([np.zeros((0, 3)), *(p.reshape(-1, 3) for p in points_mm)])
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) == 0:
        return np.full(3, -50.0), np.full(3, 50.0)
    low, high = points.min(axis=0), points.max(axis=0)
    least = 0.2 * max(float((high - low).max()), 50.0)
    margin = 0.03 * (high - low) + 0.5 * np.maximum(least - (high - low), 0.0)
    return low - margin, high + margin
