"""The three points that a segment contributes to its patch (section 5.4)."""

from __future__ import annotations

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
    if params.repair != "off":
        for start in np.unique(first_of_patch):
            stop = int(np.searchsorted(patch, patch[start], side="right"))
            points[start:stop, :, 2] = repair_depths(
                points[start:stop, :, 2], params.repair_mm, params.repair == "trend"
            )
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
    return np.interp(y_mm, profile[order, 1], profile[order, 2])


def repair_depths(z_mm: FloatArray, threshold_mm: float, trend: bool = False) -> FloatArray:
    """Replace the depths of profiles that deviate from the one before in two of three points.

    z_mm: (k, 3) depths of the three points in each of k profiles.
    trend: judge the deviation beside the median deviation of the group, so that a face that
        recedes steeply along X is not taken for a jump.
    A deviating profile takes the depths of the one before when the group has only two, otherwise
    they are interpolated from its sound profiles. Section 5.4.
    """
    step = np.diff(z_mm, axis=0)
    if trend and len(step) > 1:
        step = step - np.median(step, axis=0)
    deviates = np.zeros(len(z_mm), dtype=bool)
    deviates[1:] = np.count_nonzero(np.abs(step) > threshold_mm, axis=1) >= 2
    # Behind one deviating profile the next one jumps back: it is sound.
    for k in range(2, len(z_mm)):
        if deviates[k] and deviates[k - 1]:
            back = np.abs(z_mm[k] - z_mm[k - 2]) <= threshold_mm
            deviates[k] = np.count_nonzero(back) < 2
    if not deviates.any():
        return z_mm
    if len(z_mm) == 2:
        return np.repeat(z_mm[:1], 2, axis=0)
    sound = np.flatnonzero(~deviates)
    rows = np.arange(len(z_mm))
    return np.stack([np.interp(rows, sound, z_mm[sound, p]) for p in range(3)], axis=1)
