"""Planes fitted to the points of a scan by maximum likelihood, for noise along the beams."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from registration.gauss_sphere.beams import Fan
from registration.gauss_sphere.params import PatchParams
from registration.gauss_sphere.small_matrices import invert_symmetric3, solve_symmetric3
from registration.kernels import compiled
from registration.scan import FloatArray, IntArray


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
def _first_planes(fan: Fan, label: IntArray, normal: FloatArray, offset: FloatArray) -> None:
    """Least squares of q = A + B s + C (x - x0) q, with the profiles' mean as x0."""
    x, slope, depth, sigma = fan.x_mm, fan.slope, fan.depth_mm, fan.sigma_mm
    m = normal.shape[0]
    mean_x, n = np.zeros(m), np.zeros(m)
    for p in range(depth.shape[0]):
        for u in range(depth.shape[1]):
            i = label[p, u]
            if i >= 0:
                mean_x[i] += x[p]
                n[i] += 1.0
    mean_x /= np.maximum(n, 1.0)
    g = np.zeros((m, 3, 4))
    for p in range(depth.shape[0]):
        for u in range(depth.shape[1]):
            i = label[p, u]
            if i >= 0:
                q, s = 1.0 / depth[p, u], slope[p, u]
                v = (x[p] - mean_x[i]) * q
                w = depth[p, u] ** 4 / sigma[p, u] ** 2
                g[i, 0, 0] += w
                g[i, 0, 1] += w * s
                g[i, 0, 2] += w * v
                g[i, 1, 1] += w * s * s
                g[i, 1, 2] += w * s * v
                g[i, 2, 2] += w * v * v
                g[i, 0, 3] += w * q
                g[i, 1, 3] += w * s * q
                g[i, 2, 3] += w * v * q
    solution = np.zeros(3)
    for i in range(m):
        solve_symmetric3(g[i], solution)
        a, b, c = solution
        # 1 = a z + b y + c (x - x0)
        scale = np.sqrt(a * a + b * b + c * c)
        if scale > 0.0:
            normal[i, 0], normal[i, 1], normal[i, 2] = -c / scale, -b / scale, -a / scale
            offset[i] = -(1.0 + c * mean_x[i]) / scale


