"""A scan seen as the fan of beams that measured it: slopes, inverse depths and their noise.

On a plane the inverse depth of a profile is linear in the slope of the beam, exactly, and the noise
of a triangulating scanner, which grows with the square of the range, is the same everywhere in it.
Straight lines are therefore found there by ordinary regression on a regressor without noise.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from registration.gauss_sphere.depth_noise import MIN_SIGMA_MM, depth_noise
from registration.kernels import compiled
from registration.scan import BoolArray, FloatArray, Scan

PARALLEL_APEX_MM = 1e5  # stands for beams that do not meet
PARALLEL = 1e-6  # of the largest singular value of the lines' equations, their least
APEX_PROFILES = 40  # of a longer scan, for the apex
ONE_PLACE = 0.1  # of the usual gap: profiles nearer to each other are of one place
NARROW_SHARE = 0.05  # of the way between profiles lies in gaps narrower than the least usual one
USUAL_GAPS = 6.0  # times as wide: where half of the profiles were lost at random, few are wider


class Fan(NamedTuple):
    """The beams of one view, each in the frame of its own profile.

    Profiles need not be evenly spaced. Those without a return are left out, but for the ones before
    the first and after the last that has any.

    x_mm: (profiles,) position of each profile; gap_mm: the usual gap between them.
    apex_mm: (3,) of the first profile, its x included in x_mm.
    slope: (profiles, pixels) lateral tangent (y - apex_y) / (z - apex_z), 0 where nothing returned.
    depth_mm: (profiles, pixels) z - apex_z, NaN where nothing returned.
    sigma_mm: (profiles, pixels) standard deviation of the depth along the beam.
    column_slope: (pixels,) the slope of each pixel, increasing or decreasing; between those
        of others where it was never seen, NaN beyond them.
    lean: (2,) Y and Z by which the sensor moved for every mm along X; 0 where X is its motion. The
        point (x, slope depth, depth) of a beam, from the apex of its profile, lies in the scan's
        frame at lean x more along Y and Z: a shear, which keeps planes plane.
    """

    x_mm: FloatArray
    gap_mm: float
    apex_mm: FloatArray
    slope: FloatArray
    depth_mm: FloatArray
    sigma_mm: FloatArray
    column_slope: FloatArray
    lean: FloatArray


def fan_of(scan: Scan) -> Fan:
    """Describe a scan by its beams; the apex is estimated when the scan does not carry it."""
    kept = profiles_in_fan(scan)
    # Arrays of one kind for every scan, an unpickled one, too: loops are compiled for each kind.
    points_mm = scan.points_mm.view() if kept.all() else scan.points_mm[kept]
    points_mm.setflags(write=False)
    apex_mm = np.full(3, np.nan) if scan.apex_mm is None else np.array(scan.apex_mm, np.float64)
    lean = scan.travel[1:] / scan.travel[0]
    return _fan(points_mm, scan.step_mm * scan.travel[0], apex_mm, lean)


def profiles_in_fan(scan: Scan) -> BoolArray:
    """(profiles,) False for those of a scan, between others, in which nothing returned."""
    kept, measured = np.ones(len(scan.points_mm), np.bool_), np.flatnonzero(scan.valid.any(axis=1))
    if measured.size:
        kept[measured[0] : measured[-1]] = False
        kept[measured] = True
    return kept


@compiled
def _fan(points: FloatArray, step: float, apex_mm: FloatArray, lean: FloatArray) -> Fan:
    """The fan of a scan whose apex (3,) is NaN where it is to be estimated."""
    unknown = np.isnan(apex_mm).any()
    if unknown:
        apex_mm = _apex(points, lean)
    rows, columns = points.shape[:2]
    x_mm, column_slope = np.empty(rows), np.empty(columns)
    slope, depth_mm = np.empty((rows, columns)), np.empty((rows, columns))
    if _take_beams(points, apex_mm, lean, x_mm, slope, depth_mm, column_slope) and unknown:
        apex_mm = np.array([0.0, 0.0, -PARALLEL_APEX_MM])
        _take_beams(points, apex_mm, lean, x_mm, slope, depth_mm, column_slope)
    gap_mm = _usual_gap(x_mm[np.isfinite(x_mm)])
    _place_unseen(x_mm, gap_mm if gap_mm > 0.0 else step)
    _fill_between(column_slope)
    sigma_mm = np.empty((rows, columns))
    _take_noise(depth_mm, sigma_mm, *depth_noise(depth_mm, slope))
    return Fan(x_mm, gap_mm, apex_mm, slope, depth_mm, sigma_mm, column_slope, lean)


@compiled
def _usual_gap(x: FloatArray) -> float:
    """The mean gap between places (n,) that follow each other, each weighted by its length.

    Gaps far wider than the narrow ones are left out, as long as these make a twentieth of the way;
    those of a sensor that stands still weigh nothing. 0 where all places are one.
    """
    gap = np.sort(np.abs(np.diff(x)))
    narrow, way, total = 0.0, 0.0, gap.sum()
    for g in gap:
        narrow, way = g, way + g
        if way >= NARROW_SHARE * total:
            break
    squares, length = 0.0, 0.0
    for g in gap:
        if g <= USUAL_GAPS * narrow:
            squares += g * g
            length += g
    return float(squares / length) if length > 0.0 else 0.0


@compiled
def _place_unseen(x_mm: FloatArray, step: float) -> None:
    """Fill in NaN in the places of profiles: evenly between others, by steps before and after."""
    known = np.flatnonzero(np.isfinite(x_mm))
    if known.size == 0:
        x_mm[:] = step * np.arange(x_mm.size)
        return
    first, last = known[0], known[-1]
    if x_mm[last] < x_mm[first]:
        step = -step
    for p in range(first):
        x_mm[p] = x_mm[first] - (first - p) * step
    for p in range(last + 1, x_mm.size):
        x_mm[p] = x_mm[last] + (p - last) * step
    _fill_between(x_mm)


@compiled
def _fill_between(value: FloatArray) -> None:
    """Fill in NaN between two numbers, on the line through them."""
    last = -1
    for v in range(value.size):
        if np.isnan(value[v]):
            continue
        for u in range(last + 1, v if last >= 0 else 0):
            share = (u - last) / (v - last)
            value[u] = (1.0 - share) * value[last] + share * value[v]
        last = v


@compiled
def _take_beams(
    points: FloatArray,
    apex_mm: FloatArray,
    lean: FloatArray,
    x_mm: FloatArray,
    slopes: FloatArray,
    depths: FloatArray,
    column_slope: FloatArray,
) -> int:
    """Fill in the last four: NaN, slopes 0, where nothing returned.

    Returns how many points lie behind the apex, where no beam can be.
    """
    behind = 0
    sums, seen = np.zeros(points.shape[1]), np.zeros(points.shape[1])
    for p in range(points.shape[0]):
        first, x, n = 0.0, 0.0, 0
        for u in range(points.shape[1]):
            depth = points[p, u, 2] - lean[1] * points[p, u, 0] - apex_mm[2]
            depths[p, u], slopes[p, u] = np.nan, 0.0
            if depth > 0.0:
                aside = points[p, u, 1] - lean[0] * points[p, u, 0] - apex_mm[1]
                slope = aside / depth
                depths[p, u] = depth
                slopes[p, u] = slope
                # About the first, so that the mean of equal ones is exact.
                first = points[p, u, 0] if n == 0 else first
                x += points[p, u, 0] - first
                n += 1
                sums[u] += slope
                seen[u] += 1.0
            elif depth <= 0.0:
                behind += 1
        x_mm[p] = first + x / n if n > 0 else np.nan
    for u in range(points.shape[1]):
        column_slope[u] = sums[u] / seen[u]  # NaN if never seen
    return behind


@compiled
def _take_noise(depth: FloatArray, sigma: FloatArray, constant: float, square: float) -> None:
    for p in range(depth.shape[0]):
        for u in range(depth.shape[1]):
            sigma[p, u] = max(constant + square * depth[p, u] ** 2, MIN_SIGMA_MM)


@compiled
def _apex(points: FloatArray, lean: FloatArray) -> FloatArray:
    """Find where the beams meet from points whose noise lies along their beam.

    A pixel's points satisfy y = apex_y + s (z - apex_z) in all profiles; the intercepts of these
    lines over their slopes give the apex. Scans too flat to tell get nearly parallel beams.
    """
    stride = max(points.shape[0] // APEX_PROFILES, 1)
    pixels = _pixel_lines(points, lean, stride)
    parallel = np.array([0.0, 0.0, -PARALLEL_APEX_MM])
    n = pixels.n.size
    slope, intercept, weight = np.empty(n), np.empty(n), np.zeros(n)
    used = 0
    for u in range(n):
        spread, shared = pixels.spread[u], pixels.shared[u]
        # Below 5 mm of relief a slope is mostly rounding; marks of no return may overflow.
        if pixels.n[u] >= 3 and spread > 25.0 * pixels.n[u] and np.isfinite(spread + shared):
            slope[used] = shared / spread
            intercept[used] = pixels.mean_y[u] - slope[used] * pixels.mean_z[u]
            weight[used] = spread
            used += 1
    if used < 8:
        return parallel
    slope, intercept, weight = slope[:used], intercept[:used], weight[:used]
    total = weight.sum()
    mean_slope = (weight * slope).sum() / total
    mean_intercept = (weight * intercept).sum() / total
    slope -= mean_slope
    spread, shared = (weight * slope * slope).sum(), (weight * slope * intercept).sum()
    squares = total * (1.0 + mean_slope * mean_slope) + spread
    if total * spread <= (PARALLEL * squares) ** 2:
        return parallel
    z = -shared / spread
    return parallel if z >= pixels.least_z else np.array([0.0, mean_intercept + mean_slope * z, z])


class _PixelLines(NamedTuple):
    """Sums over some profiles of what each pixel measured, (pixels,), in mm.

    n: number of points; mean_y, mean_z: their means; spread, shared: sums of dz^2 and dy dz about
    them.  least_z: the least depth of these points.
    """

    n: FloatArray
    mean_y: FloatArray
    mean_z: FloatArray
    spread: FloatArray
    shared: FloatArray
    least_z: float


@compiled
def _pixel_lines(points: FloatArray, lean: FloatArray, stride: int) -> _PixelLines:
    """The lines of all pixels, from every stride-th profile."""
    n_pixels = points.shape[1]
    n, first_y, first_z = np.zeros(n_pixels), np.zeros(n_pixels), np.zeros(n_pixels)
    sum_y, sum_z, sum_zz, sum_yz = np.zeros((4, n_pixels))
    least_z = np.inf
    for p in range(0, points.shape[0], stride):
        for u in range(n_pixels):
            x, y, z = points[p, u]
            if not np.isfinite(z):
                continue
            y, z = y - lean[0] * x, z - lean[1] * x
            least_z = min(least_z, z)
            if n[u] == 0.0:
                first_y[u], first_z[u] = y, z
            # About the first of a pixel's points, so that small spreads keep their digits.
            dy, dz = y - first_y[u], z - first_z[u]
            n[u] += 1.0
            sum_y[u] += dy
            sum_z[u] += dz
            sum_zz[u] += dz * dz
            sum_yz[u] += dy * dz
    mean_y, mean_z = np.empty(n_pixels), np.empty(n_pixels)
    for u in range(n_pixels):
        dy, dz = sum_y[u] / max(n[u], 1.0), sum_z[u] / max(n[u], 1.0)
        mean_y[u], mean_z[u] = first_y[u] + dy, first_z[u] + dz
        sum_zz[u] -= dz * sum_z[u]
        sum_yz[u] -= dy * sum_z[u]
    return _PixelLines(n, mean_y, mean_z, sum_zz, sum_yz, least_z)
