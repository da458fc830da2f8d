"""One plane fitted to its beams by maximum likelihood, for noise along the beams."""

from __future__ import annotations

import numpy as np

from registration.gauss_sphere.fan.calibrated import BLOCK, DEPTH, SIGMA, SLOPE, Known, X, take_bias
from registration.gauss_sphere.planes.rough_plane import first_plane
from registration.gauss_sphere.small_matrices import solve_symmetric3
from registration.kernels import compiled
from registration.scan import BoolArray, FloatArray

NARROWEST_MM = 0.1  # standard deviation across a patch
TILT_RAD = 1e-3  # by which a plane is tilted to see how its bias follows
PROBED = 64  # beams of a sample that tell it
# Points of other planes in the sample put a plane to where some of them belong to it. This is told
# by the square of the last step on all beams, in variances: 3 times the beams over those of the
# sample is usual, three times as much is far; or by the share of beams that do not belong. Up to so
# many more steps are taken, as long as one is far.
FAR2, MOST_LEFT_OUT, MORE_ROUNDS = 9.0, 0.015, 2
LEAST_REST = 0.25  # determinant of what a tilt leaves of itself when the bias has followed it


@compiled
def fit_plane(
    beams: FloatArray,
    sample: FloatArray,
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
    """Fit a plane to its beams (5, n), after one step on a sample (5, m); whether there is one.

    kept: (n,) out, beams within gate standard deviations.  plane: (4,) out, unit normal and offset.
    centre, e, f: (3,) out, a point of the plane and two tangents of it.  g: (3, 4) out, normal
    equations of (tilt towards e, towards f, offset at the centre).  moments: (7,) out, number, sums
    of a, b, a^2, a b, b^2 along e and f, and what the area is made of.
    """
    step, following = np.zeros(3), np.zeros((3, 2))
    sample_kept = np.empty(sample.shape[1], np.bool_)
    follows = known.given and not known.lateral and beams.shape[1] > sample.shape[1]
    first_plane(sample, lean, plane)
    mean_x, mean_y, mean_z = sample[X].mean(), 0.0, sample[DEPTH].mean()
    for j in range(sample.shape[1]):
        mean_y += sample[SLOPE, j] * sample[DEPTH, j]
    mean_y = mean_y / sample.shape[1] + lean[0] * mean_x
    mean_z += lean[1] * mean_x
    # The first tangent across the line of motion, the second along it.
    e[0], e[1], e[2] = 0.0, -plane[2], plane[1]
    turn, last = 0, rounds
    while turn <= last:
        # The first step on the sample alone: it finds which points do not belong.
        used, used_kept = (sample, sample_kept) if turn == 0 else (beams, kept)
        if known.given:
            take_bias(used, plane, apex_z_mm, known)
        n0, n1, n2 = plane[0], plane[1], plane[2]
        away = plane[3] - (n0 * mean_x + n1 * mean_y + n2 * mean_z)
        centre[0], centre[1], centre[2] = mean_x + away * n0, mean_y + away * n1, mean_z + away * n2
        _turn_tangents(plane, e, f)
        outlined = turn == 0 or turn == last
        _normal_equations(used, lean, plane, centre, e, f, gate, used_kept, outlined, g, moments)
        if moments[0] < 4.0 or (outlined and _narrow(moments)):
            return False
        solve_symmetric3(g, step)
        moved2 = step[0] * g[0, 3] + step[1] * g[1, 3] + step[2] * g[2, 3]
        if turn == last and last < rounds + MORE_ROUNDS:
            n, of_sample = beams.shape[1], sample.shape[1]
            last += _is_unsettled(moved2, moments[0], n, of_sample, turn > rounds)
        if follows and turn == 0:
            some = sample[:, :PROBED].copy()
            _take_following(
                some, lean, apex_z_mm, known, gate, plane, centre, e, f, following
            )  # fmt: skip
        if follows:
            let_follow(following, step)
        for t in range(3):
            plane[t] += step[0] * e[t] + step[1] * f[t]
        # The offset moves at the centre, about which the plane tilts.
        plane[3] = plane[0] * centre[0] + plane[1] * centre[1] + plane[2] * centre[2] + step[2]
        size = np.sqrt(plane[0] ** 2 + plane[1] ** 2 + plane[2] ** 2)
        plane /= size
        turn += 1
    _turn_tangents(plane, e, f)
    return True


@compiled
def _is_unsettled(moved2: float, n_kept: float, n: int, of_sample: int, again: bool) -> bool:
    """Whether other beams may belong after the last of the steps, or after one more."""
    if again:
        return moved2 > FAR2
    return bool(moved2 > FAR2 * n / of_sample or n_kept < (1.0 - MOST_LEFT_OUT) * n)


@compiled
def _turn_tangents(plane: FloatArray, e: FloatArray, f: FloatArray) -> None:
    """Turn two tangents of a plane that was tilted back into it."""
    n0, n1, n2 = plane[0], plane[1], plane[2]
    along = e[0] * n0 + e[1] * n1 + e[2] * n2
    e[0], e[1], e[2] = e[0] - along * n0, e[1] - along * n1, e[2] - along * n2
    size = np.sqrt(e[0] * e[0] + e[1] * e[1] + e[2] * e[2])
    e[0], e[1], e[2] = e[0] / size, e[1] / size, e[2] / size
    f[0], f[1], f[2] = n1 * e[2] - n2 * e[1], n2 * e[0] - n0 * e[2], n0 * e[1] - n1 * e[0]


@compiled
def _take_following(
    beams: FloatArray,
    lean: FloatArray,
    apex_z_mm: float,
    known: Known,
    gate: float,
    plane: FloatArray,
    centre: FloatArray,
    e: FloatArray,
    f: FloatArray,
    following: FloatArray,
) -> None:
    """What a tilt changes in the step that the beams (5, n) ask for, as their bias follows it.

    following: (3, 2) out, change of the step in (tilt towards e, towards f, offset) by a tilt
    towards e, and by one towards f.
    """
    n, before = beams.shape[1], beams[DEPTH].copy()
    terms, kept, moved = np.empty((5, n)), np.empty(n, np.bool_), np.empty((2, n))
    _terms(beams, 0, lean, plane, centre, e, f, gate, kept, terms)
    tilted, row, change = np.empty(4), np.ones(3), np.empty(3)
    for v in range(2):
        tangent = e if v == 0 else f
        for t in range(3):
            tilted[t] = plane[t] + TILT_RAD * tangent[t]
        take_bias(beams, tilted, apex_z_mm, known)
        for j in range(n):
            along = plane[1] * beams[SLOPE, j] + plane[2]
            moved[v, j] = along * (beams[DEPTH, j] - before[j]) / TILT_RAD
    g, pull = np.zeros((3, 4)), np.zeros((2, 3))
    for j in range(n):
        if kept[j]:
            row[0], row[1] = -terms[1, j], -terms[2, j]
            for t in range(3):
                weighted = terms[0, j] * row[t]
                for v in range(t, 3):
                    g[t, v] += weighted * row[v]
                for v in range(2):
                    pull[v, t] += weighted * moved[v, j]
    for v in range(2):
        g[:, 3] = pull[v]
        solve_symmetric3(g, change)
        following[:, v] = change


@compiled
def let_follow(following: FloatArray, step: FloatArray) -> None:
    """Lengthen a step to where it ends when the bias has followed it.

    A bias that follows nearly as far as the plane tilts has no such place, nor has one that follows
    farther: both leave the step as it is.
    """
    a, b = 1.0 - following[0, 0], -following[0, 1]
    c, d = -following[1, 0], 1.0 - following[1, 1]
    det = a * d - b * c
    if det < LEAST_REST or a <= 0.0 or d <= 0.0:
        return
    u, v = (d * step[0] - b * step[1]) / det, (a * step[1] - c * step[0]) / det
    step[0], step[1] = u, v
    step[2] += following[2, 0] * u + following[2, 1] * v


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
    w_, wa, wb, waa, wab, wbb, wr, war, wbr = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
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
    moments[6] = area


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
