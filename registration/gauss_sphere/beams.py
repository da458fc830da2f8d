"""A scan seen as the fan of beams that measured it: slopes, inverse depths and their noise.

On a plane the inverse depth of a profile is linear in the slope of the beam, exactly, and the noise
of a triangulating scanner, which grows with the square of the range, is the same everywhere in it.
Straight lines are therefore found there by ordinary regression on a regressor without noise.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from registration.scan import FloatArray, Scan

PARALLEL_APEX_MM = 1e5  # stands for beams that do not meet
DEPTH_BINS = 6
MIN_TRIPLES_PER_BIN = 50
MIN_SIGMA_MM = 0.02


class Fan(NamedTuple):
    """The beams of one view.

    x_mm: (profiles,) position of each profile; apex_mm: (3,) of the first profile, its x included
        in x_mm.
    slope: (profiles, pixels) lateral tangent (y - apex_y) / (z - apex_z), 0 where nothing returned.
    depth_mm: (profiles, pixels) z - apex_z, NaN where nothing returned.
    sigma_mm: (profiles, pixels) standard deviation of the depth along the beam.
    column_slope: (pixels,) the slope of each pixel, increasing or decreasing, NaN if never seen.
    """

    x_mm: FloatArray
    apex_mm: FloatArray
    slope: FloatArray
    depth_mm: FloatArray
    sigma_mm: FloatArray
    column_slope: FloatArray


def fan_of(scan: Scan) -> Fan:
    """Describe a scan by its beams; the apex is estimated when the scan does not carry it."""
    apex_mm = estimate_apex(scan) if scan.apex_mm is None else scan.apex_mm
    n_profiles = scan.points_mm.shape[0]
    valid = scan.valid
    depth_mm = scan.points_mm[..., 2] - apex_mm[2]
    depth_mm = np.where(depth_mm > 0.0, depth_mm, np.nan)
    slope = np.where(valid, (scan.points_mm[..., 1] - apex_mm[1]) / depth_mm, 0.0)
    slope[~np.isfinite(slope)] = 0.0
    counts = valid.sum(axis=1)
    nominal_mm = apex_mm[0] + scan.step_mm * np.arange(n_profiles)
    sums_mm = np.where(valid, scan.points_mm[..., 0], 0.0).sum(axis=1)
    x_mm = np.where(counts > 0, sums_mm / np.maximum(counts, 1), nominal_mm)
    seen = valid.sum(axis=0)
    column_slope = np.where(seen > 0, slope.sum(axis=0) / np.maximum(seen, 1), np.nan)
    return Fan(x_mm, apex_mm, slope, depth_mm, depth_noise(depth_mm, slope), column_slope)


def estimate_apex(scan: Scan) -> FloatArray:
    """Find where the beams meet from points whose noise lies along their beam.

    A pixel's points satisfy y = apex_y + s (z - apex_z) in all profiles; the intercepts of these
    lines over their slopes give the apex. Scans too flat to tell get nearly parallel beams.
    """
    y = np.where(scan.valid, scan.points_mm[..., 1], 0.0)
    z = np.where(scan.valid, scan.points_mm[..., 2], 0.0)
    n = scan.valid.sum(axis=0)
    used = n >= 3
    n_safe = np.maximum(n, 1)
    mean_y, mean_z = y.sum(axis=0) / n_safe, z.sum(axis=0) / n_safe
    dy = np.where(scan.valid, y - mean_y, 0.0)
    dz = np.where(scan.valid, z - mean_z, 0.0)
    spread = (dz**2).sum(axis=0)
    used &= spread / n_safe > 25.0  # below 5 mm of relief a slope is mostly rounding
    parallel = np.array([0.0, 0.0, -PARALLEL_APEX_MM])
    if np.count_nonzero(used) < 8:
        return parallel
    slope = (dy * dz).sum(axis=0)[used] / spread[used]
    weight = np.sqrt(spread[used])
    design = np.stack([np.ones_like(slope), -slope], axis=1)
    rhs = mean_y[used] - slope * mean_z[used]
    solution, _, rank, _ = np.linalg.lstsq(design * weight[:, None], rhs * weight, rcond=1e-6)
    if rank < 2 or solution[1] >= np.nanmin(scan.points_mm[..., 2]):
        return parallel
    return np.array([0.0, solution[0], solution[1]])


def depth_noise(depth_mm: FloatArray, slope: FloatArray) -> FloatArray:
    """Estimate the noise of every depth from its neighbours along the profile.

    The second difference of the inverse depth over the slope vanishes on a plane. Its clipped
    spread in bins of depth is fitted by sigma = a + b depth^2, both not negative.
    Returns (profiles, pixels) in mm.
    """
    inverse = 1.0 / depth_mm
    s0, s1, s2 = slope[:, :-2], slope[:, 1:-1], slope[:, 2:]
    with np.errstate(invalid="ignore", divide="ignore"):
        share = (s1 - s0) / (s2 - s0)
        deviation = inverse[:, 1:-1] - (1.0 - share) * inverse[:, :-2] - share * inverse[:, 2:]
        deviation /= np.sqrt(1.0 + share**2 + (1.0 - share) ** 2)
    known = np.isfinite(deviation) & (share > 0.2) & (share < 0.8)
    fallback = np.full(depth_mm.shape, MIN_SIGMA_MM)
    if np.count_nonzero(known) < MIN_TRIPLES_PER_BIN:
        return fallback
    middle = depth_mm[:, 1:-1][known]
    error_mm = np.abs(deviation[known]) * middle**2
    order = np.argsort(middle, kind="stable")
    bins = min(DEPTH_BINS, max(1, order.size // MIN_TRIPLES_PER_BIN))
    depths, sigmas = [], []
    for chosen in np.array_split(order, bins):
        depths.append(float(middle[chosen].mean()))
        sigmas.append(_clipped_spread(error_mm[chosen]))
    return np.asarray(
        _growing_noise(np.array(depths), np.array(sigmas), np.where(depth_mm > 0, depth_mm, 1.0))
    )


def _clipped_spread(error: FloatArray) -> float:
    # Creases and edges make a heavy tail; three rounds of clipping leave the noise. The factor
    # undoes what clipping a normal distribution at three sigma removes.
    limit = 3.0 * 1.4826 * float(np.median(error))
    spread = limit / 3.0
    for _ in range(3):
        kept = error[error <= limit]
        if kept.size == 0 or limit == 0.0:
            break
        spread = float(np.sqrt(np.mean(kept**2))) * 1.0135
        limit = 3.0 * spread
    return max(spread, MIN_SIGMA_MM)


def _growing_noise(depths: FloatArray, sigmas: FloatArray, at_mm: FloatArray) -> FloatArray:
    squares = depths**2
    if depths.size >= 2 and np.ptp(squares) > 0.0:
        b = float(np.cov(squares, sigmas)[0, 1] / np.var(squares, ddof=1))
        a = float(sigmas.mean() - b * squares.mean())
        if a < 0.0:
            a, b = 0.0, float((sigmas * squares).sum() / (squares**2).sum())
        if b < 0.0:
            a, b = float(sigmas.mean()), 0.0
    else:
        a, b = float(sigmas.mean()), 0.0
    noise: FloatArray = np.maximum(a + b * at_mm**2, MIN_SIGMA_MM)
    return noise
