"""Scans without the bias of their sensor, before their planes are found for good.

The bias bends planes, which then fall to pieces, and tilts the pieces, by which the bias is known.
Corrected by their pieces, planes come together when they are found anew.
"""

from __future__ import annotations

import numpy as np

from registration.gauss_sphere.beams import Fan
from registration.gauss_sphere.calibrated import (
    DEPTH,
    SIGMA,
    Known,
    take_bias,
    take_bias_and_noise,
    take_lateral_bias,
)
from registration.gauss_sphere.plane_fit import first_plane, sample_of
from registration.gauss_sphere.points import Grouped, beams_of
from registration.kernels import compiled
from registration.scan import FloatArray

SCALE_SAMPLE = 500  # points that tell the noise of a scan from that of the calibration


def straightened(fan: Fan, points: Grouped, known: Known, turns: int) -> Fan:
    """A fan without the bias, and with the noise that goes with the inclination.

    Both hold for the points of patches, by a rough plane of each; a lateral bias goes from all
    points. The calibration knows the noise of its target's material: it is scaled to what the
    scan shows. Points of no patch keep the noise that the scan shows at their depth.
    """
    depth_mm, sigma_mm = fan.depth_mm.copy(), fan.sigma_mm.copy()
    if known.lateral:
        take_lateral_bias(depth_mm.reshape(-1), fan.slope.reshape(-1), fan.apex_mm[2], known)
    _straighten(fan, points, known, turns, depth_mm, sigma_mm)
    return fan._replace(depth_mm=depth_mm, sigma_mm=sigma_mm)


@compiled
def _straighten(
    fan: Fan,
    points: Grouped,
    known: Known,
    turns: int,
    depth: FloatArray,
    sigma: FloatArray,
) -> None:
    plane, place, start, end = np.zeros(4), points.place, points.start, points.end
    all_depth, all_sigma = depth.reshape(-1), sigma.reshape(-1)
    foretold, total = np.empty(place.size), (end - start).sum()
    step = max(total // SCALE_SAMPLE, 1)
    ratio, n, due = np.empty(total // step + 1), 0, 0
    for i in range(start.size):
        beams, first = beams_of(fan, fan.depth_mm, points, i), start[i]
        if beams.shape[1] >= 4:
            _settled_plane(sample_of(beams), fan.lean, fan.apex_mm[2], known, turns, plane)
            take_bias_and_noise(beams, plane, fan.apex_mm[2], known)
        for j in range(beams.shape[1]):
            all_depth[place[first + j]] = beams[DEPTH, j]
            foretold[first + j] = beams[SIGMA, j]
        while due < beams.shape[1]:
            ratio[n] = all_sigma[place[first + due]] / beams[SIGMA, due]
            n += 1
            due += step
        due -= beams.shape[1]
    if n == 0:
        return
    scale = float(np.median(ratio[:n]))
    for i in range(start.size):
        for j in range(start[i], end[i]):
            all_sigma[place[j]] = foretold[j] * scale


@compiled
def _settled_plane(
    beams: FloatArray,
    lean: FloatArray,
    apex_z_mm: float,
    known: Known,
    turns: int,
    plane: FloatArray,
) -> None:
    """The plane of some beams that agrees with its own bias.

    The bias tilts a plane, by whose tilt it is known: in turns they settle.
    """
    first_plane(beams, lean, plane)
    for _ in range(turns):
        take_bias(beams, plane, apex_z_mm, known)
        first_plane(beams, lean, plane)
