"""Profiles moved in depth against their neighbours, as where the sensor trembles, moved back.

Along one beam the depth of a plane is linear in the place of the profile, so second differences
from profile to profile vanish. What all beams of a profile have of them in common is its own move.
"""

from __future__ import annotations

import itertools

import numpy as np
from scipy.linalg import solveh_banded

from registration.gauss_sphere.spread import spread_over
from registration.kernels import compiled
from registration.scan import FloatArray, IntArray

LEAST_BEAMS = 20  # that a profile and its neighbours have in common
FEW, STRIDE = 24, 4  # profiles that tell whether more are looked at, and of how many beams one
# Times as much as the noise of the beams makes, squared, at first and by all profiles. Rows of
# things along the profile reach that, too; but not all over it alike, or in most profiles.
MAYBE, SURELY = 2.0, 5.0
SECTIONS, ALIKE, EVEN = 4, 1.5, 0.15
FAR_OFF = 6.0  # times the usual second difference: there a face ends
OUTLYING = 5.0  # times the usual move of a profile: a crease lies along it
TURNS = 2
FAINT_MM = 0.02  # moves that no sensor would show
MEDIAN_OF_SQUARES = 0.455  # of a normal deviate
MEDIAN_TO_SIGMA, MEDIAN_TO_MEAN = 1.4826, 1.2533  # of deviations; how much less exact it is


def moves_of_profiles(x_mm: FloatArray, depth_mm: FloatArray) -> FloatArray | None:
    """(profiles,) by how much each profile lies too deep, in mm, or None where they lie still.

    What neighbours do not tell, as a slow swaying, is left, and so is what hardly shows.

    x_mm: (profiles,) rising or falling; depth_mm: (profiles, pixels), NaN where nothing returned.
    """
    inner = max(x_mm.size - 2, 0)
    if _unrest(x_mm, depth_mm, spread_over(inner, FEW), STRIDE) < MAYBE:
        return None
    if _unrest(x_mm, depth_mm, np.arange(inner), 1) < SURELY or not _is_common(x_mm, depth_mm):
        return None
    moves_mm = np.zeros(x_mm.size)
    for _ in range(TURNS):
        moves_mm += _moves(x_mm, depth_mm - moves_mm[:, None])
    return moves_mm


def _moves(x_mm: FloatArray, depth_mm: FloatArray) -> FloatArray:
    """The likeliest moves, each of them small by itself, by banded normal equations."""
    common, error, share = _common_bends(x_mm, depth_mm, np.arange(x_mm.size - 2), 1)
    told = np.isfinite(common) & (error > 0.0)
    if not told.any():
        return np.zeros(x_mm.size)
    told &= np.abs(common) <= OUTLYING * MEDIAN_TO_SIGMA * np.median(np.abs(common[told]))
    size = 1.0 + share**2 + (1.0 - share) ** 2
    excess = (common[told] ** 2 - error[told] ** 2) / size[told]
    if not excess.size or excess.mean() <= 0.0:
        return np.zeros(x_mm.size)
    weight, bend = np.where(told, 1.0 / error**2, 0.0), np.where(told, common, 0.0)
    rows = np.stack([share - 1.0, np.ones_like(share), -share])  # of profiles p - 1, p, p + 1
    n, gradient = x_mm.size, np.zeros(x_mm.size)
    banded = np.zeros((3, n))  # upper form: the diagonal last
    banded[2] = 1.0 / excess.mean()
    for i in range(3):
        gradient[i : n - 2 + i] += weight * rows[i] * bend
        for k in range(i, 3):
            banded[2 - (k - i), k : n - 2 + k] += weight * rows[i] * rows[k]
    moves_mm: FloatArray = solveh_banded(banded, gradient)
    return moves_mm


def _is_common(x_mm: FloatArray, depth_mm: FloatArray) -> bool:
    """Whether profiles move alike all over their width, and most of them do."""
    every = np.arange(x_mm.size - 2)
    of_section = [
        _common_bends(x_mm, np.ascontiguousarray(section), every, 1)[0]
        for section in np.array_split(depth_mm, SECTIONS, axis=1)
    ]
    alike = [
        np.median(np.abs(a - b)[told]) <= ALIKE * np.median(np.abs([a[told], b[told]]))
        for a, b in itertools.combinations(of_section, 2)
        if 2 * np.count_nonzero(told := np.isfinite(a + b)) >= every.size
    ]
    common2 = _common_bends(x_mm, depth_mm, every, 1)[0] ** 2
    even = np.nanmedian(common2) >= EVEN * np.nanmean(common2)
    return bool(alike and all(alike) and even)


@compiled
def _unrest(x: FloatArray, depth: FloatArray, chosen: IntArray, stride: int) -> float:
    """How much larger the common second differences are, squared, than the noise of beams makes."""
    common, error, _ = _common_bends(x, depth, chosen, stride)
    told = np.isfinite(common) & (error > 0.0)
    if np.count_nonzero(told) < 4:
        return 0.0
    of_noise = max(np.median(error[told] ** 2), FAINT_MM**2)
    return float(np.median(common[told] ** 2) / (MEDIAN_OF_SQUARES * of_noise))


@compiled
def _common_bends(
    x: FloatArray, depth: FloatArray, chosen: IntArray, stride: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Of each profile but the outer ones (n - 2,): the median over the beams of the depth less
    that between the neighbours, its standard deviation, and how far along between them it lies.

    NaN where few beams tell. chosen: profiles that are looked at; stride: of so many beams one is.
    """
    n = max(x.size - 2, 0)
    common, error, shares = np.full(n, np.nan), np.full(n, np.nan), np.full(n, 0.5)
    bend = np.empty((n, (depth.shape[1] + stride - 1) // stride))
    count = np.zeros(n, np.int64)
    for p in chosen:
        way = x[p + 2] - x[p]
        shares[p] = (x[p + 1] - x[p]) / way if way != 0.0 else 0.5
        if not 0.2 < shares[p] < 0.8:
            continue
        a, b = 1.0 - shares[p], shares[p]
        for u in range(0, depth.shape[1], stride):
            off = depth[p + 1, u] - a * depth[p, u] - b * depth[p + 2, u]
            if np.isfinite(off):
                bend[p, count[p]] = off
                count[p] += 1
    usual = _usual(bend, count)
    for p in chosen:
        near = bend[p, : count[p]]
        near = near[np.abs(near) <= FAR_OFF * usual]
        if near.size * stride >= LEAST_BEAMS:
            common[p] = np.median(near)
            spread = MEDIAN_TO_SIGMA * np.median(np.abs(near - common[p]))
            error[p] = MEDIAN_TO_MEAN * spread / np.sqrt(near.size)
    return common, error, shares


@compiled
def _usual(bend: FloatArray, count: IntArray) -> float:
    """The standard deviation of second differences, by their median."""
    several, n = np.empty(count.sum()), 0
    for p in range(count.size):
        several[n : n + count[p]] = np.abs(bend[p, : count[p]])
        n += count[p]
    return MEDIAN_TO_SIGMA * float(np.median(several)) if n else 0.0
