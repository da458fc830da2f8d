"""The three points that a segment contributes to its patch (section 5.4)."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from registration.kernels import compiled
from registration.scan import FloatArray, IntArray, Scan
from registration.thesis.segments import Segments
from registration.thesis.view_params import PatchParams

_QUARTERS = np.array([0.25, 0.5, 0.75])


def triplet_points(
    segments: Segments, index: IntArray, patch: IntArray, params: PatchParams, scan: Scan | None
) -> FloatArray:
    """Choose the points at 1/4, 1/2 and 3/4 of each segment, depths repaired.

    index, patch: (s,) segments in order of patches and profiles, and the patch of each.
    Returns (s, 3, 3): segment, point, coordinate. Raises ValueError when the reading needs a scan
    and none is given.
    """
    ends = segments.endpoints_mm[index]
    points = ends[:, None, 0] + _QUARTERS[:, None] * (ends[:, 1] - ends[:, 0])[:, None, :]
    first_of_patch = np.searchsorted(patch, patch)
    if params.triplets == "fitted":
        return points
    if scan is None:
        raise ValueError(
            f'PatchParams.triplets is "{params.triplets}", which reads depths from the scan; '
            'pass the scan, or use "fitted"'
        )
    if params.triplets == "carried":
        points[:, :, 1] = points[first_of_patch, :, 1]
    span = np.stack([segments.first[index], segments.last[index]], axis=1)
    if params.triplets == "carried":  # may leave the segment: any measurement of the profile counts
        span[:] = 0, scan.points_mm.shape[1] - 1
    points[..., 2] = _depths(
        np.ascontiguousarray(scan.points_mm), segments.profile[index], span, points[..., 1].copy()
    )
    if params.repair:
        bounds = np.append(np.unique(first_of_patch), len(patch))
        for start, stop in pairwise(bounds):
            points[start:stop] = repair_triplets(points[start:stop], params.repair_mm)
    return points


@compiled
def _depths(points: FloatArray, profile: IntArray, span: IntArray, y: FloatArray) -> FloatArray:
    """(s, 3) depth at given Y between the nearest measurements of a span of pixels."""
    z = np.empty_like(y)
    for s in range(len(profile)):
        measured = points[profile[s], span[s, 0] : span[s, 1] + 1]
        measured = measured[np.isfinite(measured[:, 2])]
        order = np.argsort(measured[:, 1])
        at, depth = measured[order, 1], measured[order, 2]
        for q in range(3):
            # Beyond the ends the outermost depth, as np.interp, which takes numba 8 s to compile.
            right = np.searchsorted(at, y[s, q])
            if right == 0:
                z[s, q] = depth[0]
            elif right == len(at):
                z[s, q] = depth[-1]
            else:
                share = (y[s, q] - at[right - 1]) / (at[right] - at[right - 1])
                z[s, q] = depth[right - 1] + share * (depth[right] - depth[right - 1])
    return z


def repair_triplets(points_mm: FloatArray, threshold_mm: float) -> FloatArray:
    """Replace the points of profiles that deviate from the one before in two of three places.

    points_mm: (k, 3, 3) profile, point, coordinate of one patch. The deviation of a point is that
        of its depth when its Y is that of the profile before, as where Y is carried on; in general
        it is the distance in the laser plane from the line through the points before.
    A deviating profile takes the points of the one before when the group has only two, otherwise
    they are interpolated from its sound profiles; X stays. Section 5.4.
    """
    deviation = _deviations(points_mm)
    jumps = np.zeros(len(points_mm), dtype=bool)
    jumps[1:] = np.count_nonzero(np.abs(deviation) > threshold_mm, axis=1) >= 2
    if not jumps.any():
        return points_mm
    for k in range(2, len(points_mm)):
        # The profile behind a deviating one jumps back, without being at fault.
        if jumps[k] and jumps[k - 1]:
            back = np.abs(_deviations(points_mm[[k - 2, k]])[0]) > threshold_mm
            jumps[k] = np.count_nonzero(back) >= 2
    repaired = points_mm.copy()
    if len(points_mm) == 2:
        repaired[1, :, 1:] = points_mm[0, :, 1:]
        return repaired
    rows, sound = np.arange(len(points_mm)), np.flatnonzero(~jumps)
    for p in range(3):
        for c in (1, 2):
            repaired[:, p, c] = np.interp(rows, sound, points_mm[sound, p, c])
    return repaired


def _deviations(points_mm: FloatArray) -> FloatArray:
    """(k - 1, 3) of every point from the profile before."""
    y, z = points_mm[..., 1], points_mm[..., 2]
    dy, dz = np.diff(y, axis=0), np.diff(z, axis=0)
    along_y, along_z = (y[:-1, 2] - y[:-1, 0]), (z[:-1, 2] - z[:-1, 0])
    length = np.hypot(along_y, along_z)
    safe = np.where(length > 0.0, length, 1.0)
    beside = (dz * along_y[:, None] - dy * along_z[:, None]) / safe[:, None]
    return np.where(dy == 0.0, dz, np.where(length[:, None] > 0.0, beside, dz))
