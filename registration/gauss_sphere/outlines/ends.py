"""Where planes end in free space: the outlines of their faces, as a view sees them.

A face that ends before something farther away ends there for every view. A plane does not tell
where along itself it is seen; its outline does. What something nearer hides is not known.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from registration.gauss_sphere.fan.beams import ONE_PLACE, Fan
from registration.gauss_sphere.params import OutlineParams
from registration.gauss_sphere.planes.patches import Patches, planes_in_beams
from registration.gauss_sphere.view import View
from registration.kernels import compiled
from registration.scan import FloatArray, IndexArray, IntArray

SIDES = 4  # higher and lower pixels, later and earlier profiles
GRAZING = 0.05  # a beam that meets a plane at less (cosine, times its slant) says too little
MOST_MIXED = 2  # points between the face and what is behind it
MOST_MISSING_PROFILES = 2
WIDEST_END_GAP = 1.5  # of the usual between profiles: in a wider one a face may end anywhere
LEAST_NEIGHBOURS, NEAR_PROFILES = 5, 6
LEAST_OUTWARD = 0.3  # cosine between the step out of the face and across the outline
STRAIGHT_MM, STRAIGHT_CELLS = 1.0, 0.7  # how far off a line points scatter: mm and half cells


class Ends(NamedTuple):
    """Where faces end, one by one.

    point_mm: (n, 3) on a plane; outward, normal: (n, 3) unit, in the plane out of the face (along a
    profile or across profiles, or, of an outline, across its line), and across the plane.
    """

    point_mm: FloatArray
    outward: FloatArray
    normal: FloatArray


class Outlines(NamedTuple):
    """Points of outlines, each on the line that its neighbours make.

    point_mm: (n, 3) on a plane; outward, normal: (n, 3) unit, in the plane away from the face,
    across its line, and across the plane.
    line: (n,) patch and side, as one number; variance_mm2: (n,) of the point, outward.
    """

    point_mm: FloatArray
    outward: FloatArray
    normal: FloatArray
    line: IntArray
    variance_mm2: FloatArray


def as_ends(outlines: Outlines) -> Ends:
    """The points of outlines, without the lines that they make."""
    return Ends(outlines.point_mm, outlines.outward, outlines.normal)


def found_outlines(view: View, params: OutlineParams) -> Outlines:
    """All outlines that a view sees of its planes."""
    ends = _found_ends(view.fan, view.patches, params.behind_mm, params.missing_pixels, 1)
    return _lines(view.patches, *ends, params.near_mm)


@compiled
def chosen(outlines: Outlines, kept: IntArray) -> Outlines:
    """Those of some numbers."""
    return Outlines(
        outlines.point_mm[kept], outlines.outward[kept], outlines.normal[kept],
        outlines.line[kept], outlines.variance_mm2[kept],
    )  # fmt: skip


@compiled
def moved_outlines(outlines: Outlines, r: FloatArray, t: FloatArray) -> Outlines:
    """The outlines in the frame of the other view, under a pose."""
    n = outlines.line.size
    out = Outlines(
        np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3)), outlines.line, outlines.variance_mm2
    )  # fmt: skip
    for j in range(n):
        for u in range(3):
            point, outward, normal = t[u], 0.0, 0.0
            for v in range(3):
                point += r[u, v] * outlines.point_mm[j, v]
                outward += r[u, v] * outlines.outward[j, v]
                normal += r[u, v] * outlines.normal[j, v]
            out.point_mm[j, u], out.outward[j, u], out.normal[j, u] = point, outward, normal
    return out


@compiled
def _depth_on(plane: FloatArray, x: float, slope: float) -> float:
    """Depth at which a beam meets a plane; NaN where it grazes it or comes from behind."""
    along = plane[1] * slope + plane[2]
    return float((plane[3] - plane[0] * x) / along) if along <= -GRAZING else np.nan


@compiled
def _ends(
    depth: FloatArray,
    slope: FloatArray,
    sigma: FloatArray,
    x_mm: FloatArray,
    label: IndexArray,
    plane: FloatArray,
    p: int,
    u: int,
    dp: int,
    du: int,
    behind: float,
    most_missing: int,
    widest_mm: float,
) -> tuple[int, int, float]:
    """The last point of a face from point (p, u) on, and how many cells on it ends (-1: unknown).

    The next points may lie on the plane without its label, or between it and what is behind.
    widest_mm: a wider gap between two profiles does not tell where in it a face ends.
    """
    i = label[p, u]
    rows, columns = label.shape
    missing, mixed = 0, 0
    last_p, last_u, a, b = p, u, p + dp, u + du
    while 0 <= a < rows and 0 <= b < columns:
        if label[a, b] == i or abs(x_mm[a] - x_mm[a - dp]) > widest_mm:
            break
        if not np.isfinite(depth[a, b]):
            missing += 1
            if missing > most_missing:
                break
        else:
            off = depth[a, b] - _depth_on(plane, x_mm[a], slope[a, b])
            close = 3.0 * sigma[a, b] + 0.5
            if off > behind:
                return last_p, last_u, 0.5 * (1.0 + (mixed if missing == 0 else 0))
            if missing == 0 and mixed == 0 and label[a, b] < 0 and abs(off) < close:
                if abs(a - p) + abs(b - u) > MOST_MIXED:
                    break
                last_p, last_u = a, b
            elif off > -close and mixed < MOST_MIXED:
                mixed += 1
            else:
                break
        a += dp
        b += du
    return last_p, last_u, -1.0


@compiled
def _found_ends(
    fan: Fan, patches: Patches, behind: float, missing_pixels: int, every: int
) -> tuple[FloatArray, FloatArray, IntArray, IntArray]:
    """Points (n, 3) where faces end, half a cell beyond (n, 3), patch and side (n,), profile (n,).

    every: of how many profiles one is looked along, and of how many pixels one across profiles.
    """
    label, rows, columns = patches.label, patches.label.shape[0], patches.label.shape[1]
    # One by one: handing over the fan costs a count of references to each of its arrays.
    depth, slopes, sigma, x_mm = fan.depth_mm, fan.slope, fan.sigma_mm, fan.x_mm
    least_mm, widest_mm = ONE_PLACE * fan.gap_mm, WIDEST_END_GAP * fan.gap_mm
    planes, known = planes_in_beams(fan, patches), np.flatnonzero(np.isfinite(fan.column_slope))
    first, last = known[0], known[-1]
    pitch = (fan.column_slope[last] - fan.column_slope[first]) / max(last - first, 1)
    n, room = 0, 1024
    point, beyond = np.empty((room, 3)), np.empty((room, 3))
    line, row = np.empty(room, np.int64), np.empty(room, np.int64)
    for side in range(SIDES):
        dp, du = (0, 1 - 2 * side) if side < 2 else (5 - 2 * side, 0)
        most_missing = missing_pixels if side < 2 else MOST_MISSING_PROFILES
        for p in range(max(-dp, 0), rows - max(dp, 0), every if side < 2 else 1):
            for u in range(max(-du, 0), columns - max(du, 0), 1 if side < 2 else every):
                i = label[p, u]
                if i < 0 or label[p + dp, u + du] == i:
                    continue
                plane = planes[i]
                a, b, cells = _ends(
                    depth, slopes, sigma, x_mm, label, plane, p, u, dp, du, behind, most_missing,
                    widest_mm,
                )  # fmt: skip
                if cells < 0.0:
                    continue
                if n == room:
                    point, beyond = _roomier(point), _roomier(beyond)
                    line, row, room = np.append(line, line), np.append(row, row), 2 * room
                _foot(fan, plane, fan.x_mm[a], fan.slope[a, b], point[n])
                x, slope = x_mm[a], fan.slope[a, b] + du * pitch * cells
                if dp != 0:
                    x = 0.5 * (x + x_mm[a + dp * int(2.0 * cells)])
                    if abs(x - x_mm[a]) <= least_mm:
                        continue
                _foot(fan, plane, x, slope, beyond[n])
                if not np.isfinite(point[n, 2] + beyond[n, 2]):
                    continue
                for v in range(3):
                    beyond[n, v] -= point[n, v]
                    point[n, v] += beyond[n, v]
                line[n], row[n] = SIDES * i + side, p
                n += 1
    return point[:n], beyond[:n], line[:n], row[:n]


@compiled
def ends_of(fan: Fan, patches: Patches, behind_mm: float, missing_pixels: int, every: int) -> Ends:
    """Some of the ends of faces that a view sees, from all over it: see OutlineParams."""
    point, beyond, line, _ = _found_ends(fan, patches, behind_mm, missing_pixels, every)
    normal = np.empty((line.size, 3))
    for j in range(line.size):
        b = beyond[j]
        b /= np.sqrt(b[0] * b[0] + b[1] * b[1] + b[2] * b[2])
        normal[j] = patches.normal[line[j] // SIDES]
    return Ends(point, beyond, normal)


@compiled
def _roomier(of: FloatArray) -> FloatArray:
    more = np.empty((2 * of.shape[0], of.shape[1]))
    more[: of.shape[0]] = of
    return more


@compiled
def _foot(fan: Fan, plane: FloatArray, x: float, slope: float, point: FloatArray) -> None:
    """Where a beam meets a plane; NaN where it grazes it or comes from behind."""
    depth = _depth_on(plane, x, slope)
    point[0] = x
    point[1] = fan.apex_mm[1] + fan.lean[0] * x + slope * depth
    point[2] = fan.apex_mm[2] + fan.lean[1] * x + depth


@compiled
def _lines(
    patches: Patches,
    point: FloatArray,
    beyond: FloatArray,
    line: IntArray,
    row: IntArray,
    near: float,
) -> Outlines:
    """The points whose neighbours of the same side make a line, put on it."""
    n, k = line.size, 0
    out = Outlines(
        np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3)), np.empty(n, np.int64), np.empty(n)
    )  # fmt: skip
    order = np.argsort(line, kind="mergesort")  # rows stay in order within a line
    low = 0
    for place in range(n):
        j = order[place]
        basis = patches.basis[line[j] // SIDES]
        while line[order[low]] != line[j] or row[j] - row[order[low]] > NEAR_PROFILES:
            low += 1
        count, sx, sy, sxx, sxy, syy = 0, 0.0, 0.0, 0.0, 0.0, 0.0
        for q in range(low, n):
            other = order[q]
            if line[other] != line[j] or row[other] - row[j] > NEAR_PROFILES:
                break
            x, y, away2 = 0.0, 0.0, 0.0
            for v in range(3):
                d = point[other, v] - point[j, v]
                x += d * basis[0, v]
                y += d * basis[1, v]
                away2 += d * d
            if away2 < near * near:
                count += 1
                sx, sy, sxx, sxy, syy = sx + x, sy + y, sxx + x * x, sxy + x * y, syy + y * y
        if count < LEAST_NEIGHBOURS:
            continue
        sx, sy = sx / count, sy / count
        sxx, sxy, syy = sxx / count - sx * sx, sxy / count - sx * sy, syy / count - sy * sy
        angle = 0.5 * np.arctan2(2.0 * sxy, sxx - syy)
        ax, ay = np.cos(angle), np.sin(angle)
        scatter = sxx * ay * ay - 2.0 * sxy * ax * ay + syy * ax * ax
        bx, by = 0.0, 0.0
        for v in range(3):
            bx += beyond[j, v] * basis[0, v]
            by += beyond[j, v] * basis[1, v]
        half = ax * by - ay * bx  # of a cell, outward
        if abs(half) < LEAST_OUTWARD * np.sqrt(bx * bx + by * by):
            continue  # the other sides see this outline better
        if scatter > (STRAIGHT_MM + STRAIGHT_CELLS * abs(half)) ** 2:
            continue
        ox, oy = (-ay, ax) if half > 0.0 else (ay, -ax)
        offset = sx * ox + sy * oy
        for v in range(3):
            out.outward[k, v] = ox * basis[0, v] + oy * basis[1, v]
            out.normal[k, v] = patches.normal[line[j] // SIDES, v]
            out.point_mm[k, v] = point[j, v] + offset * out.outward[k, v]
        out.line[k] = line[j]
        out.variance_mm2[k] = half * half / 3.0 + scatter
        k += 1
    return chosen(out, np.arange(k))
