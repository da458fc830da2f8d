"""One plane fitted to its beams by maximum likelihood, for noise along the beams."""

from __future__ import annotations

import numpy as np

from registration.gauss_sphere.calibrated import BLOCK, DEPTH, SIGMA, SLOPE, Known, X, take_bias
from registration.gauss_sphere.small_matrices import invert_symmetric3, solve_symmetric3
from registration.kernels import compiled
from registration.scan import BoolArray, FloatArray

NARROWEST_MM = 0.1  # standard deviation across a patch
GOLDEN_RATIO = 0.6180339887498949
SAMPLE = 128  # beams of a plane that are enough to start from


@compiled
def first_plane(beams: FloatArray, lean: FloatArray, plane: FloatArray) -> None:
    """Least squares of q = A + B s + C (x - x0) q, q the inverse depth, x0 the mean x.

    That is in the coordinates of the profiles; the plane is then sheared into the scan's frame.

    plane: (4,) out, unit normal towards the sensor and offset, y and z from the apex.
    """
    x0 = beams[X].mean()
    g, solution = np.zeros((3, 4)), np.zeros(3)
    for j in range(beams.shape[1]):
        s, d = beams[SLOPE, j], beams[DEPTH, j]
        q = 1.0 / d
        v = (beams[X, j] - x0) * q
        w = (d * d / beams[SIGMA, j]) ** 2
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
def sample_of(beams: FloatArray) -> FloatArray:
    """(5, m) some of the beams (5, n) of a plane, spread over it."""
    n = beams.shape[1]
    sample = np.empty((5, min(n, SAMPLE)))
    for k in range(sample.shape[1]):
        j = _sampled(k, n)
        for row in range(beams.shape[0]):
            sample[row, k] = beams[row, j]
    return sample


@compiled
def _sampled(k: int, n: int) -> int:
    """Index of the k-th sample of n points."""
    # Multiples of the golden ratio fall everywhere; even steps could follow one column.
    return k if n <= SAMPLE else int((k + 0.5) * GOLDEN_RATIO % 1.0 * n)


@compiled
def fit_plane(
    beams: FloatArray,
    lean: FloatArray,
    apex_z_mm: float,
    known: Known,
    gate: float,
    rounds: int,
    kept: BoolArray,
    plane: FloatArray,
    centre: FloatArray,
    e: FloatArray,
    f: FloatArray,
    g: FloatArray,
    moments: FloatArray,
) -> bool:
    """Fit a plane to its beams (5, n); whether there is one.

    kept: (n,) out, beams within gate standard deviations.  plane: (4,) out, unit normal and offset.
    centre, e, f: (3,) out, a point of the plane and two tangents of it.  g: (3, 4) out, normal
    equations of (tilt towards e, towards f, offset at the centre).  moments: (8,) out, number, sums
    of a, b, a^2, a b, b^2 along e and f, chi-square, and what the area is made of.
    """
    step, sample = np.zeros(3), sample_of(beams)
    sample_kept = np.empty(sample.shape[1], np.bool_)
    first_plane(sample, lean, plane)
    mean_x, mean_y, mean_z = sample[X].mean(), 0.0, sample[DEPTH].mean()
    for j in range(sample.shape[1]):
        mean_y += sample[SLOPE, j] * sample[DEPTH, j]
    mean_y = mean_y / sample.shape[1] + lean[0] * mean_x
    mean_z += lean[1] * mean_x
    # The first tangent across the line of motion, the second along it.
    e[0], e[1], e[2] = 0.0, -plane[2], plane[1]
    for turn in range(rounds + 1):
        # The first step on the sample alone: it finds which points do not belong.
        used, used_kept = (sample, sample_kept) if turn == 0 else (beams, kept)
        if known.given:
            take_bias(used, plane, apex_z_mm, known)
        n0, n1, n2 = plane[0], plane[1], plane[2]
        away = plane[3] - (n0 * mean_x + n1 * mean_y + n2 * mean_z)
        centre[0], centre[1], centre[2] = mean_x + away * n0, mean_y + away * n1, mean_z + away * n2
        along = e[0] * n0 + e[1] * n1 + e[2] * n2
        e[0], e[1], e[2] = e[0] - along * n0, e[1] - along * n1, e[2] - along * n2
        size = np.sqrt(e[0] * e[0] + e[1] * e[1] + e[2] * e[2])
        e[0], e[1], e[2] = e[0] / size, e[1] / size, e[2] / size
        f[0], f[1], f[2] = n1 * e[2] - n2 * e[1], n2 * e[0] - n0 * e[2], n0 * e[1] - n1 * e[0]
        outlined = turn == 0 or turn == rounds
        _normal_equations(used, lean, plane, centre, e, f, gate, used_kept, outlined, g, moments)
        if moments[0] < 4.0 or (outlined and _narrow(moments)):
            return False
        solve_symmetric3(g, step)
        for t in range(3):
            plane[t] += step[0] * e[t] + step[1] * f[t]
        # The offset moves at the centre, about which the plane tilts.
        plane[3] = plane[0] * centre[0] + plane[1] * centre[1] + plane[2] * centre[2] + step[2]
        size = np.sqrt(plane[0] ** 2 + plane[1] ** 2 + plane[2] ** 2)
        plane /= size
    return True