@compiled
def _fit_planes(fan: Fan, gate: float, rounds: int, patches: Patches) -> None:
    """Fill in all of patches from its label, in coordinates whose y and z start at the apex."""
    x, slope, depth, sigma = fan.x_mm, fan.slope, fan.depth_mm, fan.sigma_mm
    label, normal, offset = patches.label, patches.normal, patches.offset_mm
    centroid, basis = patches.centroid_mm, patches.basis
    m = normal.shape[0]
    _first_planes(fan, label, normal, offset)
    sums = np.zeros((m, 12))
    g = np.zeros((m, 3, 4))
    step, information = np.zeros(3), np.zeros((3, 3))
    for r in range(rounds):
        last = r == rounds - 1
        # Where the plane lies in the middle of its points, and two tangents there.
        sums[:] = 0.0
        for p in range(depth.shape[0]):
            for u in range(depth.shape[1]):
                i = label[p, u]
                if i >= 0:
                    sums[i, 0] += 1.0
                    sums[i, 1] += x[p]
                    sums[i, 2] += slope[p, u] * depth[p, u]
                    sums[i, 3] += depth[p, u]
        for i in range(m):
            n = max(sums[i, 0], 1.0)
            n0, n1, n2 = normal[i]
            c0, c1, c2 = sums[i, 1] / n, sums[i, 2] / n, sums[i, 3] / n
            h = offset[i] - (n0 * c0 + n1 * c1 + n2 * c2)
            centroid[i, 0], centroid[i, 1], centroid[i, 2] = c0 + h * n0, c1 + h * n1, c2 + h * n2
            if r == 0:
                length = np.sqrt(n1 * n1 + n2 * n2)
                if length < 1e-6:
                    basis[i, 0, 0], basis[i, 0, 1], basis[i, 0, 2] = 0.0, 1.0, 0.0
                else:
                    basis[i, 0, 0] = 0.0
                    basis[i, 0, 1], basis[i, 0, 2] = -n2 / length, n1 / length
            else:
                e = basis[i, 0]
                along = e[0] * n0 + e[1] * n1 + e[2] * n2
                e[0], e[1], e[2] = e[0] - along * n0, e[1] - along * n1, e[2] - along * n2
                length = np.sqrt(e[0] * e[0] + e[1] * e[1] + e[2] * e[2])
                e[0], e[1], e[2] = e[0] / length, e[1] / length, e[2] / length
            e, f = basis[i, 0], basis[i, 1]
            f[0], f[1], f[2] = n1 * e[2] - n2 * e[1], n2 * e[0] - n0 * e[2], n0 * e[1] - n1 * e[0]
        g[:] = 0.0
        sums[:] = 0.0
        for p in range(depth.shape[0]):
            for u in range(depth.shape[1]):
                i = label[p, u]
                if i < 0:
                    continue
                s, d = slope[p, u], depth[p, u]
                n0, n1, n2 = normal[i]
                nb = n1 * s + n2
                res = n0 * x[p] + nb * d - offset[i]
                sd = sigma[p, u] * abs(nb)
                if nb >= 0.0 or abs(res) > gate * sd:
                    if last:
                        label[p, u] = -1
                    continue
                foot = d - res / nb
                v0 = x[p] - centroid[i, 0]
                v1 = s * foot - centroid[i, 1]
                v2 = foot - centroid[i, 2]
                a = basis[i, 0, 0] * v0 + basis[i, 0, 1] * v1 + basis[i, 0, 2] * v2
                b = basis[i, 1, 0] * v0 + basis[i, 1, 1] * v1 + basis[i, 1, 2] * v2
                w = 1.0 / (sd * sd)
                g[i, 0, 0] += w * a * a
                g[i, 0, 1] += w * a * b
                g[i, 0, 2] -= w * a
                g[i, 1, 1] += w * b * b
                g[i, 1, 2] -= w * b
                g[i, 2, 2] += w
                g[i, 0, 3] -= w * a * res
                g[i, 1, 3] -= w * b * res
                g[i, 2, 3] += w * res
                if last:
                    sums[i, 0] += 1.0
                    sums[i, 1] += a
                    sums[i, 2] += b
                    sums[i, 3] += a * a
                    sums[i, 4] += a * b
                    sums[i, 5] += b * b
                    sums[i, 6] += w * res * res
                    sums[i, 7] += foot / abs(nb)
        for i in range(m):
            if g[i, 2, 2] <= 0.0:
                continue
            solve_symmetric3(g[i], step)
            at = normal[i, 0] * centroid[i, 0] + normal[i, 1] * centroid[i, 1]
            at += normal[i, 2] * centroid[i, 2]
            at += step[2]
            size = 0.0
            for t in range(3):
                normal[i, t] += step[0] * basis[i, 0, t] + step[1] * basis[i, 1, t]
                size += normal[i, t] ** 2
            size = np.sqrt(size)
            moved = 0.0
            for t in range(3):
                # The foot of the old centroid on the new plane; the tilt is about the centroid.
                moved += step[0] * basis[i, 0, t] * centroid[i, t]
                moved += step[1] * basis[i, 1, t] * centroid[i, t]
                normal[i, t] /= size
            offset[i] = (at + moved) / size
    # A nearly constant spacing of the beams is enough for an area.
    low, high = np.inf, -np.inf
    for p in range(depth.shape[0]):
        for u in range(depth.shape[1]):
            if np.isfinite(depth[p, u]):
                low, high = min(low, slope[p, u]), max(high, slope[p, u])
    ds = (high - low) / max(depth.shape[1] - 1, 1)
    dx = abs(x[-1] - x[0]) / max(x.size - 1, 1)
    for i in range(m):
        patches.n_points[i] = int(sums[i, 0])
        if patches.n_points[i] < 4:
            continue
        n = sums[i, 0]
        ma, mb = sums[i, 1] / n, sums[i, 2] / n
        vaa, vab, vbb = sums[i, 3] / n - ma * ma, sums[i, 4] / n - ma * mb, sums[i, 5] / n - mb * mb
        patches.chi2[i] = sums[i, 6] / n
        patches.area_mm2[i] = sums[i, 7] * ds * dx
        # Information about the mean of the points, then turned to their principal axes.
        for t in range(3):
            centroid[i, t] += ma * basis[i, 0, t] + mb * basis[i, 1, t]
        at = offset[i]
        for t in range(3):
            at -= normal[i, t] * centroid[i, t]
        for t in range(3):
            centroid[i, t] += at * normal[i, t]
        w = g[i, 2, 2]
        wa, wb = -g[i, 0, 2] - w * ma, -g[i, 1, 2] - w * mb
        waa = g[i, 0, 0] + 2.0 * ma * g[i, 0, 2] + w * ma * ma
        wbb = g[i, 1, 1] + 2.0 * mb * g[i, 1, 2] + w * mb * mb
        wab = g[i, 0, 1] + ma * g[i, 1, 2] + mb * g[i, 0, 2] + w * ma * mb
        turn = 0.5 * np.arctan2(2.0 * vab, vaa - vbb)
        c, s = np.cos(turn), np.sin(turn)
        for t in range(3):
            e, f = basis[i, 0, t], basis[i, 1, t]
            basis[i, 0, t], basis[i, 1, t] = c * e + s * f, c * f - s * e
        patches.spread_mm[i, 0] = np.sqrt(max(c * c * vaa + 2.0 * c * s * vab + s * s * vbb, 0.0))
        patches.spread_mm[i, 1] = np.sqrt(max(s * s * vaa - 2.0 * c * s * vab + c * c * vbb, 0.0))
        o = information
        o[0, 0] = c * c * waa + 2.0 * c * s * wab + s * s * wbb
        o[1, 1] = s * s * waa - 2.0 * c * s * wab + c * c * wbb
        o[0, 1] = c * s * (wbb - waa) + (c * c - s * s) * wab
        o[0, 2], o[1, 2], o[2, 2] = -(c * wa + s * wb), -(c * wb - s * wa), w
        o[1, 0], o[2, 0], o[2, 1] = o[0, 1], o[0, 2], o[1, 2]
        invert_symmetric3(information, patches.covariance[i])
