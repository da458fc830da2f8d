"""Straight-line segmentation of profiles (section 5.3, appendix D)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from registration.kernels import compiled
from registration.scan import FloatArray, IntArray, Scan
from registration.thesis.view_params import SegmentParams


@dataclass(frozen=True)
class Segments:
    """The straight-line segments of one view, in the order of profiles and pixels.

    profile, first, last: (n,) profile, and its first and last pixel, both inclusive.
    centroid_mm: (n, 3) mean of the points.
    direction: (n, 3) unit, in the direction of growing pixel index.
    normal: (n, 3) unit, in the laser plane (no X), towards the sensor.
    endpoints_mm: (n, 2, 3) the first and last point projected on the line.
    length_mm: (n,) distance of the endpoints.
    count: (n,) number of points.
    """

    profile: IntArray
    first: IntArray
    last: IntArray
    centroid_mm: FloatArray
    direction: FloatArray
    normal: FloatArray
    length_mm: FloatArray
    endpoints_mm: FloatArray
    count: IntArray

    def __len__(self) -> int:
        return len(self.profile)


def find_segments(scan: Scan, params: SegmentParams) -> Segments:
    """Cut every profile into straight lines, from its first pixel to its last or longest first.

    A point belongs to the running segment while it lies within WARP of its line and within CLIFF
    of the point before. Section 5.3; the final fit is (D-3), or total least squares (corrected:
    a regression of Z on Y is biased for steep lines). The order "longest_first" is chapter 7's.
    """
    points = np.ascontiguousarray(scan.points_mm)
    first_line = params.seed == "first_points"
    spans = _spans(
        points,
        params.warp_mm,
        params.cliff_mm,
        params.seed_points,
        first_line,
        params.min_points,
        params.order == "longest_first",
    )
    profile, first, last = spans[:, 0], spans[:, 1], spans[:, 2]
    centroid, direction, count = _fits(points, spans, params.fit == "regression")
    rows = np.arange(len(spans))[:, None]
    ends = points[profile[:, None], np.stack([first, last], axis=1)]
    along = np.einsum("nej,nj->ne", ends - centroid[:, None], direction)
    backward = along[:, 0] > along[:, 1]
    direction[backward] *= -1.0
    along[backward] *= -1.0
    endpoints = centroid[rows] + along[..., None] * direction[rows]
    return Segments(
        profile=profile,
        first=first,
        last=last,
        centroid_mm=centroid,
        direction=direction,
        normal=_normals_to_sensor(scan, direction, centroid, profile),
        length_mm=along[:, 1] - along[:, 0],
        endpoints_mm=endpoints,
        count=count,
    )


def _normals_to_sensor(
    scan: Scan, direction: FloatArray, centroid_mm: FloatArray, profile: IntArray
) -> FloatArray:
    """(n, 3) perpendiculars within the laser plane, oriented towards the sensor."""
    normal = np.stack([np.zeros(len(direction)), direction[:, 2], -direction[:, 1]], axis=1)
    if scan.apex_mm is not None:
        apex = scan.apex_mm + scan.origins_mm[profile]
        normal *= np.where(np.einsum("nj,nj->n", normal, apex - centroid_mm) < 0.0, -1.0, 1.0)[
            :, None
        ]
        return normal
    # The beams fan out in the order of the pixels, so whichever side the sensor is on, it is the
    # same side of every line walked in that order; only the sense of the fan has to be found.
    return normal * _sense_of_fan(scan)


def _sense_of_fan(scan: Scan) -> float:
    """1 when the beams turn towards growing Y from pixel to pixel, else -1."""
    _, y, z = np.moveaxis(scan.in_profiles_mm, 2, 0)
    usable = scan.valid & (z > 0.0)
    pixel = np.nonzero(usable)[1]
    if len(pixel) == 0:
        return 1.0
    tangent = y[usable] / z[usable]
    return -1.0 if float((pixel - pixel.mean()) @ tangent) < 0.0 else 1.0


@compiled
def _spans(
    points: FloatArray,
    warp: float,
    cliff: float,
    seed_points: int,
    first_line: bool,
    min_points: int,
    longest_first: bool,
) -> IntArray:
    """(n, 3) profile, first and last pixel of every segment."""
    profiles, pixels = points.shape[:2]
    spans = np.empty((profiles * pixels, 3), dtype=np.int64)
    n = 0
    y = np.empty(pixels)
    z = np.empty(pixels)
    pixel = np.empty(pixels, dtype=np.int64)
    for k in range(profiles):
        m = 0
        for u in range(pixels):
            if np.isfinite(points[k, u, 2]):
                y[m] = points[k, u, 1]
                z[m] = points[k, u, 2]
                pixel[m] = u
                m += 1
        if longest_first:
            found = _longest(y[:m], z[:m], warp, cliff, seed_points, first_line, min_points)
        else:
            found = _in_order(y[:m], z[:m], warp, cliff, seed_points, first_line, min_points)
        for start, end in found:
            spans[n, 0] = k
            spans[n, 1] = pixel[start]
            spans[n, 2] = pixel[end]
            n += 1
    return spans[:n].copy()


@compiled
def _in_order(
    y: FloatArray,
    z: FloatArray,
    warp: float,
    cliff: float,
    seed_points: int,
    first_line: bool,
    min_points: int,
) -> IntArray:
    """(n, 2) first and last point of the lines met from one end of a profile to the other."""
    found = np.empty((len(y), 2), dtype=np.int64)
    n = 0
    start = 0
    while start + seed_points <= len(y):
        end, following = _grown(y, z, start, warp, cliff, seed_points, first_line)
        if end >= 0 and end - start + 1 >= min_points:
            found[n, 0] = start
            found[n, 1] = end
            n += 1
        start = following
    return found[:n]


@compiled
def _longest(
    y: FloatArray,
    z: FloatArray,
    warp: float,
    cliff: float,
    seed_points: int,
    first_line: bool,
    min_points: int,
) -> IntArray:
    """(n, 2) the longest line of a profile, then those of what is left on either side.

    A line grows point by point, so cut short by a line found before it is the line that would have
    grown in what that one left: every start has to be tried but once.
    """
    m = len(y)
    reach = np.full(m, -1, dtype=np.int64)
    for start in range(m - seed_points + 1):
        reach[start] = _grown(y, z, start, warp, cliff, seed_points, first_line)[0]
    found = np.empty((m, 2), dtype=np.int64)
    fewest = max(seed_points, min_points)
    left = [(0, m - 1)]
    n = 0
    while len(left) > 0:
        low, high = left.pop()
        best = -1
        longest = -1.0
        for start in range(low, high - fewest + 2):
            end = min(reach[start], high)
            if end - start + 1 < fewest:
                continue
            length = np.hypot(y[end] - y[start], z[end] - z[start])
            if length > longest:
                longest = length
                best = start
        if best < 0:
            continue
        end = min(reach[best], high)
        found[n, 0] = best
        found[n, 1] = end
        n += 1
        left.append((low, best - 1))
        left.append((end + 1, high))
    return found[:n][np.argsort(found[:n, 0])]


@compiled
def _grown(
    y: FloatArray,
    z: FloatArray,
    start: int,
    warp: float,
    cliff: float,
    seed_points: int,
    first_line: bool,
) -> tuple[int, int]:
    """Last point of the line that starts here, -1 for none, and where the next may start."""
    for i in range(start + 1, start + seed_points):
        if np.hypot(y[i] - y[i - 1], z[i] - z[i - 1]) > cliff:
            return -1, i
    end = start + seed_points - 1  # inclusive
    sums = _moments(y, z, start, end)
    cy, cz, dy, dz = _line(sums, y[start], z[start])
    for i in range(start, end + 1):
        if abs((y[i] - cy) * dz - (z[i] - cz) * dy) > warp:
            return -1, start + 1
    while end + 1 < len(y):
        i = end + 1
        if np.hypot(y[i] - y[end], z[i] - z[end]) > cliff:
            break
        if abs((y[i] - cy) * dz - (z[i] - cz) * dy) > warp:
            break
        end = i
        if not first_line:
            ry = y[i] - y[start]
            rz = z[i] - z[start]
            sums[0] += 1.0
            sums[1] += ry
            sums[2] += rz
            sums[3] += ry * ry
            sums[4] += ry * rz
            sums[5] += rz * rz
            cy, cz, dy, dz = _line(sums, y[start], z[start])
    return end, end + 1


@compiled
def _moments(y: FloatArray, z: FloatArray, start: int, end: int) -> FloatArray:
    """Count, sums and products of the points start..end, relative to the first of them."""
    sums = np.zeros(6)
    for i in range(start, end + 1):
        ry = y[i] - y[start]
        rz = z[i] - z[start]
        sums[0] += 1.0
        sums[1] += ry
        sums[2] += rz
        sums[3] += ry * ry
        sums[4] += ry * rz
        sums[5] += rz * rz
    return sums


@compiled
def _line(sums: FloatArray, y0: float, z0: float) -> tuple[float, float, float, float]:
    """Centroid and principal direction of accumulated points."""
    n = sums[0]
    my = sums[1] / n
    mz = sums[2] / n
    syy = sums[3] / n - my * my
    syz = sums[4] / n - my * mz
    szz = sums[5] / n - mz * mz
    angle = 0.5 * np.arctan2(2.0 * syz, syy - szz)
    return y0 + my, z0 + mz, np.cos(angle), np.sin(angle)


@compiled
def _fits(
    points: FloatArray, spans: IntArray, regression: bool
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Centroid, direction and number of points of every span."""
    n = len(spans)
    centroid = np.zeros((n, 3))
    direction = np.zeros((n, 3))
    count = np.zeros(n, dtype=np.int64)
    for s in range(n):
        k = spans[s, 0]
        for u in range(spans[s, 1], spans[s, 2] + 1):
            if np.isfinite(points[k, u, 2]):
                centroid[s] += points[k, u]
                count[s] += 1
        centroid[s] /= count[s]
        syy = 0.0
        syz = 0.0
        szz = 0.0
        for u in range(spans[s, 1], spans[s, 2] + 1):
            if np.isfinite(points[k, u, 2]):
                ry = points[k, u, 1] - centroid[s, 1]
                rz = points[k, u, 2] - centroid[s, 2]
                syy += ry * ry
                syz += ry * rz
                szz += rz * rz
        if regression:
            # A vertical line has no slope: (D-3) is singular there.
            angle = np.arctan2(syz, syy) if syy > 0.0 else 0.5 * np.pi
        else:
            angle = 0.5 * np.arctan2(2.0 * syz, syy - szz)
        direction[s, 1] = np.cos(angle)
        direction[s, 2] = np.sin(angle)
    return centroid, direction, count
