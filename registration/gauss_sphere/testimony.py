"""What a view says of the outlines that the other one saw, under a pose."""

from __future__ import annotations

import numpy as np

from registration.gauss_sphere.outlines import Outlines
from registration.gauss_sphere.verification import View
from registration.kernels import compiled
from registration.scan import FloatArray

ON, FREE, UNKNOWN = range(3)
LIKE = 0.96  # cosine between normals of one face
LEAST_SHARE = 0.3  # cosine between a direction and the outlines that tell of it


@compiled
def moved_outlines(outlines: Outlines, r: FloatArray, t: FloatArray) -> Outlines:
    """The outlines in the frame of the other view, under a pose."""
    n = outlines.line.size
    out = Outlines(
        np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3)), outlines.line,
        outlines.variance_mm2,
    )  # fmt: skip
    for j in range(n):
        for u in range(3):
            point, outward, along, normal = t[u], 0.0, 0.0, 0.0
            for v in range(3):
                point += r[u, v] * outlines.point_mm[j, v]
                outward += r[u, v] * outlines.outward[j, v]
                along += r[u, v] * outlines.along[j, v]
                normal += r[u, v] * outlines.normal[j, v]
            out.point_mm[j, u], out.outward[j, u] = point, outward
            out.along[j, u], out.normal[j, u] = along, normal
    return out


@compiled
def _what_is_at(
    view: View, outlines: Outlines, j: int, off: float, on_mm: float, behind: float
) -> int:
    """What the view sees at off mm outward of point j: the same face, free space, or neither."""
    fan, patches = view.fan, view.patches
    x = outlines.point_mm[j, 0] + off * outlines.outward[j, 0]
    y = outlines.point_mm[j, 1] + off * outlines.outward[j, 1]
    z = outlines.point_mm[j, 2] + off * outlines.outward[j, 2]
    rows = fan.x_mm.size
    step = (fan.x_mm[rows - 1] - fan.x_mm[0]) / max(rows - 1, 1)
    depth = z - fan.lean[1] * x - fan.apex_mm[2]
    row = np.floor((x - fan.x_mm[0]) / step + 0.5)
    cell = ((y - fan.lean[0] * x - fan.apex_mm[1]) / depth - view.slope_low) * view.cells_per_slope
    if not (0.0 <= row < rows and 0.0 <= cell < view.pixel_of.size and depth > 1.0):
        return UNKNOWN
    p, u = np.int64(row), view.pixel_of[np.int64(cell)]
    if u < 0:
        return UNKNOWN
    i = patches.label[p, u]
    if i >= 0:
        n, m = patches.normal[i], outlines.normal[j]
        away = n[0] * x + n[1] * y + n[2] * z - patches.offset_mm[i]
        if abs(away) < on_mm and n[0] * m[0] + n[1] * m[1] + n[2] * m[2] > LIKE:
            return ON
    return FREE if fan.depth_mm[p, u] > depth + behind else UNKNOWN


@compiled
def told(
    view: View,
    outlines: Outlines,
    across: FloatArray,
    off: float,
    on_mm: float,
    behind: float,
) -> tuple[int, int]:
    """How many points of the other view's moved outlines this view confirms, and denies.

    It confirms one where it sees the face inside of it and free space outside, and denies it where
    it sees the face on both sides, or nothing where the face should be.
    across: (3,) only points whose outward direction has a share along it count; 0 for all.
    """
    confirmed, denied = 0, 0
    any_way = across[0] == 0.0 and across[1] == 0.0 and across[2] == 0.0
    for j in range(outlines.line.size):
        o = outlines.outward[j]
        if (
            not any_way
            and abs(o[0] * across[0] + o[1] * across[1] + o[2] * across[2]) < LEAST_SHARE
        ):
            continue
        inside = _what_is_at(view, outlines, j, -off, on_mm, behind)
        if inside == UNKNOWN:
            continue
        outside = _what_is_at(view, outlines, j, off, on_mm, behind)
        confirmed += inside == ON and outside == FREE
        denied += inside == FREE or outside == ON
    return confirmed, denied
