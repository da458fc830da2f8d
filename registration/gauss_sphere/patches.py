"""Planes fitted to the points of a scan by maximum likelihood, for noise along the beams."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from registration.gauss_sphere.beams import Fan
from registration.gauss_sphere.params import PatchParams
from registration.gauss_sphere.small_matrices import invert_symmetric3, solve_symmetric3
from registration.kernels import compiled
from registration.scan import BoolArray, FloatArray, IntArray

NARROWEST_MM = 0.1  # standard deviation across a patch


class Patches(NamedTuple):
    """Planes n . p = offset in the scan's frame, structure of arrays, most certain first.

    normal: (m, 3) unit, towards the sensor.  centroid_mm: (m, 3) on the plane.
    offset_mm: (m,).  basis: (m, 2, 3) two unit tangents.
    covariance: (m, 3, 3) of (tilt towards basis 0 in rad, tilt towards basis 1, offset at the
        centroid in mm).
    spread_mm: (m, 2) standard deviation of the points along the basis, which is turned to their
        principal axes.
    n_points: (m,); area_mm2: (m,); chi2: (m,) mean squared residual in standard deviations.
    label: (profiles, pixels) patch of each point, -1 for none.
    """

    normal: FloatArray
    offset_mm: FloatArray
    centroid_mm: FloatArray
    basis: FloatArray
    covariance: FloatArray
    spread_mm: FloatArray
    n_points: IntArray
    area_mm2: FloatArray
    chi2: FloatArray
    label: IntArray


def fit_patches(fan: Fan, label: IntArray, n_patches: int, params: PatchParams) -> Patches:
    """Fit a plane to the points of each label by maximum likelihood for noise along the beams.

    Plain least squares of the distances is biased for planes seen at a slant, because the noise has
    a component along them; here the derivatives are taken at the foot of each point along its beam.
    """
    fitted = Patches(
        normal=np.zeros((n_patches, 3)),
        offset_mm=np.zeros(n_patches),
        centroid_mm=np.zeros((n_patches, 3)),
        basis=np.zeros((n_patches, 2, 3)),
        covariance=np.zeros((n_patches, 3, 3)),
        spread_mm=np.zeros((n_patches, 2)),
        n_points=np.zeros(n_patches, dtype=np.int64),
        area_mm2=np.zeros(n_patches),
        chi2=np.zeros(n_patches),
        label=label.copy(),
    )
    if n_patches:
        _fit_planes(fan, params.gate_sigma, params.fit_rounds, fitted)
    centroid = fitted.centroid_mm + fan.apex_mm * [0.0, 1.0, 1.0]
    good = fitted.n_points >= params.min_points
    order = np.argsort(np.where(good, -fitted.area_mm2, 1.0), kind="stable")[: good.sum()]
    renumber = np.full(n_patches + 1, -1, dtype=np.int64)
    renumber[order] = np.arange(order.size)
    return Patches(
        normal=fitted.normal[order],
        offset_mm=np.einsum("ij,ij->i", fitted.normal[order], centroid[order]),
        centroid_mm=centroid[order],
        basis=fitted.basis[order],
        covariance=fitted.covariance[order],
        spread_mm=fitted.spread_mm[order],
        n_points=fitted.n_points[order],
        area_mm2=fitted.area_mm2[order],
        chi2=fitted.chi2[order],
        label=renumber[fitted.label],
    )


@compiled
def _fit_planes(fan: Fan, gate: float, rounds: int, patches: Patches) -> None:
    """Fill in all of patches from its label, in coordinates whose y and z start at the apex.

    Points farther off than gate standard deviations lose their label.
    """
    label, n_patches = patches.label, patches.offset_mm.size
    starts = np.zeros(n_patches + 1, np.int64)
    for p in range(label.shape[0]):
        for u in range(label.shape[1]):
            if label[p, u] >= 0:
                starts[label[p, u] + 1] += 1
    for i in range(n_patches):
        starts[i + 1] += starts[i]
    filled = starts[:-1].copy()
    row, pixel = np.empty(starts[-1], np.int64), np.empty(starts[-1], np.int64)
    beams = np.empty((4, starts[-1]))
    for p in range(label.shape[0]):
        for u in range(label.shape[1]):
            i = label[p, u]
            if i >= 0:
                j = filled[i]
                filled[i] += 1
                row[j], pixel[j] = p, u
                beams[0, j], beams[1, j] = fan.x_mm[p], fan.slope[p, u]
                beams[2, j], beams[3, j] = fan.depth_mm[p, u], fan.sigma_mm[p, u]
    kept = np.empty(starts[-1], np.bool_)
    area_per_beam = _beam_area(fan)
    for i in range(n_patches):
        a, b = starts[i], starts[i + 1]
        if b - a >= 4:
            _fit_plane(beams[:, a:b], fan.lean, gate, rounds, area_per_beam, patches, i, kept[a:b])
        else:
            kept[a:b] = False
    for j in range(starts[-1]):
        if not kept[j]:
            label[row[j], pixel[j]] = -1


@compiled
def _beam_area(fan: Fan) -> float:
    """What a beam stands for in profile spacing times slope: a nearly constant one will do."""
    low, high = np.inf, -np.inf
    for u in range(fan.column_slope.size):
        low, high = min(low, fan.column_slope[u]), max(high, fan.column_slope[u])
    rows, columns = fan.depth_mm.shape
    beams = max((rows - 1) * (columns - 1), 1)
    return float(abs((high - low) * (fan.x_mm[-1] - fan.x_mm[0])) / beams)


@compiled
def _first_plane(beams: FloatArray, lean: FloatArray, plane: FloatArray) -> None:
    """Least squares of q = A + B s + C (x - x0) q, q the inverse depth, x0 the mean x.

    That is in the coordinates of the profiles; the plane is then sheared into the scan's frame.

    plane: (4,) out, unit normal towards the sensor and offset.
    """
    x0 = beams[0].mean()
    g, solution = np.zeros((3, 4)), np.zeros(3)
    for j in range(beams.shape[1]):
        s, q = beams[1, j], 1.0 / beams[2, j]
        v = (beams[0, j] - x0) * q
        w = (beams[2, j] * beams[2, j] / beams[3, j]) ** 2
        g[0, 0] += w
        g[0, 1] += w * s
        g[0, 2] += w * v
        g[1, 1] += w * s * s
        g[1, 2] += w * s * v
        g[2, 2] += w * v * v
        g[0, 3] += w * q
        g[1, 3] += w * s * q
        g[2, 3] += w * v * q
    solve_symmetric3(g, solution)
    # 1 = A (z - lean_z x) + B (y - lean_y x) + C (x - x0)
    across = solution[2] - lean[0] * solution[1] - lean[1] * solution[0]
    size = np.sqrt(solution[0] ** 2 + solution[1] ** 2 + across**2)
    plane[0], plane[1], plane[2] = -across / size, -solution[1] / size, -solution[0] / size
    plane[3] = -(1.0 + solution[2] * x0) / size


@compiled
def _fit_plane(
    beams: FloatArray,
    lean: FloatArray,
    gate: float,
    rounds: int,
    area_per_beam: float,
    out: Patches,
    i: int,
    kept: BoolArray,
) -> None:
    """Fit patch i to its beams (4, n): x, slope, depth and standard deviation."""
    n = beams.shape[1]
    plane, g, step = np.zeros(4), np.zeros((3, 4)), np.zeros(3)
    moments = np.zeros(8)
    _first_plane(beams, lean, plane)
    mean_x, mean_y, mean_z = beams[0].mean(), (beams[1] * beams[2]).mean(), beams[2].mean()
    mean_y, mean_z = mean_y + lean[0] * mean_x, mean_z + lean[1] * mean_x
    centre, e, f = out.centroid_mm[i], out.basis[i, 0], out.basis[i, 1]
    # The first tangent across the line of motion, the second along it: turned at the end.
    e[0], e[1], e[2] = 0.0, -plane[2], plane[1]
    for _ in range(rounds):
        n0, n1, n2 = plane[0], plane[1], plane[2]
        n_travel = n0 + n1 * lean[0] + n2 * lean[1]
        away = plane[3] - (n0 * mean_x + n1 * mean_y + n2 * mean_z)
        centre[0], centre[1], centre[2] = mean_x + away * n0, mean_y + away * n1, mean_z + away * n2
        along = e[0] * n0 + e[1] * n1 + e[2] * n2
        e[0], e[1], e[2] = e[0] - along * n0, e[1] - along * n1, e[2] - along * n2
        size = np.sqrt(e[0] * e[0] + e[1] * e[1] + e[2] * e[2])
        e[0], e[1], e[2] = e[0] / size, e[1] / size, e[2] / size
        f[0], f[1], f[2] = n1 * e[2] - n2 * e[1], n2 * e[0] - n0 * e[2], n0 * e[1] - n1 * e[0]
        g[:] = 0.0
        moments[:] = 0.0
        for j in range(n):
            x, s, d = beams[0, j], beams[1, j], beams[2, j]
            nb = n1 * s + n2
            residual = n_travel * x + nb * d - plane[3]
            deviation = beams[3, j] * abs(nb)
            kept[j] = nb < 0.0 and abs(residual) <= gate * deviation
            if not kept[j]:
                continue
            foot = d - residual / nb
            v0 = x - centre[0]
            v1, v2 = s * foot + lean[0] * x - centre[1], foot + lean[1] * x - centre[2]
            a = e[0] * v0 + e[1] * v1 + e[2] * v2
            b = f[0] * v0 + f[1] * v1 + f[2] * v2
            w = 1.0 / (deviation * deviation)
            g[0, 0] += w * a * a
            g[0, 1] += w * a * b
            g[0, 2] -= w * a
            g[1, 1] += w * b * b
            g[1, 2] -= w * b
            g[2, 2] += w
            g[0, 3] -= w * a * residual
            g[1, 3] -= w * b * residual
            g[2, 3] += w * residual
            moments[0] += 1.0
            moments[1] += a
            moments[2] += b
            moments[3] += a * a
            moments[4] += a * b
            moments[5] += b * b
            moments[6] += w * residual * residual
            moments[7] -= foot / nb
        if moments[0] < 4.0 or _narrow(moments):
            kept[:] = False
            return
        solve_symmetric3(g, step)
        for t in range(3):
            plane[t] += step[0] * e[t] + step[1] * f[t]
        # The offset moves at the centre, about which the plane tilts.
        plane[3] = plane[0] * centre[0] + plane[1] * centre[1] + plane[2] * centre[2] + step[2]
        size = np.sqrt(plane[0] ** 2 + plane[1] ** 2 + plane[2] ** 2)
        plane /= size
    out.normal[i] = plane[:3]
    out.offset_mm[i] = plane[3]
    out.n_points[i] = int(moments[0])
    out.chi2[i] = moments[6] / moments[0]
    out.area_mm2[i] = moments[7] * area_per_beam
    _summarise(moments, g, plane, out, i)


@compiled
def _narrow(moments: FloatArray) -> bool:
    """Whether the points lie on a line, which leaves the tilt of their plane open."""
    n = moments[0]
    vaa = moments[3] / n - (moments[1] / n) ** 2
    vab = moments[4] / n - moments[1] * moments[2] / n**2
    vbb = moments[5] / n - (moments[2] / n) ** 2
    middle, half = 0.5 * (vaa + vbb), 0.5 * (vaa - vbb)
    return bool(middle - np.sqrt(half * half + vab * vab) < NARROWEST_MM * NARROWEST_MM)


@compiled
def _summarise(moments: FloatArray, g: FloatArray, plane: FloatArray, out: Patches, i: int) -> None:
    """Centroid, principal axes and the covariance about them."""
    centre, e, f = out.centroid_mm[i], out.basis[i, 0], out.basis[i, 1]
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
    out.spread_mm[i, 0] = np.sqrt(max(c * c * vaa + 2.0 * c * s * vab + s * s * vbb, 0.0))
    out.spread_mm[i, 1] = np.sqrt(max(s * s * vaa - 2.0 * c * s * vab + c * c * vbb, 0.0))
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
    invert_symmetric3(information, out.covariance[i])
