"""A scan seen as the fan of beams that measured it: slopes, inverse depths and their noise.

On a plane the inverse depth of a profile is linear in the slope of the beam, exactly, and the noise
of a triangulating scanner, which grows with the square of the range, is the same everywhere in it.
Straight lines are therefore found there by ordinary regression on a regressor without noise.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from registration.gauss_sphere.fan.apex import (
    CLEAR_MM,
    LEAST_PIXELS,
    PARALLEL_APEX_MM,
    find_apex,
)
from registration.gauss_sphere.fan.depth_noise import MIN_SIGMA_MM, depth_noise
from registration.gauss_sphere.fan.returns import profiles_with_returns, usable_points
from registration.kernels import compiled
from registration.scan import BoolArray, FloatArray, Scan

FEW_BEHIND = 0.02  # for each point in front: so many behind the apex are wild, more say it is none
CONVERGING = -0.9  # correlation of where beams lie aside and how they run, from which on they meet
ONE_PLACE = 0.1  # of the usual gap: profiles nearer to each other are of one place
NARROW_SHARE = 0.05  # of the way between profiles lies in gaps narrower than the least usual one
USUAL_GAPS = 6.0  # times as wide: where half of the profiles were lost at random, few are wider


class Fan(NamedTuple):
    """The beams of one view, each in the frame of its own profile.

    Profiles need not be evenly spaced. Those with next to no return are left out, but for the ones
    before the first and after the last that has more. So are points that lie where no scene does:
    a mark of no return may be a number, and a wild one must not decide where the beams meet.

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


class Measured(NamedTuple):
    """A scan as the compiled loops take it: always the same kinds of arrays, or they compile anew.

    points_mm: (profiles, pixels, 3).  step_mm: between profiles along X.  apex_mm: (3,), NaN where
    the scan does not carry it.  if_flat_mm: (3,) the apex where its points cannot tell, NaN where
    that is not known.  lean: (2,) see Fan.
    """

    points_mm: FloatArray
    step_mm: float
    apex_mm: FloatArray
    if_flat_mm: FloatArray
    lean: FloatArray


UNKNOWN_MM = np.full(3, np.nan)


def measured(scan: Scan, if_flat_mm: FloatArray = UNKNOWN_MM) -> Measured:
    """The same scan, for the compiled loops.

    if_flat_mm: (3,) the apex that was measured of the sensor, see Measured.
    """
    lean, apex_mm = scan.travel[1:] / scan.travel[0], UNKNOWN_MM
    if scan.apex_mm is not None:
        # Points are put back along the motion to where X is 0, and so is the apex.
        apex_mm = scan.apex_mm - scan.apex_mm[0] * np.array([0.0, *lean])
    step_mm = float(scan.step_mm * scan.travel[0])
    return Measured(_points_of(scan), step_mm, apex_mm, if_flat_mm, lean)


def profiles_in_fan(scan: Scan) -> BoolArray:
    """(profiles,) False for those of a scan, between others, in which next to nothing returned."""
    return profiles_with_returns(usable_points(_points_of(scan)))


def _points_of(scan: Scan) -> FloatArray:
    points_mm = np.ascontiguousarray(scan.points_mm).view()
    points_mm.setflags(write=False)  # as those of Scan.from_points are
    return points_mm


def seems_turned_around(fan: Fan) -> bool:
    """Whether the beams seem to meet beyond the points, as where Z is height in place of depth."""
    if fan.apex_mm[2] > -PARALLEL_APEX_MM:
        return False
    returned = np.isfinite(fan.depth_mm)
    z, y = (np.where(returned, values, 0.0) for values in (fan.depth_mm, fan.slope * fan.depth_mm))
    n = np.maximum(returned.sum(axis=0), 1)
    off_z = np.where(returned, z - z.sum(axis=0) / n, 0.0)
    clear = (off_z**2).sum(axis=0) > CLEAR_MM**2 * n
    if clear.sum() < LEAST_PIXELS:
        return False
    slope = (off_z * y).sum(axis=0)[clear] / (off_z**2).sum(axis=0)[clear]
    return bool(np.corrcoef(slope, (y.sum(axis=0) / n)[clear])[0, 1] < CONVERGING)


@compiled
def fan_of(scan: Measured) -> Fan:
    """Describe a scan by its beams; the apex is estimated when the scan does not carry it."""
    points, apex_mm, lean = scan.points_mm, scan.apex_mm, scan.lean
    usable = usable_points(points)
    kept = profiles_with_returns(usable)
    if not kept.all():
        points, usable = points[kept], usable[kept]
    unknown = np.isnan(apex_mm).any()
    if unknown:
        apex_mm = find_apex(points, usable, lean, scan.if_flat_mm)
    rows, columns = points.shape[:2]
    x_mm, column_slope = np.empty(rows), np.empty(columns)
    slope, depth_mm = np.empty((rows, columns)), np.empty((rows, columns))
    beams = x_mm, slope, depth_mm, column_slope
    behind = _take_beams(points, usable, apex_mm, lean, *beams)
    if unknown and behind > FEW_BEHIND * np.isfinite(depth_mm).sum():
        apex_mm = np.array([0.0, 0.0, -PARALLEL_APEX_MM])
        _take_beams(points, usable, apex_mm, lean, *beams)
    gap_mm = _usual_gap(x_mm[np.isfinite(x_mm)])
    _place_unseen(x_mm, gap_mm if gap_mm > 0.0 else scan.step_mm)
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
    usable: BoolArray,
    apex_mm: FloatArray,
    lean: FloatArray,
    x_mm: FloatArray,
    slopes: FloatArray,
    depths: FloatArray,
    column_slope: FloatArray,
) -> int:
    """Fill in the last four: NaN, slopes 0, where nothing usable returned.

    Returns how many points lie behind the apex, where no beam can be.
    """
    behind = 0
    sums, seen = np.zeros(points.shape[1]), np.zeros(points.shape[1])
    for p in range(points.shape[0]):
        first, x, n = 0.0, 0.0, 0
        for u in range(points.shape[1]):
            depths[p, u], slopes[p, u] = np.nan, 0.0
            if not usable[p, u]:
                continue
            depth = points[p, u, 2] - lean[1] * points[p, u, 0] - apex_mm[2]
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
            else:
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
