"""What a view says of where faces end that the other one saw to end, under a pose."""

from __future__ import annotations

import numpy as np

from registration.gauss_sphere.outlines import Ends, as_ends, ends_of, outlines_of
from registration.gauss_sphere.params import OutlineParams
from registration.gauss_sphere.verification import View
from registration.kernels import compiled
from registration.scan import FloatArray

ON, FREE, UNKNOWN = range(3)
LIKE = 0.96  # cosine between normals of one face
LEAST_SHARE = 0.3  # cosine between a direction and the ends that tell of it
ANY_WAY = np.zeros(3)


def denied_share(
    r: FloatArray, t: FloatArray, target: View, source: View, params: OutlineParams
) -> float:
    """Of what two views say of each other's faces under a pose, the share that denies it.

    Some ends of faces are asked first, which costs little; outlines only where these raise doubt,
    else 0. It is also 0 where too little is said.
    r: (3, 3), t: (3,) in mm, p_target = R p_source + t.
    """
    how = params.off_mm, params.on_mm, params.behind_mm
    looked = params.missing_pixels, params.every
    confirmed, denied = _said_of_some(r, t, target, source, *how, *looked)
    if denied <= params.refuted_share * (confirmed + denied):
        return 0.0
    ends = as_ends(outlines_of(target, params)), as_ends(outlines_of(source, params))
    confirmed, denied = said(r, t, target, source, ends, ANY_WAY, params)
    needed = params.refuting_share * (len(ends[0].point_mm) + len(ends[1].point_mm))
    share = denied / max(confirmed + denied, 1)
    return share if denied > max(needed, params.least) else 0.0


def said(
    r: FloatArray,
    t: FloatArray,
    target: View,
    source: View,
    ends: tuple[Ends, Ends],
    across: FloatArray,
    params: OutlineParams,
) -> tuple[int, int]:
    """How many ends of faces, of target and source, the views confirm and deny each other.

    across: (3,) only those count that lead out of the face along it; 0 for all.
    """
    how = params.off_mm, params.on_mm, params.behind_mm
    counts: tuple[int, int] = _said(r, t, target, source, *ends, across, *how)
    return counts


@compiled
def _said(
    r: FloatArray,
    t: FloatArray,
    target: View,
    source: View,
    of_target: Ends,
    of_source: Ends,
    across: FloatArray,
    off_mm: float,
    on_mm: float,
    behind_mm: float,
) -> tuple[int, int]:
    back_r, back_t, back_across = r.T.copy(), np.zeros(3), np.zeros(3)
    for u in range(3):
        for v in range(3):
            back_t[u] -= back_r[u, v] * t[v]
            back_across[u] += back_r[u, v] * across[v]
    # Where a face ends is known to half a cell, and so is where the other view looked.
    off = max(off_mm, 0.5 * (_cell_mm(target) + _cell_mm(source)))
    one = _told(target, of_source, r, t, across, off, on_mm, behind_mm)
    other = _told(source, of_target, back_r, back_t, back_across, off, on_mm, behind_mm)
    return one[0] + other[0], one[1] + other[1]


@compiled
def _said_of_some(
    r: FloatArray,
    t: FloatArray,
    target: View,
    source: View,
    off_mm: float,
    on_mm: float,
    behind_mm: float,
    missing_pixels: int,
    every: int,
) -> tuple[int, int]:
    of_target = ends_of(target.fan, target.patches, behind_mm, missing_pixels, every)
    of_source = ends_of(source.fan, source.patches, behind_mm, missing_pixels, every)
    return _said(r, t, target, source, of_target, of_source, np.zeros(3), off_mm, on_mm, behind_mm)


@compiled
def _cell_mm(view: View) -> float:
    """How far apart neighbouring points of a view are: profiles, or pixels where it sees planes."""
    fan = view.fan
    rows, seen = fan.x_mm.size, np.flatnonzero(np.isfinite(fan.column_slope))
    if seen.size == 0 or view.sample_area.size == 0:
        return 0.0
    step = abs(fan.x_mm[rows - 1] - fan.x_mm[0]) / max(rows - 1, 1)
    slopes = fan.column_slope[seen[-1]] - fan.column_slope[seen[0]]
    pitch = abs(slopes) / max(seen[-1] - seen[0], 1)
    return float(max(step, pitch * (view.sample_mm[:, 2].mean() - fan.apex_mm[2])))


@compiled
def _what_is_at(
    view: View, x: float, y: float, z: float, normal: FloatArray, on_mm: float, behind: float
) -> int:
    """What the view sees at a point: a face of that normal, free space, or neither."""
    fan, patches = view.fan, view.patches
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
        n = patches.normal[i]
        away = n[0] * x + n[1] * y + n[2] * z - patches.offset_mm[i]
        if abs(away) < on_mm and n[0] * normal[0] + n[1] * normal[1] + n[2] * normal[2] > LIKE:
            return ON
    return FREE if fan.depth_mm[p, u] > depth + behind else UNKNOWN


@compiled
def _told(
    view: View,
    ends: Ends,
    r: FloatArray,
    t: FloatArray,
    across: FloatArray,
    off: float,
    on_mm: float,
    behind: float,
) -> tuple[int, int]:
    """How many of the other view's ends of faces this view confirms, and denies, under a pose.

    It confirms one where it sees the face inside of it and free space outside, and denies it where
    it sees the face on both sides, or nothing where the face should be.
    across: (3,) only those count that lead out of the face along it; 0 for all.
    """
    confirmed, denied = 0, 0
    any_way = across[0] == 0.0 and across[1] == 0.0 and across[2] == 0.0
    point, out, normal = np.empty(3), np.empty(3), np.empty(3)
    for j in range(ends.point_mm.shape[0]):
        for u in range(3):
            point[u], out[u], normal[u] = t[u], 0.0, 0.0
            for v in range(3):
                point[u] += r[u, v] * ends.point_mm[j, v]
                out[u] += r[u, v] * ends.outward[j, v]
                normal[u] += r[u, v] * ends.normal[j, v]
        share = abs(out[0] * across[0] + out[1] * across[1] + out[2] * across[2])
        if not any_way and share < LEAST_SHARE:
            continue
        x, y, z = point[0] - off * out[0], point[1] - off * out[1], point[2] - off * out[2]
        inside = _what_is_at(view, x, y, z, normal, on_mm, behind)
        if inside == UNKNOWN:
            continue
        x, y, z = point[0] + off * out[0], point[1] + off * out[1], point[2] + off * out[2]
        outside = _what_is_at(view, x, y, z, normal, on_mm, behind)
        confirmed += inside == ON and outside == FREE
        denied += inside == FREE or outside == ON
    return confirmed, denied
