"""What a view says of where faces end that the other one saw to end, under a pose."""

from __future__ import annotations

import numpy as np

from registration.gauss_sphere.outlines.ends import Ends, Outlines, as_ends, ends_of
from registration.gauss_sphere.outlines.what_is_seen import FREE, ON, what_is_at
from registration.gauss_sphere.params import OutlineParams
from registration.gauss_sphere.view import Seen, View
from registration.kernels import compiled
from registration.scan import FloatArray, IntArray

LEAST_SHARE = 0.3  # cosine between a direction and the ends that tell of it


def is_doubtful(
    r: FloatArray, t: FloatArray, target: View, source: View, params: OutlineParams
) -> bool:
    """Whether some ends of faces, which cost little to ask, speak against a pose.

    Where they do not, denied_share need not be asked.
    r: (3, 3), t: (3,) in mm, p_target = R p_source + t.
    """
    how = params.off_mm, params.on_mm, params.behind_mm
    looked = params.missing_pixels, params.every
    confirmed, denied = _said_of_some(r, t, target, source, *how, *looked)
    return bool(denied > params.refuted_share * (confirmed + denied))


def denied_share(
    r: FloatArray,
    t: FloatArray,
    target: View,
    source: View,
    outlines: tuple[Outlines, Outlines],
    params: OutlineParams,
) -> float:
    """Of what two views say of each other's outlines under a pose, the share that denies it.

    It is 0 where too little is said.
    r: (3, 3), t: (3,) in mm, p_target = R p_source + t.  outlines: of target and source.
    """
    ends = as_ends(outlines[0]), as_ends(outlines[1])
    confirmed, denied = said(r, t, target, source, ends, params)
    needed = params.refuting_share * (len(ends[0].point_mm) + len(ends[1].point_mm))
    share = denied / max(confirmed + denied, 1)
    return share if denied > max(needed, params.least) else 0.0


def said(
    r: FloatArray,
    t: FloatArray,
    target: View,
    source: View,
    ends: tuple[Ends, Ends],
    params: OutlineParams,
) -> tuple[int, int]:
    """How many ends of faces, of target and source, the views confirm and deny each other."""
    how = params.off_mm, params.on_mm, params.behind_mm
    counts: tuple[int, int] = _said(r, t, target, source, *ends, *how)
    return counts


def said_along(
    r: FloatArray,
    t: FloatArray,
    along: FloatArray,
    shifts_mm: FloatArray,
    target: View,
    source: View,
    ends: tuple[Ends, Ends],
    params: OutlineParams,
) -> IntArray:
    """The same of a pose shifted along a direction (3,), by each of some shifts (n,): (n, 2).

    Only those ends count that lead out of the face along it.
    """
    how = params.off_mm, params.on_mm, params.behind_mm
    words: IntArray = _said_along(r, t, along, shifts_mm, target, source, *ends, *how)
    return words


@compiled
def _said_along(
    r: FloatArray,
    t: FloatArray,
    along: FloatArray,
    shifts_mm: FloatArray,
    target: View,
    source: View,
    of_target: Ends,
    of_source: Ends,
    off_mm: float,
    on_mm: float,
    behind_mm: float,
) -> IntArray:
    off, there = off_both_sides(target, source, off_mm), np.empty(3)
    one, other = _across(of_target, along), _across(of_source, r.T.copy() @ along)
    words = np.empty((shifts_mm.size, 2), np.int64)
    for k in range(shifts_mm.size):
        for u in range(3):
            there[u] = t[u] + shifts_mm[k] * along[u]
        words[k, 0], words[k, 1] = said_of_ends(
            r, there, target.seen, source.seen, one, other, off, on_mm, behind_mm
        )
    return words


