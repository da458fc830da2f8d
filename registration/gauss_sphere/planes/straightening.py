"""Scans without the bias of their sensor, before their planes are found for good.

The bias bends planes, which then fall to pieces, and tilts the pieces, by which the bias is known.
Corrected by their pieces, planes come together when they are found anew.
"""

from __future__ import annotations

import numpy as np

from registration.gauss_sphere.fan.beams import Fan
from registration.gauss_sphere.fan.calibrated import (
    BLOCK,
    Known,
    bias_and_noise,
    look_up,
    take_lateral_bias,
    tangent_of,
)
from registration.gauss_sphere.planes.points import Grouped, beams_of
from registration.gauss_sphere.planes.rough_plane import SAMPLE, settled_plane
from registration.kernels import compiled
from registration.scan import FloatArray

LEAST = 4  # points that have a plane and tell of its noise
SCALE_SAMPLE = 500  # points that tell the noise of a scan from that of the calibration


@compiled
def straightened(fan: Fan, points: Grouped, known: Known, turns: int) -> Fan:
    """A fan without the bias, and with the noise that goes with the inclination.

    Both hold for the points of patches, by a rough plane of each; a lateral bias goes from all
    points. The calibration knows the noise of its target's material: it is scaled to what the
    scan shows. Points of no patch keep the noise that the scan shows at their depth.
    """
    depth, sigma, apex_z = fan.depth_mm.copy(), fan.sigma_mm.copy(), fan.apex_mm[2]
    if known.lateral:
        take_lateral_bias(depth.reshape(-1), fan.slope.reshape(-1), apex_z, known)
    start, end, place = points.start, points.end, points.place
    planes = np.empty((start.size, 4))
    for i in range(start.size):
        if end[i] - start[i] >= LEAST:
            sample = beams_of(fan, fan.depth_mm, points, i, SAMPLE)
            settled_plane(sample, fan.lean, apex_z, known, turns, planes[i])
    scale = _scale_of_noise(fan, points, known, planes)
    slopes, depths, sigmas = fan.slope.reshape(-1), depth.reshape(-1), sigma.reshape(-1)
    all_measured, bias, foretold = fan.depth_mm.reshape(-1), np.empty(BLOCK), np.empty(BLOCK)
    slope, measured = np.empty(BLOCK), np.empty(BLOCK)
    for i in range(start.size):
        if end[i] - start[i] < LEAST:
            continue
        for first in range(start[i], end[i], BLOCK):
            n = min(BLOCK, end[i] - first)
            for j in range(n):
                k = place[first + j]
                slope[j], measured[j] = slopes[k], all_measured[k]
            bias_and_noise(
                slope[:n], measured[:n], planes[i], apex_z, known, bias[:n], foretold[:n]
            )
            for j in range(n):
                k = place[first + j]
                depths[k], sigmas[k] = measured[j] - bias[j], foretold[j] * scale
    return Fan(
        x_mm=fan.x_mm,
        gap_mm=fan.gap_mm,
        apex_mm=fan.apex_mm,
        slope=fan.slope,
        depth_mm=depth,
        sigma_mm=sigma,
        column_slope=fan.column_slope,
        lean=fan.lean,
    )


@compiled
def _scale_of_noise(fan: Fan, points: Grouped, known: Known, planes: FloatArray) -> float:
    """The noise that some points of the patches show, over what the calibration foretells."""
    start, end, place = points.start, points.end, points.place
    depth, slope, sigma = fan.depth_mm.reshape(-1), fan.slope.reshape(-1), fan.sigma_mm.reshape(-1)
    step = max((end - start).sum() // SCALE_SAMPLE, 1)
    measured, tangent, shown = np.empty((3, place.size // step + 1))
    n, due = 0, 0
    for i in range(start.size):
        if end[i] - start[i] < LEAST:
            continue
        due += start[i]
        while due < end[i]:
            k = place[due]
            measured[n], tangent[n], shown[n] = depth[k], tangent_of(slope[k], planes[i]), sigma[k]
            n += 1
            due += step
        due -= end[i]
    if n == 0:
        return 1.0
    foretold = np.empty(n)
    look_up(known.sigma, measured[:n], fan.apex_mm[2], tangent[:n], foretold)
    return float(np.median(shown[:n] / foretold))
