"""Removal of isolated points and the 1 x 5 median (section 5.2)."""

from __future__ import annotations

import numpy as np

from registration.kernels import compiled
from registration.scan import FloatArray, IntArray, Scan
from registration.thesis.view_params import PreprocessParams


def preprocess(scan: Scan, params: PreprocessParams) -> Scan:
    """Drop the isolated points of each profile and smooth its depths.

    Only Z is smoothed, X and Y stay; a no-return stays one. Section 5.2.
    """
    points = scan.points_mm.copy()
    run = profile_runs(points, params.isolated_gap_mm)
    _drop_short_runs(points, run, params.isolated_max_points)
    if params.median_width > 1:
        run = profile_runs(points, params.isolated_gap_mm)  # runs may have joined up
        points[..., 2] = _median(
            points[..., 2], run, params.median_width // 2, params.median_across_gaps
        )
    return Scan.from_points(points, scan.step_mm, scan.intensity, scan.apex_mm, scan.travel)


def profile_runs(points_mm: FloatArray, gap_mm: float) -> IntArray:
    """Number the runs of neighbouring points of each profile.

    points_mm: (profiles, pixels, 3), NaN = no return, which by itself does not end a run.
    Returns (profiles, pixels) run number within the profile, -1 for a no-return; two successive
    points farther apart than gap_mm in the laser plane belong to different runs.
    """
    runs: IntArray = _runs(np.ascontiguousarray(points_mm), gap_mm)
    return runs


@compiled
def _runs(points: FloatArray, gap: float) -> IntArray:
    profiles, pixels = points.shape[:2]
    run = np.full((profiles, pixels), -1, dtype=np.int64)
    for k in range(profiles):
        number = -1
        previous = -1
        for u in range(pixels):
            if not np.isfinite(points[k, u, 2]):
                continue
            if previous < 0 or (
                np.hypot(
                    points[k, u, 1] - points[k, previous, 1],
                    points[k, u, 2] - points[k, previous, 2],
                )
                > gap
            ):
                number += 1
            run[k, u] = number
            previous = u
    return run


@compiled
def _drop_short_runs(points: FloatArray, run: IntArray, max_points: int) -> None:
    profiles, pixels = run.shape
    size = np.zeros(pixels, dtype=np.int64)
    for k in range(profiles):
        size[:] = 0
        for u in range(pixels):
            if run[k, u] >= 0:
                size[run[k, u]] += 1
        for u in range(pixels):
            if run[k, u] >= 0 and size[run[k, u]] <= max_points:
                points[k, u, :] = np.nan


@compiled
def _median(z: FloatArray, run: IntArray, half: int, across_gaps: bool) -> FloatArray:
    profiles, pixels = z.shape
    smooth = z.copy()
    window = np.empty(2 * half + 1)
    for k in range(profiles):
        for u in range(pixels):
            if run[k, u] < 0:
                continue
            window[0] = z[k, u]
            count = 1
            for d in range(1, half + 1):
                left = u - d if u >= d and run[k, u - d] >= 0 else -1
                right = u + d if u + d < pixels and run[k, u + d] >= 0 else -1
                if across_gaps:
                    if left >= 0:
                        window[count] = z[k, left]
                        count += 1
                    if right >= 0:
                        window[count] = z[k, right]
                        count += 1
                elif (
                    # A point without its mirror image would pull the median along the slope.
                    left >= 0
                    and right >= 0
                    and run[k, left] == run[k, u]
                    and run[k, right] == run[k, u]
                ):
                    window[count] = z[k, left]
                    window[count + 1] = z[k, right]
                    count += 2
            smooth[k, u] = np.median(window[:count])
    return smooth