@compiled
def _across(ends: Ends, along: FloatArray) -> Ends:
    """Those that lead out of the face along a direction."""
    share = np.empty(ends.point_mm.shape[0])
    for j in range(share.size):
        share[j] = 0.0
        for u in range(3):
            share[j] += ends.outward[j, u] * along[u]
    kept = np.flatnonzero(np.abs(share) >= LEAST_SHARE)
    return Ends(ends.point_mm[kept], ends.outward[kept], ends.normal[kept])


@compiled
def _said(
    r: FloatArray,
    t: FloatArray,
    target: View,
    source: View,
    of_target: Ends,
    of_source: Ends,
    off_mm: float,
    on_mm: float,
    behind_mm: float,
) -> tuple[int, int]:
    off = off_both_sides(target, source, off_mm)
    return said_of_ends(r, t, target.seen, source.seen, of_target, of_source, off, on_mm, behind_mm)


@compiled
def said_of_ends(
    r: FloatArray,
    t: FloatArray,
    target: Seen,
    source: Seen,
    of_target: Ends,
    of_source: Ends,
    off_mm: float,
    on_mm: float,
    behind_mm: float,
) -> tuple[int, int]:
    """As `said`, for compiled loops: with off_mm of off_both_sides."""
    back_r, back_t = r.T.copy(), np.zeros(3)
    for u in range(3):
        for v in range(3):
            back_t[u] -= back_r[u, v] * t[v]
    one = _told(target, of_source, r, t, off_mm, on_mm, behind_mm)
    other = _told(source, of_target, back_r, back_t, off_mm, on_mm, behind_mm)
    return one[0] + other[0], one[1] + other[1]


@compiled
def off_both_sides(target: View, source: View, off_mm: float) -> float:
    """How far to both sides of an outline the other view is asked: see OutlineParams.off_mm.

    Where a face ends is known to half a cell, and so is where the other view looked.
    """
    return max(off_mm, 0.5 * (_cell_mm(target) + _cell_mm(source)))


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
    return _said(r, t, target, source, of_target, of_source, off_mm, on_mm, behind_mm)


@compiled
def _cell_mm(view: View) -> float:
    """How far apart neighbouring points of a view are: profiles, or pixels where it sees planes."""
    slope, pixel = view.fan.column_slope, np.flatnonzero(np.isfinite(view.fan.column_slope))
    if pixel.size == 0 or view.seen.sample_area.size == 0:
        return 0.0
    pitch = abs(slope[pixel[-1]] - slope[pixel[0]]) / max(pixel[-1] - pixel[0], 1)
    x, z = view.seen.sample_mm[0], view.seen.sample_mm[2]
    depth = z.mean() - view.seen.lean_z * x.mean() - view.seen.apex_z_mm
    return float(max(view.fan.gap_mm, pitch * depth))


@compiled
def _told(
    seen: Seen,
    ends: Ends,
    r: FloatArray,
    t: FloatArray,
    off: float,
    on_mm: float,
    behind: float,
) -> tuple[int, int]:
    """How many of the other view's ends of faces this view confirms, and denies, under a pose.

    It confirms one where it sees the face inside of it and free space outside, and denies it where
    it sees the face on both sides, or nothing where the face should be.
    """
    n = ends.point_mm.shape[0]
    inside, outside = np.empty((2, 6, n))
    normal = np.zeros((n, 3))
    for j in range(n):
        for u in range(3):
            point, out = t[u], 0.0
            for v in range(3):
                point += r[u, v] * ends.point_mm[j, v]
                out += r[u, v] * ends.outward[j, v]
                normal[j, u] += r[u, v] * ends.normal[j, v]
            inside[u, j], outside[u, j] = point - off * out, point + off * out
    on_face = what_is_at(seen, inside, normal, n, on_mm, behind)
    beyond = what_is_at(seen, outside, normal, n, on_mm, behind)
    confirmed, denied = 0, 0
    for j in range(n):
        confirmed += on_face[j] == ON and beyond[j] == FREE
        denied += on_face[j] == FREE or (on_face[j] == ON and beyond[j] == ON)
    return confirmed, denied
