"""Planes fitted to the points of a scan by maximum likelihood, for noise along the beams."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from registration.gauss_sphere.fan.beams import Fan
from registration.gauss_sphere.fan.calibrated import DEPTH, SIGMA, SLOPE, Known, X
from registration.gauss_sphere.params import PatchParams
from registration.gauss_sphere.planes.plane_fit import fit_plane
from registration.gauss_sphere.planes.points import Grouped, beams_of
from registration.gauss_sphere.planes.rough_plane import SAMPLE
from registration.gauss_sphere.small_matrices import invert_symmetric3
from registration.kernels import compiled
from registration.scan import BoolArray, FloatArray, IndexArray, IntArray

USUAL_POINTS = 50.0  # of the usual noise, that are counted with a plane's own
LEAST_NOISE = 0.25  # of the usual variance: rounded depths may seem to have next to none
# Of the variance of the depths, what planes must show: less is rounding, as depths are never taken
# to be exact. Means of nine pixels leave 0.11.
LEAST_SHOWN = 0.05
MOST_PATCHES = 1000  # of the largest: the rest are pieces of what is not plane, or hardly any area


class Patches(NamedTuple):
    """Planes n . p = offset in the scan's frame, structure of arrays, the largest first.

    normal: (m, 3) unit, towards the sensor.  centroid_mm: (m, 3) on the plane.
    offset_mm: (m,).  basis: (m, 2, 3) two unit tangents.
    covariance: (m, 3, 3) of (tilt towards basis 0 in rad, tilt towards basis 1, offset at the
        centroid in mm).
    spread_mm: (m, 2) standard deviation of the points along the basis, which is turned to their
        principal axes.
    n_points: (m,); area_mm2: (m,).
    label: (profiles, pixels) patch of each point, -1 for none; profiles are those of the fan.
    """

    normal: FloatArray
    offset_mm: FloatArray
    centroid_mm: FloatArray
    basis: FloatArray
    covariance: FloatArray
    spread_mm: FloatArray
    n_points: IntArray
    area_mm2: FloatArray
    label: IndexArray


class Fitting(NamedTuple):
    """What PatchParams say of fitting, as the compiled loops take it."""

    gate_sigma: float
    fit_rounds: int
    min_points: int


def fitting(params: PatchParams) -> Fitting:
    """The parameters that say how planes are fitted."""
    return Fitting(params.gate_sigma, params.fit_rounds, params.min_points)


@compiled
def fit_patches(
    fan: Fan, measured_mm: FloatArray, points: Grouped, known: Known, how: Fitting
) -> Patches:
    """Fit a plane to the points of each patch by maximum likelihood for noise along the beams.

    Plain least squares of the distances is biased for planes seen at a slant, because the noise has
    a component along them; here the derivatives are taken at the foot of each point along its beam.
    Points farther off than how.gate_sigma standard deviations get no label.

    With a calibration its bias is taken out of measured_mm (profiles, pixels) by the very planes
    that are fitted, starting from fan.depth_mm as straightening left it. fan.depth_mm is changed in
    place: the points of planes get their corrected depths. Without one it is measured_mm itself,
    and covariances are by the noise that each plane's own points show.
    """
    n_patches = points.start.size
    start, end, place, depth = points.start, points.end, points.place, fan.depth_mm.reshape(-1)
    area_per_beam = _beam_area(fan)
    kept = np.zeros(place.size, np.bool_)
    planes, moments = np.zeros((n_patches, 4)), np.zeros((n_patches, 7))
    centre, basis = np.zeros((n_patches, 3)), np.zeros((n_patches, 2, 3))
    spread, covariance = np.zeros((n_patches, 2)), np.zeros((n_patches, 3, 3))
    g, area, shown = np.zeros((3, 4)), np.zeros(n_patches), np.zeros(n_patches)
    least = max(how.min_points, 4)
    for i in range(n_patches):
        a, b = start[i], end[i]
        if b - a < least:
            continue
        beams = beams_of(fan, measured_mm, points, i, b - a)
        sample = beams_of(fan, measured_mm, points, i, SAMPLE)
        if not fit_plane(
            beams, sample, fan.lean, fan.apex_mm[2], known, how.gate_sigma, how.fit_rounds,
            kept[a:b], planes[i], centre[i], basis[i, 0], basis[i, 1], g, moments[i],
        ):  # fmt: skip
            continue
        if moments[i, 0] >= least:
            _about_centroid(
                planes[i], moments[i], g, centre[i], basis[i, 0], basis[i, 1], spread[i],
                covariance[i],
            )  # fmt: skip
            area[i] = moments[i, 6] * area_per_beam
            if not known.given:
                shown[i] = _noise_shown(beams, kept[a:b], planes[i], fan.lean)
            # From the apex to the scan's own y and z.
            for t in range(1, 3):
                centre[i, t] += fan.apex_mm[t]
            planes[i, 3] += planes[i, 1] * fan.apex_mm[1] + planes[i, 2] * fan.apex_mm[2]
        if known.given and area[i] > 0.0:
            for j in range(a, b):
                depth[place[j]] = beams[DEPTH, j - a]
    if not known.given:
        _weigh_by_noise(shown, np.where(area > 0.0, moments[:, 0], 0.0), covariance)
    n_kept = min(np.count_nonzero(area > 0.0), MOST_PATCHES)
    order = np.argsort(-area, kind="mergesort")[:n_kept]
    renumber = np.full(n_patches, -1)
    renumber[order] = np.arange(order.size)
    label = np.full(fan.depth_mm.shape, -1, np.int32)
    of_point = label.reshape(-1)
    for i in range(n_patches):
        if renumber[i] < 0:
            continue
        for j in range(start[i], end[i]):
            if kept[j]:
                of_point[place[j]] = renumber[i]
    return Patches(
        planes[order, :3].copy(),
        planes[order, 3].copy(),
        centre[order],
        basis[order],
        covariance[order],
        spread[order],
        moments[order, 0].astype(np.int64),
        area[order],
        label,
    )


@compiled
def _noise_shown(beams: FloatArray, kept: BoolArray, plane: FloatArray, lean: FloatArray) -> float:
    """Mean square of how far the kept beams (5, n) are off their plane, in their variances."""
    travel, total, n = plane[0] + plane[1] * lean[0] + plane[2] * lean[1], 0.0, 0
    for j in range(kept.size):
        if kept[j]:
            along = plane[1] * beams[SLOPE, j] + plane[2]
            off = travel * beams[X, j] + along * beams[DEPTH, j] - plane[3]
            total += (off / (along * beams[SIGMA, j])) ** 2
            n += 1
    return total / max(n - 3, 1)


@compiled
def _weigh_by_noise(shown: FloatArray, n_points: FloatArray, covariance: FloatArray) -> None:
    """Covariances (m, 3, 3), changed in place, by the noise shown, in units of the usual one.

    Noise grows with the inclination, which the depth alone does not tell, and bent planes seem to
    have more. The usual one, that half of all points have or less, is what neighbours tell: where a
    sensor smooths its profiles points are less off their planes than they are uncertain.

    shown: (m,) of each plane, in variances; n_points: (m,) 0 for none.
    """
    order = np.argsort(shown, kind="mergesort")
    reached = np.cumsum(n_points[order])
    usual = shown[order[np.searchsorted(reached, 0.5 * reached[-1])]] if order.size else 0.0
    if usual < LEAST_SHOWN:
        return
    for i in range(order.size):
        own = n_points[i] * shown[i] / usual
        covariance[i] *= max((own + USUAL_POINTS) / (n_points[i] + USUAL_POINTS), LEAST_NOISE)


@compiled
def _about_centroid(
    plane: FloatArray,
    moments: FloatArray,
    g: FloatArray,
    centre: FloatArray,
    e: FloatArray,
    f: FloatArray,
    spread: FloatArray,
    covariance: FloatArray,
) -> None:
    """Move the centre to the centroid, turn e and f to the principal axes; covariance there."""
    n = moments[0]
    ma, mb = moments[1] / n, moments[2] / n
    vaa, vab = moments[3] / n - ma * ma, moments[4] / n - ma * mb
    vbb = moments[5] / n - mb * mb
    away = plane[3]
    for t in range(3):
        centre[t] += ma * e[t] + mb * f[t]
        away -= plane[t] * centre[t]
    for t in range(3):
        centre[t] += away * plane[t]
    turn = 0.5 * np.arctan2(2.0 * vab, vaa - vbb)
    c, s = np.cos(turn), np.sin(turn)
    for t in range(3):
        e[t], f[t] = c * e[t] + s * f[t], c * f[t] - s * e[t]
    spread[0] = np.sqrt(max(c * c * vaa + 2.0 * c * s * vab + s * s * vbb, 0.0))
    spread[1] = np.sqrt(max(s * s * vaa - 2.0 * c * s * vab + c * c * vbb, 0.0))
    w = g[2, 2]
    wa, wb = -g[0, 2] - w * ma, -g[1, 2] - w * mb
    waa = g[0, 0] + 2.0 * ma * g[0, 2] + w * ma * ma
    wbb = g[1, 1] + 2.0 * mb * g[1, 2] + w * mb * mb
    wab = g[0, 1] + ma * g[1, 2] + mb * g[0, 2] + w * ma * mb
    information = np.empty((3, 3))
    information[0, 0] = c * c * waa + 2.0 * c * s * wab + s * s * wbb
    information[1, 1] = s * s * waa - 2.0 * c * s * wab + c * c * wbb
    information[0, 1] = c * s * (wbb - waa) + (c * c - s * s) * wab
    information[0, 2], information[1, 2] = -(c * wa + s * wb), -(c * wb - s * wa)
    information[2, 2] = w
    information[1, 0], information[2, 0] = information[0, 1], information[0, 2]
    information[2, 1] = information[1, 2]
    invert_symmetric3(information, covariance)


@compiled
def _beam_area(fan: Fan) -> float:
    """What a beam stands for in profile spacing times slope, on average.

    A gap wider than the usual one counts as that; of nearly constant ones the mean will do.
    """
    # Beyond the outermost columns in which anything returned, slopes are not known.
    slope, seen = fan.column_slope[np.isfinite(fan.column_slope)], 0.0
    for p in range(1, fan.x_mm.size):
        seen += min(abs(fan.x_mm[p] - fan.x_mm[p - 1]), fan.gap_mm)
    gaps = (fan.x_mm.size - 1) * (slope.size - 1)
    return float(abs(slope[-1] - slope[0]) * seen / gaps) if gaps > 0 else 0.0


@compiled
def planes_in_beams(fan: Fan, patches: Patches) -> FloatArray:
    """(m, 4) travel, y, z and offset of each plane as beams meet it.

    At position x a beam meets it (offset - travel x) / (y slope + z) deep from their apex.
    """
    planes = np.empty((patches.offset_mm.size, 4))
    for i in range(planes.shape[0]):
        n0, n1, n2 = patches.normal[i, 0], patches.normal[i, 1], patches.normal[i, 2]
        planes[i, 0] = n0 + n1 * fan.lean[0] + n2 * fan.lean[1]
        planes[i, 1], planes[i, 2] = n1, n2
        planes[i, 3] = patches.offset_mm[i] - n1 * fan.apex_mm[1] - n2 * fan.apex_mm[2]
    return planes


@compiled
def middle(patches: Patches) -> FloatArray:
    """(3,) centre in mm of the surface that a view saw, in its own frame."""
    centre, total = np.zeros(3), 0.0
    for i in range(patches.area_mm2.size):
        total += patches.area_mm2[i]
        for u in range(3):
            centre[u] += patches.area_mm2[i] * patches.centroid_mm[i, u]
    return centre / total
