"""Scans without the bias of their sensor, before their planes are found for good.

The bias bends planes, which then fall to pieces, and tilts the pieces, by which the bias is known.
Corrected by their pieces, planes come together when they are found anew.
"""

from __future__ import annotations

import numpy as np

from registration.gauss_sphere.beams import Fan
from registration.gauss_sphere.calibrated import DEPTH, SIGMA, Known, take_bias, take_lateral_bias
from registration.gauss_sphere.plane_fit import sample_of, settled_plane
from registration.gauss_sphere.points import beams_of, points_by_label
from registration.kernels import compiled
from registration.scan import FloatArray, IntArray

SCALE_SAMPLE = 500  # points that tell the noise of a scan from that of the calibration


def straightened(
    fan: Fan, label: IntArray, n_patches: int, known: Known, turns: int
) -> tuple[Fan, Known]:
    """A fan without the bias, and with the noise that goes with the inclination.

    Both hold for the points with a label, by a rough plane of each label; a lateral bias goes from
    all points. The calibration knows the noise of its target's material: it is scaled to what the
    scan shows, by known.sigma_scale of the calibration that is returned.
    """
    depth_mm, sigma_mm = fan.depth_mm.copy(), fan.sigma_mm.copy()
    if known.lateral:
        take_lateral_bias(depth_mm.reshape(-1), fan.slope.reshape(-1), fan.apex_mm[2], known)
    scale = _straighten(fan, label, n_patches, known, turns, depth_mm, sigma_mm)
    return (
        fan._replace(depth_mm=depth_mm, sigma_mm=sigma_mm),
        known._replace(sigma_scale=scale),
    )


@compiled
def _straighten(
    fan: Fan,
    label: IntArray,
    n_patches: int,
    known: Known,
    turns: int,
    depth: FloatArray,
    sigma: FloatArray,
) -> float:
    rows, pixels, starts = points_by_label(label, n_patches)
    plane = np.zeros(4)
    for i in range(n_patches):
        a, b = starts[i], starts[i + 1]
        if b - a < 4:
            continue
        beams = beams_of(fan, fan.depth_mm, rows[a:b], pixels[a:b])
        settled_plane(sample_of(beams), fan.lean, fan.apex_mm[2], known, turns, plane)
        take_bias(beams, plane, fan.apex_mm[2], known)
        for j in range(a, b):
            depth[rows[j], pixels[j]] = beams[DEPTH, j - a]
            sigma[rows[j], pixels[j]] = beams[SIGMA, j - a]
    if rows.size == 0:
        return 1.0
    stride = max(rows.size // SCALE_SAMPLE, 1)
    ratio = np.empty((rows.size + stride - 1) // stride)
    for j in range(ratio.size):
        p, u = rows[j * stride], pixels[j * stride]
        ratio[j] = fan.sigma_mm[p, u] / sigma[p, u]
    scale = float(np.median(ratio))
    for j in range(rows.size):
        sigma[rows[j], pixels[j]] *= scale
    return scale
