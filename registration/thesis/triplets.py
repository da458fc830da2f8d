"""The three points that a segment contributes to its patch (section 5.4)."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from registration.scan import FloatArray, IntArray, Scan
from registration.thesis.params import PatchParams
from registration.thesis.segments import Segments

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
    for s, segment in enumerate(index):
        carried = params.triplets == "carried"
        points[s, :, 2] = _depths(scan, segments, int(segment), points[s, :, 1], carried)
    if params.repair:
        bounds = np.append(np.unique(first_of_patch), len(patch))
        for start, stop in pairwise(bounds):
            points[start:stop] = repair_triplets(points[start:stop], params.repair_mm)
    return points


def _depths(
    scan: Scan, segments: Segments, segment: int, y_mm: FloatArray, whole_profile: bool
) -> FloatArray:
    """(3,) depth of a profile at given Y, between the nearest measurements on either side."""
    profile = scan.points_mm[segments.profile[segment]]
    if not whole_profile:
        profile = profile[segments.first[segment] : segments.last[segment] + 1]
    profile = profile[np.isfinite(profile[:, 2])]
    order = np.argsort(profile[:, 1], kind="stable")
    depth: FloatArray = np.interp(y_mm, profile[order, 1], profile[order, 2])
    return depth


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
