"""How far the segments of two profiles lie on each other: the evaluation of section 4.2.2."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from registration.kernels import compiled
from registration.scan import FloatArray, IntArray
from registration.thesis.segments import Segments


@dataclass(frozen=True)
class Matches:
    """The pairs of segments that lie on each other under a pose.

    pairs: (m, 2) target and source segment.
    overlap_mm: (m,) length that both cover.
    normal: (m, 2) unit Y and Z, square to the bisector of the two lines.
    target_mm, source_mm: (m, 2, 2) Y and Z where that stretch begins and ends on either line, in
        the target's frame.
    """

    pairs: IntArray
    overlap_mm: FloatArray
    normal: FloatArray
    target_mm: FloatArray
    source_mm: FloatArray


def line_table(segments: Segments) -> FloatArray:
    """(n, 4) Y and Z of either end of each segment, its normal to one side, for the kernels."""
    ends = segments.endpoints_mm[:, :, 1:].copy()
    along = ends[:, 1] - ends[:, 0]
    normal = segments.normal[:, 1:]
    backward = along[:, 0] * normal[:, 1] - along[:, 1] * normal[:, 0] > 0.0
    ends[backward] = ends[backward, ::-1]
    return ends.reshape(-1, 4)


def total_overlaps(
    target: FloatArray,
    source: FloatArray,
    poses: FloatArray,
    angle_tolerance_rad: float,
    offset_tolerance_mm: float,
) -> tuple[FloatArray, FloatArray]:
    """Overlap of all segments under each pose, the sum of (4-5), and how they lie to each other.

    target, source: line tables. poses: (h, 3) dphi in rad, dx and dy in mm, as in (4-1) to (4-3).
    Returns (h,) totals in mm and (h,) sines of the largest angle between two overlapping lines.
    """
    totals: FloatArray
    spreads: FloatArray
    totals, spreads = _totals(target, source, poses, angle_tolerance_rad, offset_tolerance_mm)
    return totals, spreads


def matches_under(
    target: FloatArray,
    source: FloatArray,
    pose: FloatArray,
    angle_tolerance_rad: float,
    offset_tolerance_mm: float,
) -> Matches:
    """The pairs of segments that make the overlap under one pose (3,), in a fixed order."""
    moved = _moved(source, pose)
    found = np.zeros((len(target) * len(source), 13))
    n = _matches(target, moved, angle_tolerance_rad, offset_tolerance_mm, found)
    found = found[:n]
    return Matches(
        found[:, :2].astype(np.int64),
        found[:, 2],
        found[:, 3:5],
        found[:, 5:9].reshape(-1, 2, 2),
        found[:, 9:13].reshape(-1, 2, 2),
    )


@compiled
def _totals(
    target: FloatArray,
    source: FloatArray,
    poses: FloatArray,
    angle_tolerance: float,
    offset_tolerance: float,
) -> tuple[FloatArray, FloatArray]:
    total = np.zeros(len(poses))
    spread = np.zeros(len(poses))
    stretch = np.empty(11)
    normal = np.empty((len(target) * len(source), 2))
    for h in range(len(poses)):
        moved = _moved(source, poses[h])
        n = 0
        for i in range(len(target)):
            for j in range(len(source)):
                if _common(target[i], moved[j], angle_tolerance, offset_tolerance, stretch):
                    total[h] += stretch[0]
                    normal[n] = stretch[1:3]
                    for k in range(n):
                        sine = abs(normal[n, 0] * normal[k, 1] - normal[n, 1] * normal[k, 0])
                        spread[h] = max(spread[h], sine)
                    n += 1
    return total, spread


@compiled
def _matches(
    target: FloatArray,
    moved: FloatArray,
    angle_tolerance: float,
    offset_tolerance: float,
    found: FloatArray,
) -> int:
    n = 0
    for i in range(len(target)):
        for j in range(len(moved)):
            if _common(target[i], moved[j], angle_tolerance, offset_tolerance, found[n, 2:]):
                found[n, 0] = i
                found[n, 1] = j
                n += 1
    return n


@compiled
def _moved(lines: FloatArray, pose: FloatArray) -> FloatArray:
    """The source's lines in the target's frame, by the matrix of section C.1."""
    cos = np.cos(pose[0])
    sin = np.sin(pose[0])
    moved = np.empty_like(lines)
    for k in range(0, 4, 2):
        moved[:, k] = cos * lines[:, k] + sin * lines[:, k + 1] + pose[1]
        moved[:, k + 1] = -sin * lines[:, k] + cos * lines[:, k + 1] + pose[2]
    return moved


@compiled
def _common(
    a: FloatArray, b: FloatArray, angle_tolerance: float, offset_tolerance: float, out: FloatArray
) -> bool:
    """Whether two segments lie on each other; then their overlap, the normal and four points.

    Measured along the bisector of the two lines, which favours neither profile.
    """
    ay = a[2] - a[0]
    az = a[3] - a[1]
    by = b[2] - b[0]
    bz = b[3] - b[1]
    length_a = np.hypot(ay, az)
    length_b = np.hypot(by, bz)
    if length_a == 0.0 or length_b == 0.0:
        return False
    ay /= length_a
    az /= length_a
    by /= length_b
    bz /= length_b
    # Both run with their normal to the same side: lines seen from opposite sides run opposite ways.
    if abs(np.arctan2(ay * bz - az * by, ay * by + az * bz)) > angle_tolerance:
        return False
    uy = ay + by
    uz = az + bz
    norm = np.hypot(uy, uz)
    uy /= norm
    uz /= norm
    a0 = a[0] * uy + a[1] * uz
    a1 = a[2] * uy + a[3] * uz
    b0 = b[0] * uy + b[1] * uz
    b1 = b[2] * uy + b[3] * uz
    low = max(a0, b0)
    high = min(a1, b1)
    if high <= low:
        return False
    pa = (low - a0) / (a1 - a0)
    qa = (high - a0) / (a1 - a0)
    pb = (low - b0) / (b1 - b0)
    qb = (high - b0) / (b1 - b0)
    out[3] = a[0] + pa * (a[2] - a[0])
    out[4] = a[1] + pa * (a[3] - a[1])
    out[5] = a[0] + qa * (a[2] - a[0])
    out[6] = a[1] + qa * (a[3] - a[1])
    out[7] = b[0] + pb * (b[2] - b[0])
    out[8] = b[1] + pb * (b[3] - b[1])
    out[9] = b[0] + qb * (b[2] - b[0])
    out[10] = b[1] + qb * (b[3] - b[1])
    # Their distance halfway, across the bisector.
    my = 0.5 * (out[3] + out[5] - out[7] - out[9])
    mz = 0.5 * (out[4] + out[6] - out[8] - out[10])
    if abs(uy * mz - uz * my) > offset_tolerance:
        return False
    out[0] = high - low
    out[1] = -uz
    out[2] = uy
    return True