@compiled
def _normal_equations(
    beams: FloatArray,
    lean: FloatArray,
    plane: FloatArray,
    centre: FloatArray,
    e: FloatArray,
    f: FloatArray,
    gate: float,
    kept: BoolArray,
    outlined: bool,
    g: FloatArray,
    moments: FloatArray,
) -> None:
    """Fill in kept, g and moments as fit_plane gives them; not outlined, only their number."""
    terms = np.empty((5, min(kept.size, BLOCK)))
    w_, wa, wb, waa, wab, wbb, wr, war, wbr, wrr = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    count, sa, sb, saa, sab, sbb, area = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for first in range(0, kept.size, BLOCK):
        within = kept[first : first + BLOCK]
        _terms(beams, first, lean, plane, centre, e, f, gate, within, terms)
        for j in range(within.size):
            if not within[j]:
                continue
            w, a, b, residual = terms[0, j], terms[1, j], terms[2, j], terms[3, j]
            w_ += w
            wa += w * a
            wb += w * b
            waa += w * a * a
            wab += w * a * b
            wbb += w * b * b
            wr += w * residual
            war += w * a * residual
            wbr += w * b * residual
            wrr += w * residual * residual
        count += within.sum()
        if not outlined:
            continue
        for j in range(within.size):
            if within[j]:
                a, b = terms[1, j], terms[2, j]
                sa += a
                sb += b
                saa += a * a
                sab += a * b
                sbb += b * b
                area += terms[4, j]
    g[0, 0], g[0, 1], g[0, 2], g[0, 3] = waa, wab, -wa, -war
    g[1, 1], g[1, 2], g[1, 3] = wbb, -wb, -wbr
    g[2, 2], g[2, 3] = w_, wr
    moments[0], moments[1], moments[2] = count, sa, sb
    moments[3], moments[4], moments[5] = saa, sab, sbb
    moments[6], moments[7] = wrr, area


@compiled
def _terms(
    beams: FloatArray,
    first: int,
    lean: FloatArray,
    plane: FloatArray,
    centre: FloatArray,
    e: FloatArray,
    f: FloatArray,
    gate: float,
    kept: BoolArray,
    terms: FloatArray,
) -> None:
    """Weight, foot along e and along f, residual and area of beams from the first on.

    Apart from their sums, because this runs on vectors of points.
    kept: (m,) out, of as many beams those within the gate.  terms: (5, m or more) out.
    """
    n0, n1, n2, offset = plane[0], plane[1], plane[2], plane[3]
    lean_y, lean_z = lean[0], lean[1]
    n_travel = n0 + n1 * lean_y + n2 * lean_z
    c0, c1, c2 = centre[0], centre[1], centre[2]
    e0, e1, e2, f0, f1, f2 = e[0], e[1], e[2], f[0], f[1], f[2]
    gate2, last = gate * gate, first + kept.size
    xs, slopes, depths = beams[X, first:last], beams[SLOPE, first:last], beams[DEPTH, first:last]
    sigmas = beams[SIGMA, first:last]
    for j in range(kept.size):
        x, s, d = xs[j], slopes[j], depths[j]
        nb = n1 * s + n2
        residual = n_travel * x + nb * d - offset
        deviation = sigmas[j] * nb
        w = 1.0 / (deviation * deviation)
        kept[j] = (nb < 0.0) & (residual * residual * w <= gate2)
        across = 1.0 / nb
        foot = d - residual * across
        v0, v1, v2 = x - c0, s * foot + lean_y * x - c1, foot + lean_z * x - c2
        terms[0, j] = w
        terms[1, j] = e0 * v0 + e1 * v1 + e2 * v2
        terms[2, j] = f0 * v0 + f1 * v1 + f2 * v2
        terms[3, j] = residual
        terms[4, j] = -foot * across


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
def about_centroid(
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
